"""The calibration model, its file, and effects, by hand-made numbers."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import imuloop.effects  # noqa: F401  the library of effects
from imuloop.core.effect import FittedEffect, find_effect
from imuloop.core.errors import ImuloopError
from imuloop.core.model import Calibration, SensorCalibration
from imuloop.core.samples import CHANNELS
from imuloop.core.units import RawUnit

COUNTS = RawUnit("count", 0.0024, 32768.0)


def sensor(**changes):
    made = SensorCalibration(
        RawUnit("rad/s", 1.0),
        np.eye(3),
        np.ones(3),
        np.zeros(3),
        names=("b0",),
        covariance=np.array([[4e-8]]),
        method="static",
        not_testable="no rotation",
    )
    return replace(made, **changes)


def log(n=5):
    values = np.random.default_rng(1).normal(size=(n, 6))
    return pd.DataFrame({"t": np.arange(n) / 10, **dict(zip(CHANNELS, values.T, strict=True))})


def test_the_file_gives_back_what_was_written(tmp_path):
    names = find_effect("g_sensitivity").parameters
    values, std = dict.fromkeys(names, 1e-4), dict.fromkeys(names, 1e-6)
    effect = FittedEffect(find_effect("g_sensitivity")(), values, std)
    calibration = Calibration(
        "d", 9.80665, SensorCalibration.nominal(COUNTS, "why"), sensor(effects=(effect,))
    )
    calibration.to_json(tmp_path / "c.json")
    back = Calibration.from_json(tmp_path / "c.json")
    back.to_json(tmp_path / "again.json")
    assert (tmp_path / "c.json").read_bytes() == (tmp_path / "again.json").read_bytes()
    assert back.gyroscope.effects == (effect,)
    assert back.gyroscope.std == {"b0": pytest.approx(2e-4)}
    assert back.accelerometer.raw_unit == COUNTS
    content = json.loads((tmp_path / "c.json").read_text())
    assert list(content)[:3] == ["format", "device", "gravity"]
    assert {"raw_unit", "T", "K", "b", "covariance", "effects"} <= set(content["gyroscope"])


@pytest.mark.parametrize("way", ["apply", "apply_arrays"])
def test_what_would_not_be_finite_is_refused(way):
    """The product is larger than any float; of what is not finite as logged nothing is asked."""
    names = find_effect("g_sensitivity").parameters
    effect = FittedEffect(find_effect("g_sensitivity")(), dict.fromkeys(names, 1e308), {})
    nominal = SensorCalibration.nominal(RawUnit("m/s^2", 1.0), "nothing known")
    made, samples = Calibration("d", 9.81, nominal, sensor(effects=(effect,))), log()
    f, w = samples[["ax", "ay", "az"]] * 100, samples[["gx", "gy", "gz"]]
    samples[["ax", "ay", "az"]] = f
    with pytest.raises(ImuloopError, match=r"gyroscope.* not finite .* t = 0 s"):
        made.apply(samples) if way == "apply" else made.apply_arrays(f, w)
    samples.loc[2, "gy"] = np.nan
    same = Calibration("d", 9.81, nominal, sensor()).apply(samples)
    assert same["gy"].isna().tolist() == [False, False, True, False, False]
