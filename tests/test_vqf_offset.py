"""bench/vqf_offset: an offset that is known lowers the filter's error, and only with its sign."""

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation, RotationSpline

pytest.importorskip("vqf", reason="the package vqf is not installed")
from bench.vqf_offset import TRIALS, before_and_after, inclination, offset, report

RATE, LATE = 200.0, 0.006


@pytest.fixture(scope="module")
def trial():
    """A sensor turned for a minute, its stamps `LATE`, the reference not seen for half a second."""
    t = np.arange(0, 60, 1 / RATE)
    knots = np.arange(-1, 62, 0.5)
    angles = np.random.default_rng(5).normal(0, 0.6, (len(knots), 3))
    true = RotationSpline(knots, Rotation.from_rotvec(angles))
    at = true(t - LATE)
    quaternions = true(t).as_quat(scalar_first=True)
    quaternions[4000:4100] = np.nan
    return {
        "sampling_rate": np.array([[RATE]]),
        "imu_gyr": true(t - LATE, 1),
        "imu_acc": at.inv().apply([0, 0, 9.81]),
        "imu_mag": at.inv().apply([0, 20.0, -45.0]),
        "opt_quat": quaternions,
        "movement": (t > 5).astype(np.uint8)[:, None],
    }


def test_a_known_offset_lowers_the_error(trial):
    before, offset_alone, both, opposite = before_and_after(trial, -LATE)
    assert both < offset_alone < before < opposite
    # what is left is the filter's own
    assert both < 0.2 * before


def test_the_filter_is_half_a_period_ahead(trial):
    errors = {part: before_and_after(trial, part / RATE - LATE)[1] for part in (0.25, 0.5, 0.75)}
    assert min(errors, key=errors.get) == 0.5


def test_inclination_ignores_the_heading():
    estimated = Rotation.from_euler("zx", [[40, 3], [-70, 3]], degrees=True)
    assert inclination(estimated, Rotation.identity(2)) == pytest.approx(3)


def test_worse_and_missing_trials_are_named():
    diagnosis = {"name": "time_offset", "parameters": {"dt": -0.004}}
    dt = offset({"sensors": {"gyroscope": {"reference": {"effects": [diagnosis]}}}})
    errors = {"01_a": [0.5, 0.4, 0.3, 0.7], "02_b": [0.3, 0.5, 0.2, 0.4]}
    text = report(dt, errors, ["03", "39"])
    assert "-4.00 ms" in text and "| mean | 0.400 | 0.450 | 0.250 | 0.550 |" in text
    assert "offset: better in 1 of 2; worse: 02_b." in text
    assert "half a period: better in 2 of 2; worse: none." in text and "2 (03 39)" in text


def test_trials_that_the_offset_is_from_are_not_judged(repository):
    config = yaml.safe_load((repository / "config/reference.yaml").read_text())
    sessions = config["devices"]["broad"]["sessions"].values()
    seen = {each["file"]["url"].rpartition("/")[2] for each in sessions}
    assert len(seen) == 3 and len(TRIALS) == 39 and seen <= {f"{name}.mat" for name in TRIALS}
