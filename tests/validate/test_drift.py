"""The check of an old calibration: false alarms, power, and parameters that a log cannot test."""

from dataclasses import replace

import numpy as np
import pytest

from calibrate.devices import UNITS, in_counts, known_noise, plan_session, recording
from imuloop.calibrate.calibrate import calibrate_sensors
from imuloop.calibrate.recording import record
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.errors import ImuloopError
from imuloop.core.noise_model import AxisNoise
from imuloop.core.samples import ACCELERATION
from imuloop.effects.other_sensor import GSensitivity
from imuloop.model.calibration import Calibration
from imuloop.model.effect import FittedEffect
from imuloop.model.sensor_calibration import SensorCalibration
from imuloop.simulate.truth import Noise, example_truth
from imuloop.validate.drift import check_drift
from imuloop.validate.new_bias import update_biases
from seeds import least_count

# m/s^2 per count
SCALE = 0.0024
# a device that has not been switched off since
STEADY = (0.0, 0.0)
# of one switching on: what devices do, and what data sheets allow, m/s^2 and rad/s
ORDINARY, ALLOWED = (0.03, 1.75e-3), (0.196, 8.7e-3)


def white(truth, factor=1.0):
    """Return the device with white noise alone, of a size in its own."""
    for name in UNITS:
        noise = Noise(N=tuple(factor * np.array(getattr(truth, name).noise.N)))
        truth = replace(truth, **{name: replace(getattr(truth, name), noise=noise)})
    return truth


TRUTH = white(plan_session(example_truth(rate=25.0), poses=24, initial_rest_s=20.0))
NOISE = known_noise(TRUTH)


@pytest.fixture(scope="module")
def still_recording():
    return recording(white(TRUTH, 1e-3), 5)


def draw_noise(still, seed, force=None, turn=None, truth=TRUTH):
    """Return the recording with other noise; its raw values changed by force and turn."""
    rng, poses, rotations = np.random.default_rng(seed), still.poses, still.rotations

    def noisy(values, sensor, std, change):
        values = values if change is None else change(values)
        return values + rng.normal(size=values.shape) * sensor.noise.N * std

    mean, sample = 1 / np.sqrt(poses.duration_s)[:, None], np.sqrt(truth.rate)
    f = noisy(poses.f, truth.accelerometer, mean, force)
    w = noisy(poses.w, truth.gyroscope, mean, turn)
    turns = noisy(rotations.w, truth.gyroscope, sample, turn)
    return replace(still, poses=replace(poses, f=f, w=w), rotations=replace(rotations, w=turns))


def switched_on(scatter, seed):
    """Return what one switching on adds to force and rate, (2, 3)."""
    return np.random.default_rng([seed, 5]).normal(size=(2, 3)) * np.reshape(scatter, (2, 1))


@pytest.fixture(scope="module", params=[30, pytest.param(100, marks=pytest.mark.study)])
def calibrations(request, still_recording):
    logs = (draw_noise(still_recording, seed) for seed in range(request.param))
    how = NOISE, TRUTH.gravity, UNITS, CalibrateSettings()
    return [Calibration("d", TRUTH.gravity, **calibrate_sensors(log, *how)) for log in logs]


@pytest.mark.parametrize(
    ("scatter", "allowed"),
    [(STEADY, STEADY), (ORDINARY, None), (ALLOWED, None)],
    ids=["as it was", "switched on", "by the data sheet"],
)
def test_false_alarms_are_as_rare_as_the_level_says(
    still_recording, calibrations, scatter, allowed
):
    """Protects a device that was switched off in between: its biases move, nothing else does."""
    alarms = []
    for seed, calibration in enumerate(calibrations[:: 1 if allowed else 2]):
        force, turn = (lambda y, by=by: y + by for by in switched_on(scatter, seed))
        log = draw_noise(still_recording, 1000 + seed, force, turn)
        alarms.append(check_drift(calibration, log, NOISE, turn_on=allowed).drifted)
    # 5 % at most: Holm and the sharing make it fewer
    assert (allowed is not None) <= sum(alarms) <= least_count(len(alarms), 0.05, 0.995)


def far_bias(y):
    """Return raw values with a bias on y that no switching on makes."""
    return y + np.where(np.abs(y).max() > 9, [0, 1.5, 0], [0, 0.07, 0])


SKEW = np.array([[1, 0, 0], [3e-3, 1, 0], [0, 0, 1]])
# how raw values of force and rate change, what switching on scatters, and the parameters named
DRIFTS = {
    "as it was": (
        (
            lambda f: f / [1, 1, 1.002] + np.array([0.01, 0, 0]),
            lambda w: w + np.array([0, 1e-3, 0]),
        ),
        STEADY,
        ({"K2": 0.002, "b0": 0.01}, {"b1": 1e-3}),
    ),
    "scale": ((lambda y: y / [1, 1.003, 1],) * 2, ORDINARY, ({"K1": 0.003},) * 2),
    "misalignment": ((lambda y: y @ SKEW,) * 2, ORDINARY, ({"T01": -0.003},) * 2),
    "bias": ((far_bias,) * 2, ORDINARY, ({"b1": 1.5}, {"b1": 0.07})),
}


@pytest.mark.parametrize("drift", DRIFTS)
def test_a_drift_is_found_where_it_is(still_recording, calibrations, drift):
    """Protects the power for K and T, which do not change at turn-on, and for a bias far off."""
    changes, scatter, expected = DRIFTS[drift]
    steady, others = scatter == STEADY, 0
    count = 20 if steady else 5
    for seed, calibration in enumerate(calibrations[:count]):
        jumps = switched_on(scatter, seed)
        moved = [lambda y, c=c, by=by: c(y) + by for c, by in zip(changes, jumps, strict=True)]
        log = draw_noise(still_recording, 2000 + seed, *moved)
        result = check_drift(calibration, log, NOISE, turn_on=STEADY if steady else None)
        assert result.drifted and not result.bias_only == (drift != "bias")
        for sensor, true in zip(result.sensors.values(), expected, strict=True):
            names = {c.name for c in sensor.changes if c.drifted}
            assert names >= {*true}
            others += len(names - {*true})
            for change in (c for c in sensor.changes if c.name in true):
                assert abs(change.change - true[change.name]) < 5 * change.std
    assert not steady or others <= 2


def test_one_rest_shows_the_bias_along_gravity_and_the_gyroscope_s(still_recording, calibrations):
    log = draw_noise(still_recording, 8, lambda f: f + np.array([0, 0, 0.02]))
    upright = np.argmax(log.poses.f[:, 2])
    one = log.select(np.arange(len(log.poses)) == upright)
    result = check_drift(calibrations[0], one, NOISE, turn_on=STEADY)
    force, turn = result.sensors["accelerometer"], result.sensors["gyroscope"]
    assert [c.name.startswith("b along (") for c in force.changes] == [True]
    u = log.poses.f[upright] / np.linalg.norm(log.poses.f[upright])
    assert force.drifted and abs(force.changes[0].change - 0.02 * u[2]) < 5 * force.changes[0].std
    assert set(force.untested) == set(calibrations[0].accelerometer.names)
    assert {c.name for c in turn.changes} == {"b0", "b1", "b2"} and not turn.drifted
    assert "K0" in turn.untested and "1 rest(s)" in turn.why


def uncalibrated():
    return [SensorCalibration.nominal(unit, "none") for unit in UNITS.values()]


def test_what_was_never_calibrated_is_not_tested(still_recording, calibrations):
    log, bare = draw_noise(still_recording, 13), uncalibrated()
    drift = check_drift(replace(calibrations[0], accelerometer=bare[0]), log, NOISE)
    force, turn = drift.sensors.values()
    assert force.drifted is None and "estimated nothing" in force.why
    # without an accelerometer the direction of gravity is unknown: rests alone
    assert {c.name for c in turn.changes} == {"b0", "b1", "b2"} and not drift.drifted
    # nor is there one where the accelerometer of the new log is dead
    poses = replace(log.poses, f=0 * log.poses.f, variance=log.poses.variance * [0, 0, 0, 1, 1, 1])
    silent = replace(NOISE, axes=NOISE.axes | dict.fromkeys(ACCELERATION, AxisNoise()))
    dead = check_drift(calibrations[0], replace(log, poses=poses), silent)
    assert "noise is not known" in dead.sensors["accelerometer"].why
    assert dead.sensors["gyroscope"].dof == 3 and not dead.drifted
    with pytest.raises(ImuloopError, match=r"nothing can be tested: accelerometer: .*gyroscope: "):
        check_drift(Calibration("d", 9.8, *bare), still_recording, NOISE)
    with pytest.raises(ImuloopError, match=r"no bias can be updated: accelerometer: .*gyroscope: "):
        update_biases(Calibration("d", 9.8, *bare), still_recording, NOISE, "log")
    with pytest.raises(ImuloopError, match="no rest"):
        check_drift(calibrations[0], record([], [], 30.0), NOISE)


# of one switching on, m/s^2 and rad/s: tens of standard errors
JUMP = {"accelerometer": np.array([0.08, -0.05, 0.06]), "gyroscope": np.array([2e-3, -1e-3, 3e-3])}


def jumped(still, seed, truth=TRUTH):
    """Return a recording after the biases have moved by `JUMP`."""
    return draw_noise(still, seed, *(lambda y, by=by: y + by for by in JUMP.values()), truth)


def parameters(sensor, names):
    return np.array([getattr(sensor, n[0])[tuple(map(int, n[1:]))] for n in names])


@pytest.mark.parametrize("rests", ["all", "few to one side"])
def test_new_biases_are_as_near_the_truth_as_their_covariance_says(
    still_recording, calibrations, rests
):
    """Protects the bias and its errors: noise of the new log, and what T and K leave.

    In few rests to one side, a hundred times as long, the errors of T and K are errors of the bias.
    """
    truth, keep = TRUTH, np.ones(len(still_recording.poses), dtype=bool)
    if rests != "all":
        keep, truth = still_recording.poses.f @ [1, 1, 1] > 0.7 * TRUTH.gravity, white(TRUTH, 0.1)
        assert 3 < keep.sum() < 10
    pulls, joint, noise = {s: [] for s in JUMP}, {s: [] for s in JUMP}, known_noise(truth)
    for seed, old in enumerate(calibrations):
        log = jumped(still_recording, 3000 + seed, truth).select(keep)
        new = update_biases(old, log, noise, "log")[0]
        for name, jump in JUMP.items():
            sensor = getattr(new, name)
            error = parameters(sensor, sensor.names) - parameters(
                getattr(truth, name), sensor.names
            )
            error[-3:] -= jump
            pulls[name].append(error[-3:] / [sensor.std[f"b{k}"] for k in range(3)])
            joint[name].append(error @ np.linalg.solve(sensor.covariance, error) / len(error))
    for name, off in pulls.items():
        assert np.mean(np.abs(off) < 3) > 0.97 and np.abs(off).max() < 4.5
        assert abs(np.sqrt(np.mean(np.square(off))) - 1) < 2.5 / np.sqrt(2 * len(off))
        count = len(getattr(new, name).names) * len(off)
        assert abs(np.mean(joint[name]) - 1) < 4 * np.sqrt(2 / count)


def test_nothing_but_the_biases_changes(still_recording, calibrations):
    """Protects T, K, the effects and their covariance, to the last bit, in SI and in counts."""
    values = {name: 1e-5 for name in GSensitivity().parameters}
    effect = FittedEffect(GSensitivity(), values, dict.fromkeys(values, 1e-6))
    log, old, updated = jumped(still_recording, 11), calibrations[0], []
    old = replace(old, gyroscope=replace(old.gyroscope, effects=(effect,)))
    for calibration in (old, replace(old, accelerometer=in_counts(old.accelerometer, SCALE))):
        new, kept = update_biases(calibration, log, NOISE, "new.csv")
        assert not kept and new.updated == dict.fromkeys(JUMP, "new.csv")
        updated.append(new)
        for sensor in JUMP:
            one, other = (getattr(c, sensor) for c in (calibration, new))
            assert one.T.tobytes() == other.T.tobytes() and one.K.tobytes() == other.K.tobytes()
            assert one.effects == other.effects and one.names == other.names
            k = len(one.names) - 3
            assert one.covariance[:k, :k].tobytes() == other.covariance[:k, :k].tobytes()
            assert not np.any(one.b == other.b)
    si, counts = (calibration.accelerometer for calibration in updated)
    np.testing.assert_allclose(counts.raw_unit.to_si(counts.b), si.b, rtol=1e-9, atol=1e-9)
    std = [counts.std[f"b{k}"] * SCALE for k in range(3)]
    np.testing.assert_allclose(std, [si.std[f"b{k}"] for k in range(3)], rtol=1e-6)
    # the effect stays in the effect: the bias is the rest of the rate
    without = update_biases(calibrations[0], log, NOISE, "new.csv")[0].gyroscope
    assert np.abs(updated[0].gyroscope.b - without.b).max() > 1e-7


def test_a_bias_that_the_log_does_not_determine_stays(still_recording, calibrations):
    """Protects an accelerometer from the one or two attitudes of a short log."""
    log, old = jumped(still_recording, 12), calibrations[0]
    f = log.poses.f / np.linalg.norm(log.poses.f, axis=1, keepdims=True)
    near = f @ f[0] > 0.999
    for keep in (np.arange(len(f)) == 0, near | (np.arange(len(f)) == np.argmin(f @ f[0]))):
        new, kept = update_biases(old, log.select(keep), NOISE, "log")
        assert set(kept) == {"accelerometer"} and "three or more" in kept["accelerometer"]
        assert new.accelerometer is old.accelerometer
        assert new.updated == {"gyroscope": "log"}
        std = [new.gyroscope.std[f"b{k}"] for k in range(3)]
        error = new.gyroscope.b - TRUTH.gyroscope.b - JUMP["gyroscope"]
        assert np.all(np.abs(error) < 4 * np.array(std))
