"""Noise coefficients, as logged and after the correction."""

from imuloop.core.noise_model import AxisNoise
from imuloop.report.numbers import coefficient_text
from imuloop.report.results import XYZ, of_axes
from imuloop.report.tables.table import Table
from imuloop.report.units import COEFFICIENTS, quantities

NOTE = (
    "“<”: not seen in the record, below this number with 95 % confidence. B is the flat part of "
    "the Allan curve divided by 0.664."
)


def coefficient_words(sensor, key, data_sheet):
    """Return a coefficient in words; of white noise with the figure of the data sheet, if any."""
    quantity = quantities(sensor)[key]
    typical = data_sheet.get("noise", {}).get(sensor) if key == "N" else None
    if typical is None:
        return quantity.words
    return f"{quantity.words}; data sheet {quantity.sheet[0].size(typical, 2)} (typical)"


def coefficient_table(device, sensor):
    """Return a sensor's noise coefficients, a column per axis, in units of data sheets."""
    axes, known, rows = of_axes(device.axes, sensor), quantities(sensor), []
    for key in COEFFICIENTS:
        unit = known[key].sheet[0]
        cells = (coefficient_text(getattr(noise, key), unit.factor) for _, noise in axes)
        rows.append((coefficient_words(sensor, key, device.data_sheet), unit.unit, *cells))
    for key, name in (("tc", "gauss_markov"), ("frequency", "sinusoid")):
        found = [[getattr(p, key) for p in getattr(noise, name)] for _, noise in axes]
        if any(found):
            unit = known[key].si
            cells = (", ".join(coefficient_text(c, unit.factor) for c in own) for own in found)
            rows.append((known[key].words, unit.unit, *cells))
    title = f"{sensor.capitalize()}: noise coefficients, value ± 1 σ"
    return Table(title, ("Coefficient", "Unit", *XYZ), rows, NOTE)


def noise_change_table(sensor, block):
    """Return the noise coefficients before and after the correction; None where not given."""
    if not block.get("noise"):
        return None
    stages = [
        [AxisNoise.from_dict(change[stage]) for stage in ("before", "after")]
        for _, change in of_axes(block["noise"], sensor)
    ]
    rows = []
    for key in COEFFICIENTS:
        quantity = quantities(sensor)[key]
        unit = quantity.sheet[0]
        cells = (
            " → ".join(coefficient_text(getattr(noise, key), unit.factor) for noise in pair)
            for pair in stages
        )
        rows.append((quantity.words, unit.unit, *cells))
    return Table(
        f"{sensor.capitalize()}, static record: noise coefficients before → after the correction",
        ("Coefficient", "Unit", *XYZ),
        rows,
        "What the effects explain is no noise.",
    )
