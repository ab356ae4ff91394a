"""Means of a static record: which windows, what an effect sees in them."""

import numpy as np
import pandas as pd
import pytest

from imuloop.core import rest_log
from imuloop.core.model import Calibration
from imuloop.core.samples import CHANNELS, Samples
from imuloop.core.sensor_calibration import SensorCalibration
from imuloop.core.units import RawUnit
from imuloop.diagnose.records.rests import rests_to_use
from imuloop.diagnose.records.static_windows import (
    static_record,
)
from imuloop.effects.drifts import settling
from imuloop.effects.mechanics import creep, vibration
from imuloop.effects.temperature import branch, lagged_rate


def calibration(scale=1.0):
    def sensor(unit):
        nominal = SensorCalibration.nominal(RawUnit(unit, 1.0, 0.0), "")
        return SensorCalibration(nominal.raw_unit, nominal.T, scale * nominal.K, nominal.b + 0.5)

    return Calibration("d", 9.8, sensor("m/s^2"), sensor("rad/s"))


def log(seconds=2400.0, rate=10.0):
    n = int(seconds * rate)
    t = np.arange(n) / rate
    x = np.random.default_rng(0).normal(size=(n, 6)) + np.arange(6)
    columns = dict(zip(CHANNELS, x.T, strict=True))
    return pd.DataFrame({"t": t, **columns, "temperature": 20 + t / 600})


def segments(*rows):
    return pd.DataFrame(rows, columns=["start_s", "end_s", "kind"]).assign(tilt_rad=0.0)


CUT = segments((0, 1190, "static"), (1190, 1210, "disturbed"), (1210, 2400, "static"))


def made(samples=None, cut=CUT, mean_time=20.0, sensor="gyroscope", scale=1.0):
    samples = log() if samples is None else samples
    return static_record("s", samples, cut, calibration(scale), sensor, mean_time)


def test_windows_hold_means_of_the_output_and_lie_whole_in_undisturbed_stretches():
    samples, found = log(), made(scale=2.0)
    assert not np.any((found.windows[:, 1] > 1190) & (found.windows[:, 0] < 1210))
    assert list(np.unique(found.stretch, return_counts=True)[1]) == [59, 59]
    for k in (0, 58, 59, 117):
        start, end = found.windows[k]
        raw = samples[(samples.t >= start) & (samples.t < end)][["gx", "gy", "gz"]].mean()
        np.testing.assert_allclose(found.values[k], 2 * (raw - 0.5), rtol=1e-12)
    # at rest the output stands still for the effects
    np.testing.assert_allclose(found.channels.output, np.tile(found.values.mean(0), (118, 1)))


def test_the_static_sessions_are_used_else_the_longest_rest():
    moves = segments((0, 700, "static"), (700, 710, "motion"), (710, 720, "static"))
    short = segments((0, 500, "static"), (500, 560, "motion"))
    kinds = {"a": "static", "b": "multi_position", "c": "six_position"}
    assert list(rests_to_use(kinds, {"a": CUT, "b": moves})) == ["a"]
    (name, alone), *more = rests_to_use(kinds, {"b": moves, "c": short}).items()
    assert (name, *alone["start_s"], *alone["end_s"], more) == ("b", 0, 700, [])
    assert rests_to_use(kinds, {"c": short}) == {}
    # a static session that holds no rest is as none
    moved = segments((0, 100, "disturbed"))
    assert list(rests_to_use(kinds, {"a": moved, "b": moves})) == ["b"]


def test_windows_with_missing_values_are_left_out_and_spoil_no_other():
    samples, found = log(), made()
    samples.loc[5000:5010, "ax"] = np.nan
    holed = made(samples)
    missing = (found.windows[:, 0] <= 501.0) & (found.windows[:, 1] > 500.0)
    assert missing.sum() == 1
    np.testing.assert_array_equal(holed.windows, found.windows[~missing])
    np.testing.assert_allclose(holed.values, found.values[~missing], rtol=1e-9)
    assert np.isfinite(holed.channels.remembered(lambda whole: whole.other)).all()


@pytest.mark.parametrize("missing", [False, True])
def test_a_log_is_the_same_in_parts(missing, monkeypatch, tmp_path):
    samples = log(seconds=600.0, rate=50.0)
    samples["temperature"] += np.sin(samples["t"] / 50)
    if missing:
        # longer than a part
        samples.loc[9000:12000, ["ax", "gz"]] = np.nan
        samples.loc[samples.index % 7 > 0, "temperature"] = np.nan
    samples.to_parquet(tmp_path / "s.parquet", row_group_size=4000)
    remembered = (vibration,), (lagged_rate, 40.0), (branch, 0.3), (settling, 90.0), (creep, 20.0)
    cut = segments((0, 290, "static"), (300, 600, "static"))
    whole = made(samples, cut, 5.0, "accelerometer")
    # not marked, so that each gets the whole log
    expected = [
        whole.channels.remembered(lambda c, *of, function=function: function(c, *of), *constants)
        for function, *constants in remembered
    ]
    monkeypatch.setattr(rest_log, "PART", 1000)
    parts = made(Samples(tmp_path / "s.parquet"), cut, 5.0, "accelerometer")
    np.testing.assert_array_equal(parts.windows, whole.windows)
    np.testing.assert_allclose(parts.values, whole.values, rtol=1e-13)
    for (function, *constants), values in zip(remembered, expected, strict=True):
        found = parts.channels.remembered(function, *constants)
        np.testing.assert_allclose(found, values, rtol=1e-9, atol=1e-12, err_msg=function.__name__)
