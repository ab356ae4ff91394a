"""The calibration model, its file, and effects, by hand-made numbers."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import imuloop.effects  # noqa: F401  the library of effects
from imuloop.core.errors import ImuloopError
from imuloop.core.samples import CHANNELS
from imuloop.core.units import RawUnit
from imuloop.model.calibration import OF_ONE_LOG, Calibration
from imuloop.model.calibration_faults import implausible_values
from imuloop.model.effect import FittedEffect, find_effect
from imuloop.model.sensor_calibration import SensorCalibration

COUNTS = RawUnit("count", 0.0024, 32768.0)


def sensor(**changes):
    gyroscope = SensorCalibration(
        RawUnit("rad/s", 1.0),
        np.eye(3),
        np.ones(3),
        np.zeros(3),
        names=("b0",),
        covariance=np.array([[4e-8]]),
        method="static",
        not_testable="no rotation",
    )
    return replace(gyroscope, **changes)


def log(n=5):
    values = np.random.default_rng(1).normal(size=(n, 6))
    return pd.DataFrame({"t": np.arange(n) / 10, **dict(zip(CHANNELS, values.T, strict=True))})


def test_the_file_gives_back_what_was_written(tmp_path):
    names = find_effect("g_sensitivity").parameters
    values, std = dict.fromkeys(names, 1e-4), dict.fromkeys(names, 1e-6)
    effect = FittedEffect(find_effect("g_sensitivity")(), values, std)
    turn = sensor(effects=(effect,), verdict="unexplained")
    calibration = Calibration("d", 9.80665, SensorCalibration.nominal(COUNTS, "why"), turn)
    calibration.to_json(tmp_path / "c.json")
    back = Calibration.from_json(tmp_path / "c.json")
    back.to_json(tmp_path / "again.json")
    assert (tmp_path / "c.json").read_bytes() == (tmp_path / "again.json").read_bytes()
    assert back.gyroscope.effects == (effect,) and back.gyroscope.verdict == "unexplained"
    assert back.gyroscope.std == {"b0": pytest.approx(2e-4)}
    assert back.accelerometer.raw_unit == COUNTS
    content = json.loads((tmp_path / "c.json").read_text())
    assert list(content)[:3] == ["format", "device", "gravity"]
    assert {"raw_unit", "T", "K", "b", "covariance", "effects"} <= set(content["gyroscope"])
    # files of before have no verdict
    del content["gyroscope"]["verdict"]
    (tmp_path / "c.json").write_text(json.dumps(content))
    assert Calibration.from_json(tmp_path / "c.json").gyroscope.verdict is None


def test_what_was_not_measured_is_applied_only_when_it_is_asked_for(tmp_path):
    """A calibration of a rejected log holds the data sheet's numbers: no way of applying takes it.

    Protects the refusal in each way: without it samples as logged come out marked as calibrated.
    One sensor that was measured is enough, and numbers that were measured may be the nominal ones.
    """
    unit, samples = RawUnit("m/s^2", 1.0), log()
    nominal = SensorCalibration.nominal(unit, "no session could be used")
    empty, f = Calibration("d", 9.81, nominal, nominal), samples[["ax", "ay", "az"]]
    samples.to_parquet(tmp_path / "samples.parquet")
    ways = (
        lambda calibration, **how: calibration.apply(samples, **how)[["ax", "ay", "az"]],
        lambda calibration, **how: calibration.apply_arrays(f, f, **how)[0],
        lambda calibration, **how: (
            calibration.apply_file(tmp_path / "samples.parquet", tmp_path / "out.parquet", **how)
            or pd.read_parquet(tmp_path / "out.parquet")[["ax", "ay", "az"]]
        ),
    )
    for way in ways:
        with pytest.raises(ImuloopError, match=r"nominal.*no session could be used.*nominal=True"):
            way(empty)
        np.testing.assert_allclose(way(empty, nominal=True), f)
        for measured in (sensor(), replace(nominal, method="multi_position"), sensor(names=())):
            way(replace(empty, gyroscope=measured))
    # there is nothing that could be unexplained
    doubted = replace(empty, gyroscope=replace(nominal, verdict="unexplained"))
    assert not doubted.measured and doubted.limits() == empty.limits()
    assert not empty.measured and replace(empty, accelerometer=sensor()).measured


def test_a_step_is_said_to_be_of_the_calibrated_log():
    """Protects who applies a calibration to a later log, which has no step at that time."""
    step = FittedEffect(find_effect("steps")((100.0,)), {f"h1{a}": 0.1 for a in "xyz"}, {})
    warm = FittedEffect(find_effect("bias_temperature")(), {f"c1{a}": 1e-3 for a in "xyz"}, {})
    force, turn = (sensor(not_testable=None, effects=e) for e in ((step, warm), (warm,)))
    calibration = Calibration("d", 9.81, force, turn)
    assert calibration.limits() == [f"accelerometer: steps {OF_ONE_LOG}"]


@pytest.mark.parametrize("way", ["apply", "apply_arrays"])
def test_what_would_not_be_finite_is_refused(way):
    """The product is larger than any float; samples that are not finite in the log are exempt."""
    names = find_effect("g_sensitivity").parameters
    effect = FittedEffect(find_effect("g_sensitivity")(), dict.fromkeys(names, 1e308), {})
    nominal = SensorCalibration.nominal(RawUnit("m/s^2", 1.0), "nothing known")
    calibration, samples = Calibration("d", 9.81, nominal, sensor(effects=(effect,))), log()
    f, w = samples[["ax", "ay", "az"]] * 100, samples[["gx", "gy", "gz"]]
    samples[["ax", "ay", "az"]] = f
    with pytest.raises(ImuloopError, match=r"gyroscope.* not finite .* t = 0 s"):
        calibration.apply(samples) if way == "apply" else calibration.apply_arrays(f, w)
    samples.loc[2, "gy"] = np.nan
    same = Calibration("d", 9.81, nominal, sensor()).apply(samples)
    assert same["gy"].isna().tolist() == [False, False, True, False, False]


@pytest.mark.parametrize(
    ("sensor", "scale", "bias", "text"),
    [
        ("accelerometer", 1.15, 4.5, None),
        ("accelerometer", 0.75, 0.0, "K of x is 0.75 times nominal"),
        ("accelerometer", 1.0, -5.5, "the bias of x is -5.5 m/s²"),
        ("gyroscope", 0.85, -1.3, None),
        ("gyroscope", 2.04, 0.0, "K of x is 2.04 times nominal"),
        ("gyroscope", 1.0, 2.2, "the bias of x is 2.2 rad/s"),
    ],
)
@pytest.mark.parametrize("unit", [RawUnit("count", 1e-3, 500.0), RawUnit("mrad/s", 1e-3)])
def test_what_no_sensor_has_is_named_in_any_unit(sensor, scale, bias, text, unit):
    """Protects a good sensor from being doubted, and a user from the fit of a log that is wrong."""
    scales, offsets = np.array([scale, 1, 1]), np.array([bias, 0, 0])
    fitted = SensorCalibration(unit, np.eye(3), scales * unit.scale, offsets / unit.scale)
    line = implausible_values(replace(fitted, b=fitted.b + unit.offset), sensor)
    assert (line is None) if text is None else line.startswith(text)
