"""Power cycles: the bias jumps between power cycles, is named with its size, not as drift."""

from dataclasses import replace

import numpy as np
import pytest

import imuloop.effects  # noqa: F401  the library of effects
from bench.study.chain import LIMITS
from calibrate.devices import known_noise
from diagnose.models import pair_of, pose_result
from imuloop.calibrate.recording import record
from imuloop.core.samples import SENSORS
from imuloop.estimate.limits import detection_limits
from imuloop.model.calibration import Calibration
from imuloop.model.effect import find_effect
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import SessionTruth, example_truth
from imuloop.validate.drift import check_drift

# 1 mg and 0.11 deg/s
SIZE = {"accelerometer": 9.80665e-3, "gyroscope": np.radians(0.11)}
PLAN = SessionTruth("multi_position", poses=16, rest_s=(4.0, 4.0), move_s=(2.0, 2.0))
TRUTH = example_truth(sessions={"multi_position": PLAN}, rate=50.0)


def power_cycles(seed, number=3, size=1.0):
    """Return the recording of several power cycles, and the offset of each and sensor."""
    rng, samples, jumps = np.random.default_rng(seed), [], []
    for cycle in range(number):
        jump = {s: tuple(rng.normal(0, size * SIZE[s], 3)) for s in SENSORS}
        plan = replace(PLAN, turn_on=jump, seed=10 * seed + cycle)
        truth = replace(TRUTH, sessions={"multi_position": plan})
        samples.append(simulate_session(truth, "multi_position", 10 * seed + cycle))
        jumps.append(jump)
    segments = [segment_session(s, "multi_position", SegmentSettings())[0] for s in samples]
    return record(samples, segments, 30.0), jumps


@pytest.fixture(scope="module")
def cycles():
    recording, jumps = power_cycles(1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(LIMITS, lambda *a, **k: {"any": 0.0})
        return recording, jumps, pose_result(TRUTH, recording, folds=5)


@pytest.mark.parametrize("sensor", SENSORS)
def test_jumps_between_power_cycles_are_named_with_their_size(cycles, sensor):
    _, jumps, found = cycles
    content = found.contents[sensor]
    assert [e["name"] for e in content["effects"]] == ["turn_on_bias"]
    assert content["verdict"] == "explained"
    (effect,) = content["effects"]
    b = np.array([jump[sensor] for jump in jumps])
    true = (b - b.mean(axis=0))[1:].ravel() * getattr(TRUTH, sensor).K.mean()
    values = np.array(list(effect["parameters"].values()))
    score = (values - true) / np.array(list(effect["std"].values()))
    assert np.abs(score).max() < 4
    std, interval = find_effect("turn_on_bias")(3).repeatability(effect["parameters"])
    assert np.all((interval[0] < SIZE[sensor]) & (SIZE[sensor] < interval[1]))
    np.testing.assert_allclose(std, b.std(axis=0, ddof=1), rtol=0.3)


def test_scale_and_misalignment_are_as_good_as_of_one_run(cycles):
    recording, _, found = cycles
    pair = pair_of(TRUTH, recording)
    one, jumpy = (
        pair.calibrations(pair.fit(own))
        for own in (recording.select(recording.poses.power_cycle == 0), recording)
    )
    for sensor in SENSORS:
        all_, single, mixed = (c[sensor].std for c in (found.calibrations, one, jumpy))
        names = [name for name in single if name[0] in "TK"]
        assert all(all_[name] < 1.3 * single[name] for name in names)
        assert all(mixed[name] > 3 * all_[name] for name in names)


def test_power_cycles_of_one_bias_have_none(monkeypatch):
    def of_turn_on(search, base, trial, *how, **more):
        own = trial.effect.name == "turn_on_bias"
        return detection_limits(search, base, trial, *how, **more) if own else {}

    monkeypatch.setattr(LIMITS, of_turn_on)
    recording, _ = power_cycles(2, size=0.0)
    for content in pose_result(TRUTH, recording).contents.values():
        assert content["verdict"] == "consistent" and content["effects"] == []
        (candidate,) = (c for c in content["candidates"] if c["name"] == "turn_on_bias")
        assert candidate["status"] == "rejected" and candidate["detection_limit"]


def test_a_check_allows_for_what_the_power_cycles_showed(cycles):
    """No calibration knows the bias of the next power cycle; it moves by as much as the others."""
    *_, found = cycles
    sensors = (found.calibrations[s] for s in SENSORS)
    calibration = Calibration("d", TRUTH.gravity, *sensors)
    log, _ = power_cycles(7, number=1)
    assert not check_drift(calibration, log, known_noise(TRUTH)).drifted
    assert check_drift(calibration, log, known_noise(TRUTH), turn_on=(0.0, 0.0)).drifted
