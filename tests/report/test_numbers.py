"""Numbers as a person reads them."""

import pytest

from imuloop.core.noise_model import Coefficient
from imuloop.report.numbers import coefficient_text, duration, interval_text, number, with_sigma
from imuloop.report.tables.table import Sized
from imuloop.report.units import quantities

THIN = "\u202f"


@pytest.mark.parametrize(
    ("value", "sigma", "text"),
    [
        (1.23456, 0.012, "1.235 ± 0.012"),
        (33124.2, 5.1, "33 124.2 ± 5.1"),
        (12345, 234, "12 340 ± 230"),
        (0.0000123, 0.0000004, "(1.230 ± 0.040) × 10⁻⁵"),
        (-0.5, 0.0996, "−0.50 ± 0.10"),
        (-0.0001, 0.02, "0.000 ± 0.020"),
        (0.2, 0.996, "0.2 ± 1.0"),
        (3.0, None, "3.00"),
        (None, 0.1, "—"),
        (float("nan"), 0.1, "—"),
    ],
)
def test_sigma_has_two_digits_and_the_value_ends_at_the_same_place(value, sigma, text):
    assert with_sigma(value, sigma).replace(THIN, " ") == text


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (0, 3, "0"),
        (0.99996, 3, "1.00"),
        (9.80665, 5, "9.8066"),
        (-1.5e-7, 3, "−1.50 × 10⁻⁷"),
        (720000, 3, "720 000"),
        (float("inf"), 3, "—"),
    ],
)
def test_number_keeps_significant_digits(value, digits, text):
    assert number(value, digits).replace(THIN, " ") == text


@pytest.mark.parametrize(
    ("sensor", "key", "unit", "si", "shown"),
    [
        # Xsens MTi-100 data sheet: 60 µg/√Hz and 0.01 °/s/√Hz; a density in °/s/√Hz times 60
        # is one in °/√h
        ("accelerometer", "N", "µg/√Hz", 60e-6 * 9.80665, 60),
        ("gyroscope", "N", "°/√h", 0.01 * 3.141592653589793 / 180, 0.6),
        ("gyroscope", "B", "°/h", 10 * 4.84813681109536e-6, 10),
        ("gyroscope", "Q", "arcsec", 4.84813681109536e-6, 1),
        # rad/s per √s: 3600 s/h times √3600
        ("gyroscope", "K", "°/h/√h", 1.0, 180 / 3.141592653589793 * 3600 * 60),
        ("gyroscope", "R", "°/h/h", 1.0, 180 / 3.141592653589793 * 3600 * 3600),
        ("accelerometer", "R", "µg/h", 9.80665e-6 / 3600, 1),
    ],
)
def test_noise_units_of_data_sheets(sensor, key, unit, si, shown):
    factor = next(d.factor for d in quantities(sensor)[key].sheet if d.unit == unit)
    assert si * factor == pytest.approx(shown, rel=1e-9)


def test_coefficient_without_value_is_an_upper_limit():
    known = Coefficient(upper95=2.5e-6), Coefficient(1.0, (0.9, 1.1), 1.09, True), Coefficient()
    found = [coefficient_text(c).replace(THIN, " ") for c in known]
    ends = [(84.161, 84.742), (0.0, 12.0), (1.0, None)]
    assert [interval_text(e) for e in ends] == ["84.16 to 84.74", "0 to 12", "—"]
    assert [duration(s).replace(THIN, " ") for s in (12, 7200)] == ["12.0 s", "2.00 h"]
    assert found == ["< 2.5 × 10⁻⁶", "1.000 ± 0.051", "—"]


def test_a_cell_is_its_text_and_sorts_by_its_size():
    assert Sized("5 min", 300.0).value == "300" and Sized("—", float("nan")).value is None
