"""Devices of one type: mean and spread of each parameter, and who stands out."""

from dataclasses import dataclass
from itertools import permutations

from imuloop.core.errors import joined, plural
from imuloop.report.numbers import number, probability, with_sigma
from imuloop.report.results import SENSORS, XYZ
from imuloop.report.tables.calibration import BIAS
from imuloop.report.tables.comparison import NOISE
from imuloop.report.tables.table import Sized, Table
from imuloop.report.units import MILLIRADIAN, PERCENT, Display, quantities
from imuloop.report.verdict import PARTS, effect_words

# the most devices that a sentence names
NAMED = 5


@dataclass(frozen=True)
class Kind:
    """One kind of parameter of a sensor, and the axis of each by its name in family.json."""

    sensor: str
    words: str
    display: Display
    axes: dict
    relative: bool = False  # whether spread and errors are, as of logarithms

    @property
    def title(self):
        """Sensor and kind in words."""
        return f"{self.sensor}, {self.words}"

    def spread(self, value):
        """Return a spread or an error as text, without its unit."""
        return (PERCENT if self.relative else self.display).size(value, 2)

    def value(self, value, sigma):
        """Return a value with its error, without the unit."""
        sigma = value * sigma if self.relative and value and sigma else sigma
        return with_sigma(value, sigma, self.display.factor)


def kinds():
    """Return each `Kind` of parameter, in the order of the tables."""
    found = []
    for sensor, channels in SENSORS.items():
        bias, scale = (
            {f"{sensor}.{letter}{i}": axis for i, axis in enumerate(XYZ)} for letter in "bK"
        )
        pairs = [(i, j) for i, j in permutations(range(3), 2) if i < j or sensor == "gyroscope"]
        angles = {f"{sensor}.T{i}{j}": XYZ[i] + XYZ[j] for i, j in pairs}
        found.append(Kind(sensor, "bias", BIAS[sensor], bias))
        found.append(Kind(sensor, "scale factor error", PERCENT, scale))
        found.append(Kind(sensor, "misalignment", MILLIRADIAN, angles))
        for term, words in NOISE.items():
            axes = {f"{c}.{term}": axis for c, axis in zip(channels, XYZ, strict=True)}
            display = quantities(sensor)[term].sheet[0]
            found.append(Kind(sensor, words.lower(), display, axes, relative=True))
    return found


def named():
    """Return `Kind` and words of each parameter by its name in family.json."""
    return {
        name: (kind, f"{kind.title} {axis}") for kind in kinds() for name, axis in kind.axes.items()
    }


def family_tables(found, labels):
    """Return the tables of a type, content of family.json; labels of the devices by name."""
    made = (spread_table, odd_table, effect_table)
    return [table for make in made if (table := make(found, labels))]


def finding(found, labels):
    """Return in a sentence who stands out from a type."""
    chance = (
        f"By chance alone {PERCENT.text(found['significance'], 1)} of such families have any "
        f"device named, in all of {found['tests']} tests."
    )
    if not found["tests"]:
        return "No three devices have a parameter in common."
    who = [*dict.fromkeys(labels[each["device"]] for each in found["odd"])]
    if not who:
        return f"No device stands out. {chance}"
    first = joined(who[:NAMED]) if len(who) <= NAMED else f"{', '.join(who[:NAMED])} and others"
    return f"{plural(len(who), 'device')} {'stand' if who[1:] else 'stands'} out: {first}. {chance}"


def spread_table(found, labels):
    """Return mean and spread of each parameter; None where devices share none."""
    rows = []
    for name, (kind, words) in named().items():
        if one := found["parameters"].get(name):
            low, high = one["spread_ci95"]
            rows.append(
                (
                    words.capitalize(),
                    kind.display.unit,
                    str(len(one["devices"])),
                    kind.value(one["mean"], one["mean_std"]),
                    f"{kind.spread(one['spread'])} ({kind.spread(low)} to {kind.spread(high)})"
                    + "\u202f%" * kind.relative,
                    kind.spread(one["within"]) + "\u202f%" * kind.relative,
                )
            )
    columns = "Parameter, Unit, Devices, Mean ± 1 σ, Between devices (95 %), Within"
    note = (
        "Between devices: standard deviation of what they are, without their errors. Within: "
        "standard error of one device."
    )
    caption = f"Mean and spread of {plural(len(found['devices']), 'device')}"
    return Table(caption, tuple(columns.split(", ")), rows, note, sortable=True) if rows else None


def odd_table(found, labels):
    """Return the devices that stand out, and in what; None without any."""
    known, rows = named(), []
    for each in found["odd"]:
        kind, words = known[each["parameter"]]
        one = found["parameters"][each["parameter"]]
        k = one["devices"].index(each["device"])
        text = kind.value(one["values"][k], one["std"][k])
        away = Sized(number(each["deviation"]), abs(each["deviation"]))
        chance = Sized(probability(each["p_value"]), each["p_value"])
        rows.append((labels[each["device"]], words, kind.display.unit, text, away, chance))
    columns = ("Device", "Parameter", "Unit", "Value ± 1 σ", "Deviation, σ", "p-value")
    note = (
        "Deviation from what the other devices predict, in standard deviations of the prediction; "
        "the p-value is that of any of all tests."
    )
    return Table("Devices that stand out", columns, rows, note, sortable=True) if rows else None


def effect_table(found, labels):
    """Return the effects that some device has, or all together show; None without any."""
    rows = [
        (
            effect_words(each["name"]),
            f"{each['sensor']}, {PARTS[each['record']]}",
            Sized(f"{len(each['added'])} of {each['tried']}", len(each["added"]) / each["tried"]),
            Sized(probability(each["p_value"]), each["p_value"]),
        )
        for each in found["effects"]
        if each["added"] or each["p_value"] < found["significance"]
    ]
    columns = ("Effect", "Data", "Devices that have it", "p-value")
    note = (
        "The p-value is that of fewer than half of the devices having it, from those of all. So an "
        "effect may be that of the type that no device shows by itself."
    )
    return Table("Effects of the type", columns, rows, note, sortable=True) if rows else None
