"""Beside a reference: what nobody declared is found, with its size, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.study.reference import base, diagnosed

SEED = 12170
QUATERNION = ["qw", "qx", "qy", "qz"]


def found(diagnosis):
    return {
        sensor: {e["name"]: e for e in parts["reference"]["effects"]}
        for sensor, parts in diagnosis["sensors"].items()
    }


def off(effect, truth):
    pairs = zip(effect["parameters"].values(), effect["std"].values(), truth, strict=True)
    return [abs(value - true) / std for value, std, true in pairs]


def test_offset_drift_and_arm_are_found_alone_and_in_size():
    # late all along: an offset that drift takes through zero is no offset, alone
    own = {"gyroscope": -0.009, "accelerometer": 0.003}
    truth = replace(base(SEED), dt=own, drift=1e-4, arm=(0.02, -0.015, 0.03))
    diagnosis, _, calibration = diagnosed(truth, SEED, limits=False)
    effects = found(diagnosis)
    assert set(effects["gyroscope"]) == {"time_offset", "clock_drift"}
    assert set(effects["accelerometer"]) == {"time_offset", "lever_arm"}
    assert max(off(effects["gyroscope"]["time_offset"], [-0.009])) < 3
    assert max(off(effects["gyroscope"]["clock_drift"], [1e-4])) < 3
    assert max(off(effects["accelerometer"]["time_offset"], [0.003])) < 3
    assert max(off(effects["accelerometer"]["lever_arm"], truth.arm)) < 3.5
    # where a marker sits is nothing of the sensor's
    assert not calibration.effects
    for sensor in effects:
        of = getattr(calibration, sensor)
        assert of.method == "reference_motion"
        errors = [(of.K[k] - truth.K[sensor][k]) / of.std[f"K{k}"] for k in range(3)]
        assert np.abs(errors).max() < 3.5
    # over longer times errors grow, and effects make them less
    table = diagnosis["sensors"]["gyroscope"]["reference"]["by_duration"]
    assert [row["seconds"] for row in table] == [0.1, 0.3, 1.0, 3.0, 10.0]
    for row in table[2:]:
        sizes = [row[k]["rotation"] for k in ("logged", "calibrated", "final", "floor")]
        assert sizes == sorted(sizes, reverse=True)
        assert row["final"]["vertical"] < row["final"]["rotation"]
    series = diagnosis["sensors"]["gyroscope"]["reference"]["series"]
    assert series["t_s"][-1] - series["t_s"][0] == pytest.approx(10.0, abs=0.1)
    for vertical in ("reference", "sensor"):
        np.testing.assert_allclose(np.linalg.norm(series[vertical], axis=1), 1, atol=1e-5)
    apart = np.linalg.norm(np.subtract(series["reference"], series["sensor"]), axis=1)
    assert (apart <= np.array(series["final"]) + 1e-5).all()
    means = [np.mean(np.square(series[k])) for k in ("logged", "calibrated", "final")]
    assert means == sorted(means, reverse=True)


def test_device_without_effects_is_consistent():
    # one of forty devices is above its floor by chance, as that of SEED
    diagnosis, *_ = diagnosed(base(SEED + 1), SEED + 1, limits=False)
    for sensor, parts in diagnosis["sensors"].items():
        assert parts["reference"]["verdict"] == "consistent", sensor


def test_what_a_reference_gets_wrong_with_attitude_is_no_effect():
    def harm(columns):
        q = np.column_stack([columns[k] for k in ("qx", "qy", "qz", "qw")])
        known = np.isfinite(q[:, 0])
        attitude = Rotation.from_quat(q[known])
        u = attitude.as_matrix().reshape(-1, 9)
        # half a degree that goes with the attitude, as where other markers are seen
        pattern = np.random.default_rng(5).normal(size=(9, 3))
        error = np.radians(0.5) * np.sin(2.5 * u @ pattern)
        q[known] = (attitude * Rotation.from_rotvec(error)).as_quat()
        return columns | dict(zip(("qx", "qy", "qz", "qw"), q.T, strict=True))

    diagnosis, *_ = diagnosed(base(SEED), SEED, limits=False, change=harm)
    effects = found(diagnosis)
    assert effects == {"accelerometer": {}, "gyroscope": {}}
    verdict = diagnosis["sensors"]["gyroscope"]["reference"]["verdict"]
    assert verdict == "unexplained"


@pytest.mark.parametrize(("clock", "drift"), [((3.0, 0.0), 0.0), ((0.0, 5e-4), 5e-4)])
def test_clock_of_its_own_is_handled_or_named(clock, drift):
    diagnosis, quality, _ = diagnosed(replace(base(SEED), clock=clock), SEED, limits=False)
    effects = found(diagnosis)["gyroscope"]
    assert quality["reference"]["clock"]["own"] == bool(clock[0])
    assert ("clock_drift" in effects) == bool(drift)
    if drift:
        assert max(off(effects["clock_drift"], [drift])) < 3
