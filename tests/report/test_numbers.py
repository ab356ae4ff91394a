"""Numbers as a person reads them, in the units of data sheets."""

from pathlib import Path

import pytest
import yaml

from imuloop.core.noise_model import Coefficient
from imuloop.report.numbers import coefficient_text, duration, interval_text, number, with_sigma
from imuloop.report.units import QUANTITIES, data_sheet

UNITS = yaml.safe_load(Path(__file__).with_name("units.yaml").read_text("utf-8"))
THIN = "\u202f"


# σ has two digits, and the value ends at the same place
TEXTS = [
    *((with_sigma(*arguments), text) for arguments, text in (
        ((1.23456, 0.012), "1.235 ± 0.012"), ((33124.2, 5.1), "33 124.2 ± 5.1"),
        ((12345, 234), "12 340 ± 230"), ((1.23e-5, 4e-7), "(1.230 ± 0.040) × 10⁻⁵"),
        ((-0.5, 0.0996), "−0.50 ± 0.10"), ((-0.0001, 0.02), "0.000 ± 0.020"),
        ((0.2, 0.996), "0.2 ± 1.0"), ((3.0, None), "3.00"), ((float("nan"), 0.1), "—"))),
    *((number(*arguments), text) for arguments, text in (
        ((0, 3), "0"), ((0.99996, 3), "1.00"), ((9.80665, 5), "9.8066"),
        ((-1.5e-7, 3), "−1.50 × 10⁻⁷"), ((720000, 3), "720 000"), ((float("inf"), 3), "—"))),
    *((coefficient_text(arguments), text) for arguments, text in (
        (Coefficient(upper95=2.5e-6), "< 2.5 × 10⁻⁶"), (Coefficient(), "—"),
        (Coefficient(1.0, (0.9, 1.1), 1.09, True), "1.000 ± 0.051"))),
    *((interval_text(arguments), text) for arguments, text in (
        ((84.161, 84.742), "84.16 to 84.74"), ((0.0, 12.0), "0 to 12"), ((1.0, None), "—"))),
    (duration(12), "12.0 s"), (duration(7200), "2.00 h"),
]  # fmt: skip


@pytest.mark.parametrize(("shown", "text"), TEXTS)
def test_a_number_has_the_digits_that_it_is_known_to(shown, text):
    assert shown.replace(THIN, " ") == text


@pytest.mark.parametrize(("sensor", "key", "unit", "si", "shown"), UNITS["noise"])
def test_noise_units_of_data_sheets(sensor, key, unit, si, shown):
    display = QUANTITIES[sensor][key]
    assert display.unit == unit and si * display.factor == pytest.approx(shown, rel=1e-9)


@pytest.mark.parametrize(("si", "shown", "stimulus", "added"), UNITS["effects"])
def test_one_in_the_unit_of_a_data_sheet(si, shown, stimulus, added):
    display = data_sheet(si)
    assert display.unit == shown
    assert added / stimulus * display.factor == pytest.approx(1, rel=1e-9)
