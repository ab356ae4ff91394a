"""Means of a static record: choice of the windows, columns of an effect in them."""

import numpy as np
import pandas as pd

from imuloop.calibrate.recording import Log
from imuloop.core.samples import CHANNELS
from imuloop.core.units import RawUnit
from imuloop.diagnose.static_means import rests_to_use, static_records
from imuloop.model.calibration import Calibration
from imuloop.model.sensor_calibration import SensorCalibration


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


def test_windows_hold_means_of_the_output_and_lie_whole_in_undisturbed_stretches():
    samples = log()
    found = static_records("s", Log.of(samples), CUT, calibration(2.0), 20.0)["gyroscope"]
    seen = found.channels.evaluate(lambda whole: whole.other * whole.t[:, None])
    assert not np.any((found.windows[:, 1] > 1190) & (found.windows[:, 0] < 1210))
    assert list(np.unique(found.stretch, return_counts=True)[1]) == [59, 59]
    for k in (0, 58, 59, 117):
        start, end = found.windows[k]
        within = samples[(samples.t >= start) & (samples.t < end)]
        raw, force = within[["gx", "gy", "gz"]].mean(), within[["ax", "ay", "az"]]
        np.testing.assert_allclose(found.values[k], 2 * (raw - 0.5), rtol=1e-12)
        # a function of the log is averaged, not taken of means
        np.testing.assert_allclose(seen[k], force.mul(within.t, axis=0).mean(), rtol=1e-11)
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
