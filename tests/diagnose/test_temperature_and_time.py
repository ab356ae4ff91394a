"""A cause that is logged goes before time, a thermometer may be late, and a bias may jump once."""

import json

import numpy as np
import pytest

from bench.realistic.device import stream
from bench.realistic.judge import SENSORS, judge


def diagnose_device(seed, case, folder):
    """Return the outcome of a realistic device, its truth, and its effects at the poses."""
    made = judge(seed, case, folder)
    read = [
        json.loads((folder / f"{case}_{seed}" / name).read_text())
        for name in ("truth.json", "results/diagnosis.json")
    ]
    effects = {s: read[1]["sensors"][s]["poses"]["effects"] for s in SENSORS}
    for own in read[1]["sensors"].values():
        # partly explained means that it helps
        for residual in own["poses"]["residuals"].values() if own["poses"]["effects"] else ():
            assert residual["after"] < residual["before"]
    return made, read[0], effects


@pytest.mark.study
def test_a_temperature_that_only_rises_is_no_drift(no_limits, tmp_path):
    made, truth, effects = diagnose_device(19, "temperature", tmp_path)
    for (sensor, own), slopes in zip(effects.items(), truth["slopes"], strict=True):
        (effect,) = own
        assert (effect["name"], effect["constants"]["lag"]) == ("bias_temperature", 0.0)
        found = [effect["parameters"][f"c1{axis}"] for axis in "xyz"]
        np.testing.assert_allclose(found, slopes, rtol=0.1)
        # at other temperatures at the same time a drift is worse than no effect at all
        assert made["ratios"][sensor] < 0.2


@pytest.mark.study
def test_a_thermometer_that_is_late_gets_its_lag(no_limits, tmp_path):
    made, _, effects = diagnose_device(20, "thermometer_lag", tmp_path)
    # as the generator draws it, after start and span
    lag = stream(20, "temperature").uniform([18, 8, 10], [30, 20, 60])[2]
    for sensor, own in effects.items():
        (effect,) = own
        assert effect["name"] == "bias_temperature"
        assert effect["constants"]["lag"] == pytest.approx(lag, rel=0.2)
        assert made["ratios"][sensor] < 0.2


def test_a_bias_that_jumps_gets_its_step(no_limits, tmp_path):
    made, truth, effects = diagnose_device(16, "jump", tmp_path)
    (step,) = effects["accelerometer"]
    assert step["name"] == "steps"
    assert step["constants"]["times"] == pytest.approx([truth["jump_s"]], abs=0.5)
    sizes = [step["parameters"][f"h1{axis}"] for axis in "xyz"]
    np.testing.assert_allclose(sizes, truth["steps"][0], rtol=0.1, atol=2e-3)
    assert effects["gyroscope"] == [] and made["ratios"]["accelerometer"] < 0.2
    # a pose that may lie on either side of the step is predicted by nothing, and counts in no error
    verdicts = [made["verdicts"][sensor]["poses"] for sensor in SENSORS]
    assert verdicts == ["explained", "consistent"]
    assert "unexplained" not in made["verdicts"]["accelerometer"]["motion"]
