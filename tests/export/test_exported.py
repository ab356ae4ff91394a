"""The numbers and words that every format is written with."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from export.devices import HOSTILE, device, g_sensitivity, unknown, warm_bias, without_flicker
from imuloop.core.errors import Lacking
from imuloop.core.noise_model import AxisNoise, Coefficient
from imuloop.export.exported import comment, for_filter, number, numbers, quoted


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_number_reads_back_as_the_same_float_in_yaml_and_in_c(value):
    text = number(value)
    assert "." in text
    assert yaml.safe_load(text) == float(text) == value
    assert math.copysign(1, float(text)) == math.copysign(1, value)


def test_numbers_go_row_by_row():
    assert numbers([[1, 2], [3, 4e-9]]) == "1.0, 2.0, 3.0, 4.0e-09"


@given(st.text())
def test_a_comment_stays_a_comment(text):
    lines = comment(text, "b").split("\n")
    assert len(lines) == 3
    assert lines[0].startswith("#")
    assert yaml.safe_load(f"{comment(text)}a: 1\n") == {"a": 1}


@given(st.text())
def test_quoted_text_is_one_string(text):
    assert isinstance(yaml.safe_load(quoted(text)), str)
    assert json.loads(quoted(text)) == yaml.safe_load(quoted(text))


def test_the_hostile_label_is_hostile():
    assert len(HOSTILE.splitlines()) > 5
    assert comment(HOSTILE).count("\n") == 1


def test_what_was_seen_is_given_and_what_was_not_by_its_limit():
    seen, limit = device().density("ax", "K"), device().density("ay", "K")
    assert (seen.value, seen.limit, seen.words) == (1.2e-4, False, "ax")
    assert (limit.value, limit.limit) == (3e-5, True)
    assert limit.words == "ay, not seen: its 95 % upper limit"


@pytest.mark.parametrize(
    ("sensor", "term", "axis", "limit"),
    [
        ("accelerometer", "N", "az", False),
        ("accelerometer", "K", "ax", False),
        ("gyroscope", "N", "gy", False),
        ("gyroscope", "K", "gz", True),
    ],
)
def test_the_worst_axis(sensor, term, axis, limit):
    worst = device().worst(sensor, term)
    assert (worst.axis, worst.limit) == (axis, limit)


@pytest.mark.parametrize("sensor", ["accelerometer", "gyroscope"])
@pytest.mark.parametrize("term", ["N", "K"])
def test_white_noise_and_walk_alone_are_not_raised(sensor, term):
    board = without_flicker(device())
    worst = board.worst(sensor, term)
    assert worst == board.density(worst.axis, term)
    assert worst.raised_from is None


def test_the_worst_axis_is_that_of_the_largest_raised_value():
    # more white noise on gy, more flicker on gx
    board = device()
    axes = board.noise.axes
    axes["gx"] = replace(axes["gx"], B=replace(axes["gx"].B, value=3e-4))
    worst = board.worst("gyroscope", "N")
    assert (worst.axis, worst.raised_from) == ("gx", board.density("gx", "N").value)
    assert worst.value > board.density("gy", "N").value


def test_a_limit_that_was_raised_is_said_to_be_both():
    limited = Coefficient(upper95=2e-9)
    seen = Coefficient(8e-5, (7e-5, 9e-5), 9e-5, True)
    walk = for_filter(AxisNoise(N=seen, B=seen, K=limited), "gz", "K")
    assert (walk.limit, walk.raised_from) == (True, 2e-9)
    assert walk.words == (
        "gz, not seen: its 95 % upper limit; raised from 2e-09 so that N and K bound its Allan "
        "curve from 0.1 s to 1000 s"
    )
    assert walk.times(10.0).value == 10 * walk.value
    assert walk.times(10.0).raised_from == pytest.approx(2e-8)


def test_what_is_not_known_is_lacking():
    with pytest.raises(Lacking, match="no noise: N of ax is neither known nor limited"):
        unknown().worst("accelerometer", "N")
    with pytest.raises(Lacking, match="rate"):
        unknown().need_rate()
    with pytest.raises(Lacking, match=r"accelerometer: nominal \(no session could be used\)"):
        unknown().need_calibration()
    assert device().need_calibration() is None


def test_the_matrix_takes_raw_values_to_si():
    board = device()
    sensor = board.sensor("accelerometer")
    raw = np.array([33000.0, 32000.0, 36000.0])
    expected = sensor.apply(sensor.raw_unit.to_si(raw)[None])[0]
    np.testing.assert_allclose(board.matrix("accelerometer") @ (raw - sensor.b), expected, 1e-12)


def test_effects_are_named_with_their_largest_parameter():
    lines = device(effects=(g_sensitivity(), warm_bias())).effects("gyroscope")
    largest = max(map(abs, g_sensitivity().values.values()))
    assert lines[0] == f"g_sensitivity: e = G f; largest parameter {largest:.2g} rad/s per m/s^2"
    assert lines[1].endswith(
        "largest parameter 0.01 rad/s per K; order = 1; reference_temperature = 25"
    )
    assert device().effects("accelerometer") == []
