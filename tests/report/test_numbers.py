"""Numbers as a person reads them, in the units of data sheets."""

import pytest

from imuloop.core.noise_model import Coefficient
from imuloop.core.units import DEGREE, HOUR, STANDARD_GRAVITY
from imuloop.report.numbers import coefficient_text, duration, interval_text, number, with_sigma
from imuloop.report.units import QUANTITIES, data_sheet

G = STANDARD_GRAVITY
THIN = "\u202f"


# σ has two digits, and the value ends at the same place
TEXTS = [
    *((with_sigma(*each), text) for each, text in (
        ((1.23456, 0.012), "1.235 ± 0.012"), ((33124.2, 5.1), "33 124.2 ± 5.1"),
        ((12345, 234), "12 340 ± 230"), ((1.23e-5, 4e-7), "(1.230 ± 0.040) × 10⁻⁵"),
        ((-0.5, 0.0996), "−0.50 ± 0.10"), ((-0.0001, 0.02), "0.000 ± 0.020"),
        ((0.2, 0.996), "0.2 ± 1.0"), ((3.0, None), "3.00"), ((float("nan"), 0.1), "—"))),
    *((number(*each), text) for each, text in (
        ((0, 3), "0"), ((0.99996, 3), "1.00"), ((9.80665, 5), "9.8066"),
        ((-1.5e-7, 3), "−1.50 × 10⁻⁷"), ((720000, 3), "720 000"), ((float("inf"), 3), "—"))),
    *((coefficient_text(each), text) for each, text in (
        (Coefficient(upper95=2.5e-6), "< 2.5 × 10⁻⁶"), (Coefficient(), "—"),
        (Coefficient(1.0, (0.9, 1.1), 1.09, True), "1.000 ± 0.051"))),
    *((interval_text(each), text) for each, text in (
        ((84.161, 84.742), "84.16 to 84.74"), ((0.0, 12.0), "0 to 12"), ((1.0, None), "—"))),
    (duration(12), "12.0 s"), (duration(7200), "2.00 h"),
]  # fmt: skip


@pytest.mark.parametrize(("shown", "text"), TEXTS)
def test_a_number_has_the_digits_that_it_is_known_to(shown, text):
    assert shown.replace(THIN, " ") == text


@pytest.mark.parametrize(
    ("sensor", "key", "unit", "si", "shown"),
    [
        # Xsens MTi-100 data sheet: 60 µg/√Hz and 0.01 °/s/√Hz; a density in °/s/√Hz times 60
        # is one in °/√h
        ("accelerometer", "N", "µg/√Hz", 60e-6 * G, 60),
        ("gyroscope", "N", "°/√h", 0.01 * DEGREE, 0.6),
        ("gyroscope", "B", "°/h", 10 * DEGREE / HOUR, 10),
        ("gyroscope", "Q", "arcsec", DEGREE / 3600, 1),
        # rad/s per √s: 3600 s/h times √3600
        ("gyroscope", "K", "°/h/√h", 1.0, 3600 * 60 / DEGREE),
        ("gyroscope", "R", "°/h/h", 1.0, 3600 * 3600 / DEGREE),
        ("accelerometer", "R", "µg/h", G * 1e-6 / 3600, 1),
    ],
)
def test_noise_units_of_data_sheets(sensor, key, unit, si, shown):
    display = QUANTITIES[sensor][key]
    assert display.unit == unit and si * display.factor == pytest.approx(shown, rel=1e-9)


# what a parameter of 1 in the unit of data sheets adds at a stimulus, both in SI
@pytest.mark.parametrize(
    ("si", "shown", "stimulus", "added"),
    [
        ("m/s^2 per K/s", "mg per K/min", 1 / 60, G / 1e3),
        ("m/s^2 per s", "mg/h", HOUR, G / 1e3),
        ("m/s^2 per (m/s^2)^2", "µg/g²", G**2, G / 1e6),
        ("m/s^2 per (m/s^2)^3", "µg/g³", G**3, G / 1e6),
        ("rad/s per m/s^2", "°/s per g", G, DEGREE),
        ("rad/s per (m/s^2)^2", "°/s per g²", G**2, DEGREE),
        ("rad/s per K/s", "°/s per K/min", 1 / 60, DEGREE),
        ("rad/s per (rad/s)^2", "ppm per °/s", DEGREE**2, 1e-6 * DEGREE),
        ("rad/s per (rad/s)^3", "ppm per (°/s)²", DEGREE**3, 1e-6 * DEGREE),
        ("1 per K", "ppm/K", 1.0, 1e-6),
    ],
)
def test_one_in_the_unit_of_a_data_sheet(si, shown, stimulus, added):
    display = data_sheet(si)
    assert display.unit == shown
    assert added / stimulus * display.factor == pytest.approx(1, rel=1e-12)
