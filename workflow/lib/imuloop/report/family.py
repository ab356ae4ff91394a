"""Tables of devices of one type: mean and spread of each parameter, and unusual devices."""

from dataclasses import dataclass

from imuloop.core.errors import plural
from imuloop.core.samples import SENSORS
from imuloop.report.long_table import PARAMETERS
from imuloop.report.numbers import number, probability, with_sigma
from imuloop.report.page import RECORDS, WORDS, effect_words, phrase
from imuloop.report.results import XYZ
from imuloop.report.table import Sized, Table
from imuloop.report.units import PERCENT, QUANTITIES, Display


@dataclass(frozen=True)
class Parameter:
    """A parameter in the table of a type: its `words` for a reader, and its unit, a Display.

    The spread and the errors of a `relative` parameter, such as a noise coefficient, are shares of
    its value. For any other parameter they are in SI.
    """

    words: str
    display: Display
    relative: bool  # whether the spread and the errors are relative to the value

    def spread(self, value):
        """Return a spread or a standard error, `value`, as text without its unit.

        `value` is in SI, or a share of the parameter's mean if `relative`, which is shown in per
        cent.
        """
        return (PERCENT if self.relative else self.display).size(value, 2)

    def value(self, value, sigma):
        """Return ``value ± σ`` as text without the unit.

        `value` is the value of the parameter, SI. `sigma` is its standard error, SI, or as a share
        of `value` if `relative`; without it the text has the value only.
        """
        sigma = value * sigma if self.relative and value and sigma else sigma
        return with_sigma(value, sigma, self.display.factor)


def parameters():
    """Return the `Parameter` by its name in family.json, a dict in the order of the table."""
    by_name = {}
    for sensor, channels in SENSORS.items():
        names = {f"{sensor}.{name}": (*place, False) for name, place in PARAMETERS.items()}
        for term in "NBK":
            axes = zip(channels, XYZ, strict=True)
            names |= {f"{channel}.{term}": (term, axis, True) for channel, axis in axes}
        for name, (quantity, axis, relative) in names.items():
            words = f"{sensor}, {WORDS['compared'][quantity].lower()} {axis}"
            by_name[name] = Parameter(words, QUANTITIES[sensor][quantity], relative)
    return by_name


def family_tables(family, labels):
    """Return the tables on the devices of one type, a list without empty tables.

    `family` is the content of family.json for the type. `labels` are the labels of all devices in
    the report, by name.
    """
    tables = (spread_table(family), odd_table(family, labels), effect_table(family))
    return [table for table in tables if table.rows]


def finding(family, labels):
    """Return a sentence that names the odd devices of a type, which differ from its other devices.

    `family` is the content of family.json for the type. `labels` are the labels of all devices in
    the report, by name.
    """
    names = [*dict.fromkeys(labels[odd["device"]] for odd in family["odd"])]
    return phrase("family", found=family, names=names)


def spread_table(family):
    """Return the Table of the mean and the spread of each parameter over the devices of a type.

    `family` is the content of family.json for the type.
    """
    rows = []
    for name, parameter in parameters().items():
        if one := family["parameters"].get(name):
            low, high = map(parameter.spread, one["spread_ci95"])
            percent = "\u202f%" * parameter.relative
            rows.append(
                (
                    parameter.words.capitalize(),
                    parameter.display.unit,
                    str(len(one["devices"])),
                    parameter.value(one["mean"], one["mean_std"]),
                    f"{parameter.spread(one['spread'])} ({low} to {high}){percent}",
                    parameter.spread(one["within"]) + percent,
                )
            )
    columns = ("Parameter", "Unit", "Devices", "Mean ± 1 σ", "Between devices (95 %)", "Within")
    note = (
        "Between devices: standard deviation of the true values. Within: standard error of one "
        "device."
    )
    caption = f"Mean and spread of {plural(len(family['devices']), 'device')}"
    return Table(caption, columns, rows, note, sortable=True)


def odd_table(family, labels):
    """Return the Table of the odd devices of a type, which differ from its other devices.

    A row is a device and the parameter in which it differs. `family` is the content of family.json
    for the type. `labels` are the labels of all devices in the report, by name.
    """
    by_name, rows = parameters(), []
    for odd in family["odd"]:
        parameter, one = by_name[odd["parameter"]], family["parameters"][odd["parameter"]]
        k = one["devices"].index(odd["device"])
        text = parameter.value(one["values"][k], one["std"][k])
        away = Sized(number(odd["deviation"]), abs(odd["deviation"]))
        chance = Sized(probability(odd["p_value"]), odd["p_value"])
        unit = parameter.display.unit
        rows.append((labels[odd["device"]], parameter.words, unit, text, away, chance))
    columns = ("Device", "Parameter", "Unit", "Value ± 1 σ", "Deviation, σ", "p-value")
    note = (
        "Deviation from the prediction by the other devices, in standard deviations of the "
        "prediction. The p-value: the chance that any of all tests deviates as far."
    )
    return Table("Devices that stand out", columns, rows, note, sortable=True)


def effect_table(family):
    """Return the Table of the effects of a type, found in one device or in the data of all devices.

    The data of all devices show an effect if its p-value in family.json is below the significance
    level given there. `family` is the content of family.json for the type.
    """
    rows = [
        (
            effect_words(e),
            f"{e['sensor']}, {RECORDS[e['record']]}",
            Sized(f"{len(e['added'])} of {e['tried']}", len(e["added"]) / e["tried"]),
            Sized(probability(e["p_value"]), e["p_value"]),
        )
        for e in family["effects"]
        if e["added"] or e["p_value"] < family["significance"]
    ]
    columns = ("Effect", "Data", "Devices that have it", "p-value")
    note = (
        "The p-value is for the hypothesis that fewer than half of the devices have the effect, "
        "from the data of all. A type may have an effect that no single device shows."
    )
    return Table("Effects of the type", columns, rows, note, sortable=True)
