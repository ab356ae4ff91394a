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
    """A parameter of family.json in words, and its unit."""

    words: str
    display: Display
    relative: bool  # whether the spread and the errors are relative to the value

    def spread(self, value):
        """Return a spread or an error as text, without its unit."""
        return (PERCENT if self.relative else self.display).size(value, 2)

    def value(self, value, sigma):
        """Return a value with its standard error `sigma` as text, without the unit."""
        sigma = value * sigma if self.relative and value and sigma else sigma
        return with_sigma(value, sigma, self.display.factor)


def parameters():
    """Return each `Parameter` by its name in family.json, in the order of the table."""
    found = {}
    for sensor, channels in SENSORS.items():
        names = {f"{sensor}.{name}": (*place, False) for name, place in PARAMETERS.items()}
        for term in "NBK":
            axes = zip(channels, XYZ, strict=True)
            names |= {f"{channel}.{term}": (term, axis, True) for channel, axis in axes}
        for name, (quantity, axis, relative) in names.items():
            words = f"{sensor}, {WORDS['compared'][quantity].lower()} {axis}"
            found[name] = Parameter(words, QUANTITIES[sensor][quantity], relative)
    return found


def family_tables(found, labels):
    """Return the tables of a type of devices, a list without empty tables.

    `found` is the content of family.json for the type, and `labels` has the labels of devices by
    name.
    """
    tables = (spread_table(found), odd_table(found, labels), effect_table(found))
    return [table for table in tables if table.rows]


def finding(found, labels):
    """Return a sentence with the devices that stand out from a type."""
    names = [*dict.fromkeys(labels[each["device"]] for each in found["odd"])]
    return phrase("family", found=found, names=names)


def spread_table(found):
    """Return the table of mean and spread of each parameter that devices share."""
    rows = []
    for name, parameter in parameters().items():
        if one := found["parameters"].get(name):
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
    caption = f"Mean and spread of {plural(len(found['devices']), 'device')}"
    return Table(caption, columns, rows, note, sortable=True)


def odd_table(found, labels):
    """Return the table of the devices that stand out, with their values."""
    known, rows = parameters(), []
    for each in found["odd"]:
        parameter, one = known[each["parameter"]], found["parameters"][each["parameter"]]
        k = one["devices"].index(each["device"])
        text = parameter.value(one["values"][k], one["std"][k])
        away = Sized(number(each["deviation"]), abs(each["deviation"]))
        chance = Sized(probability(each["p_value"]), each["p_value"])
        unit = parameter.display.unit
        rows.append((labels[each["device"]], parameter.words, unit, text, away, chance))
    columns = ("Device", "Parameter", "Unit", "Value ± 1 σ", "Deviation, σ", "p-value")
    note = (
        "Deviation from the prediction by the other devices, in standard deviations of the "
        "prediction. The p-value: the chance that any of all tests deviates as far."
    )
    return Table("Devices that stand out", columns, rows, note, sortable=True)


def effect_table(found):
    """Return the table of effects that some device has, or that all devices together show."""
    rows = [
        (
            effect_words(each),
            f"{each['sensor']}, {RECORDS[each['record']]}",
            Sized(f"{len(each['added'])} of {each['tried']}", len(each["added"]) / each["tried"]),
            Sized(probability(each["p_value"]), each["p_value"]),
        )
        for each in found["effects"]
        if each["added"] or each["p_value"] < found["significance"]
    ]
    columns = ("Effect", "Data", "Devices that have it", "p-value")
    note = (
        "The p-value is for the hypothesis that fewer than half of the devices have the effect, "
        "from the data of all. A type may have an effect that no single device shows."
    )
    return Table("Effects of the type", columns, rows, note, sortable=True)
