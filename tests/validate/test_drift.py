"""The check of an old calibration: false alarms, power, and parameters that a log cannot test."""

from dataclasses import replace

import numpy as np
import pytest

from calibrate.devices import ACCELERATION_UNIT, RATE_UNIT, known_noise, plan_session, recording
from imuloop.calibrate.calibrate import calibrate_sensors
from imuloop.calibrate.recording import record
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.errors import ImuloopError
from imuloop.core.noise_model import AxisNoise
from imuloop.core.samples import ACCELERATION
from imuloop.core.units import RawUnit
from imuloop.effects.other_sensor import GSensitivity
from imuloop.model.calibration import Calibration
from imuloop.model.effect import FittedEffect
from imuloop.model.raw_units import state_of
from imuloop.model.sensor_calibration import SensorCalibration
from imuloop.simulate.truth import Noise, example_truth
from imuloop.validate.drift import check_drift
from imuloop.validate.new_bias import update_biases
from seeds import least_count

# a device that has not been switched off since
STEADY = (0.0, 0.0)
# of one switching on: what devices do, and what data sheets allow, m/s^2 and rad/s
ORDINARY, ALLOWED = (0.03, 1.75e-3), (0.196, 8.7e-3)


def white(sensor):
    return replace(sensor, noise=Noise(N=sensor.noise.N))


@pytest.fixture(scope="module")
def truth():
    made = plan_session(example_truth(rate=25.0), poses=24, initial_rest_s=20.0)
    return replace(made, accelerometer=white(made.accelerometer), gyroscope=white(made.gyroscope))


@pytest.fixture(scope="module")
def noise(truth):
    return known_noise(truth)


@pytest.fixture(scope="module")
def still_recording(truth):
    quiet = [
        replace(s, noise=Noise(N=tuple(1e-3 * np.array(s.noise.N))))
        for s in (truth.accelerometer, truth.gyroscope)
    ]
    return recording(replace(truth, accelerometer=quiet[0], gyroscope=quiet[1]), 5)


def draw_noise(still, truth, seed, force=None, turn=None):
    """Return the recording with other noise; its raw values changed by force and turn."""
    rng, poses, rotations = np.random.default_rng(seed), still.poses, still.rotations

    def noisy(values, sensor, std, change):
        values = values if change is None else change(values)
        return values + rng.normal(size=values.shape) * sensor.noise.N * std

    mean, sample = 1 / np.sqrt(poses.duration_s)[:, None], np.sqrt(truth.rate)
    return replace(
        still,
        poses=replace(
            poses,
            f=noisy(poses.f, truth.accelerometer, mean, force),
            w=noisy(poses.w, truth.gyroscope, mean, turn),
        ),
        rotations=replace(rotations, w=noisy(rotations.w, truth.gyroscope, sample, turn)),
    )


def calibration_of(made, noise, truth):
    units = {"accelerometer": ACCELERATION_UNIT, "gyroscope": RATE_UNIT}
    sensors = calibrate_sensors(made, noise, truth.gravity, units, CalibrateSettings())
    return Calibration("d", truth.gravity, **sensors)


@pytest.fixture(scope="module", params=[30, pytest.param(100, marks=pytest.mark.study)])
def calibrations(request, still_recording, truth, noise):
    return [
        calibration_of(draw_noise(still_recording, truth, seed), noise, truth)
        for seed in range(request.param)
    ]


@pytest.fixture(scope="module")
def unchanged_checks(still_recording, truth, noise, calibrations):
    """The check of each calibration on a log of the same device."""
    return [
        check_drift(each, draw_noise(still_recording, truth, 1000 + seed), noise, turn_on=STEADY)
        for seed, each in enumerate(calibrations)
    ]


def test_false_alarms_are_as_rare_as_the_level_says(unchanged_checks):
    # 5 % at most: Holm and the sharing make it fewer
    assert (
        1
        <= sum(drift.drifted for drift in unchanged_checks)
        <= least_count(len(unchanged_checks), 0.05, 0.995)
    )


def moved_force(values):
    return values / [1, 1, 1.002] + np.array([0.01, 0, 0])


def moved_turn(values):
    return values + np.array([0, 1e-3, 0])


def test_a_drift_is_found_where_it_is_and_nowhere_else(still_recording, truth, noise, calibrations):
    found, others = [], 0
    for seed, each in enumerate(calibrations[:20]):
        log = draw_noise(still_recording, truth, 2000 + seed, moved_force, moved_turn)
        drift = check_drift(each, log, noise, turn_on=STEADY)
        assert drift.drifted and not drift.bias_only
        names = {n: {c.name for c in s.changes if c.drifted} for n, s in drift.sensors.items()}
        found.append(names["accelerometer"] >= {"K2", "b0"} and "b1" in names["gyroscope"])
        others += sum(map(len, names.values())) - 3
        changes = {c.name: c for c in drift.sensors["accelerometer"].changes}
        assert abs(changes["b0"].change - 0.01) < 5 * changes["b0"].std
        assert abs(changes["K2"].change - 0.002) < 5 * changes["K2"].std
    assert all(found) and others <= 2


@pytest.mark.parametrize("scatter", [ORDINARY, ALLOWED], ids=["ordinary", "data sheet"])
def test_scatter_from_switching_on_is_no_drift(
    still_recording, truth, noise, calibrations, scatter
):
    """Protects a device that was switched off in between: its biases move, nothing else does."""
    found = []
    for seed, each in enumerate(calibrations[::2]):
        jump = np.random.default_rng([seed, 5]).normal(size=(2, 3)) * np.reshape(scatter, (2, 1))
        change = [lambda y, by=by: y + by for by in jump]
        found.append(
            check_drift(
                each, draw_noise(still_recording, truth, 4000 + seed, *change), noise
            ).drifted
        )
    assert sum(found) <= least_count(len(found), 0.05, 0.995)


# factors and additions by which raw values of both sensors change, and the parameter it is
REAL = {
    "scale": (lambda y: y / [1, 1.003, 1], "K1"),
    "misalignment": (lambda y: y @ [[1, 0, 0], [3e-3, 1, 0], [0, 0, 1]], "T01"),
    "bias": (lambda y: y + np.where(np.abs(y).max() > 9, [0, 1.5, 0], [0, 0.07, 0]), "b1"),
}


@pytest.mark.parametrize(("change", "name"), REAL.values(), ids=REAL)
def test_drift_is_found_beyond_the_scatter_from_switching_on(
    still_recording, truth, noise, calibrations, change, name
):
    """Protects the power for K and T, which do not change at turn-on, and for a bias far off."""
    rng = np.random.default_rng(6)
    for seed, each in enumerate(calibrations[:5]):
        jump = rng.normal(size=(2, 3)) * np.reshape(ORDINARY, (2, 1))
        changes = [lambda y, by=by: change(y) + by for by in jump]
        drift = check_drift(each, draw_noise(still_recording, truth, 5000 + seed, *changes), noise)
        for sensor in drift.sensors.values():
            assert name in {c.name for c in sensor.changes if c.drifted}


def test_one_rest_shows_the_bias_along_gravity_and_the_gyroscope_s(
    still_recording, truth, noise, calibrations
):
    made = draw_noise(still_recording, truth, 8, lambda f: f + np.array([0, 0, 0.02]))
    upright = np.argmax(made.poses.f[:, 2])
    one = made.select(np.arange(len(made.poses)) == upright)
    found = check_drift(calibrations[0], one, noise, turn_on=STEADY)
    force, turn = found.sensors["accelerometer"], found.sensors["gyroscope"]
    assert [c.name.startswith("b along (") for c in force.changes] == [True]
    u = made.poses.f[upright] / np.linalg.norm(made.poses.f[upright])
    assert force.drifted and abs(force.changes[0].change - 0.02 * u[2]) < 5 * force.changes[0].std
    assert set(force.untested) == set(calibrations[0].accelerometer.names)
    assert {c.name for c in turn.changes} == {"b0", "b1", "b2"} and not turn.drifted
    assert "K0" in turn.untested and "1 rest(s)" in turn.why


COUNTS = RawUnit("count", 0.0024, 32768.0)


def in_counts(calibration):
    force, factor = calibration.accelerometer, np.ones(9)
    factor[3:6], factor[6:] = COUNTS.scale, 1 / COUNTS.scale
    force = replace(
        force,
        raw_unit=COUNTS,
        K=force.K * COUNTS.scale,
        b=COUNTS.from_si(force.b),
        covariance=force.covariance * np.outer(factor, factor),
    )
    return replace(calibration, accelerometer=force)


def test_what_was_never_calibrated_is_not_tested(still_recording, truth, noise, calibrations):
    bare = SensorCalibration.nominal(ACCELERATION_UNIT, "no poses")
    drift = check_drift(
        replace(calibrations[0], accelerometer=bare), draw_noise(still_recording, truth, 13), noise
    )
    force, turn = drift.sensors.values()
    assert force.drifted is None and "estimated nothing" in force.why
    # without an accelerometer the direction of gravity is unknown: rests alone
    assert {c.name for c in turn.changes} == {"b0", "b1", "b2"} and not drift.drifted
    # nor is there one where the accelerometer of the new log is dead
    log = draw_noise(still_recording, truth, 13)
    poses = replace(log.poses, f=0 * log.poses.f, variance=log.poses.variance * [0, 0, 0, 1, 1, 1])
    silent = replace(noise, axes=noise.axes | dict.fromkeys(ACCELERATION, AxisNoise()))
    dead = check_drift(calibrations[0], replace(log, poses=poses), silent)
    assert "noise is not known" in dead.sensors["accelerometer"].why
    assert dead.sensors["gyroscope"].dof == 3 and not dead.drifted
    bare = [SensorCalibration.nominal(u, "none") for u in (ACCELERATION_UNIT, RATE_UNIT)]
    with pytest.raises(ImuloopError, match=r"nothing can be tested: accelerometer: .*gyroscope: "):
        check_drift(Calibration("d", 9.8, *bare), still_recording, noise)
    with pytest.raises(ImuloopError, match="no rest"):
        check_drift(calibrations[0], record([], [], 30.0), noise)


# of one switching on, m/s^2 and rad/s: tens of standard errors
JUMP = {
    "accelerometer": np.array([0.08, -0.05, 0.06]),
    "gyroscope": np.array([2e-3, -1e-3, 3e-3]),
}


def switched_on(still, truth, seed):
    """Return a recording after the biases have moved by `JUMP`."""
    force, turn = (lambda y, by=by: y + by for by in JUMP.values())
    return draw_noise(still, truth, seed, force, turn)


@pytest.fixture(scope="module", params=["all rests", "few to one side"])
def updated_biases(request, still_recording, truth, noise, calibrations):
    """Each calibration with the biases of a log after they have moved.

    In few rests to one side, a hundred times as long, the errors of T and K are errors of the bias.
    """
    keep = np.ones(len(still_recording.poses), dtype=bool)
    if request.param == "few to one side":
        keep = still_recording.poses.f @ [1, 1, 1] > 0.7 * truth.gravity
        assert 3 < keep.sum() < 10
        sensors = {name: getattr(truth, name) for name in JUMP}
        quiet = {n: Noise(N=tuple(np.array(s.noise.N) / 10)) for n, s in sensors.items()}
        truth = replace(truth, **{n: replace(s, noise=quiet[n]) for n, s in sensors.items()})
        noise = known_noise(truth)
    logs = (switched_on(still_recording, truth, 3000 + seed) for seed in range(len(calibrations)))
    return [
        update_biases(each, log.select(keep), noise, "log")[0]
        for each, log in zip(calibrations, logs, strict=True)
    ]


def parameters(sensor, names):
    return np.array([getattr(sensor, n[0])[tuple(map(int, n[1:]))] for n in names])


@pytest.mark.parametrize("sensor", JUMP)
def test_new_biases_are_as_near_the_truth_as_their_covariance_says(
    updated_biases, calibrations, truth, sensor
):
    """Protects the bias and its errors: noise of the new log, and what T and K leave."""
    pulls, joint = [], []
    for each in updated_biases:
        found = getattr(each, sensor)
        error = parameters(found, found.names) - parameters(getattr(truth, sensor), found.names)
        error[-3:] -= JUMP[sensor]
        pulls.append(error[-3:] / [found.std[f"b{k}"] for k in range(3)])
        joint.append(error @ np.linalg.solve(found.covariance, error))
    assert np.mean(np.abs(pulls) < 3) > 0.97 and np.abs(pulls).max() < 4.5
    assert abs(np.sqrt(np.mean(np.square(pulls))) - 1) < 2.5 / np.sqrt(2 * len(pulls))
    expected = len(error)
    assert abs(np.mean(joint) - expected) < 4 * np.sqrt(2 * expected / len(joint))


@pytest.mark.parametrize("side", [1, -1])
def test_new_biases_take_the_error_of_fresh_data_away(
    updated_biases, calibrations, truth, noise, side
):
    """Protects the purpose of the update: the remaining error agrees with the covariance.

    The covariance with T and K makes it less on the side of the few rests than on the other.
    """
    g = np.random.default_rng(1).normal(size=(50, 3))
    g *= side * np.sign(g @ [1, 1, 1])[:, None]
    g *= truth.gravity / np.linalg.norm(g, axis=1, keepdims=True)
    true = truth.accelerometer
    raw = g @ np.linalg.inv(true.T).T / true.K + true.b + JUMP["accelerometer"]
    before, after, predicted = [], [], []
    for old, new in zip(calibrations, updated_biases, strict=True):
        before.append(np.mean((old.accelerometer.aligned(raw) - g) ** 2))
        after.append(np.mean((new.accelerometer.aligned(raw) - g) ** 2))
        state, covariance = state_of(new)
        sensor, nothing = state.sensor("accelerometer"), np.zeros((50, 1, 3, 0))
        derivative = sensor.jacobian(np.tile(np.eye(3), (50, 1, 1, 1)), raw[:, None], nothing)
        covariance = covariance[:9, :9]
        predicted.append(np.mean(np.einsum("nip,pq,niq->ni", derivative, covariance, derivative)))
    jump = np.mean(JUMP["accelerometer"] ** 2)
    assert abs(np.mean(before) / jump - 1) < 0.05
    assert 0.7 < np.mean(after) / np.mean(predicted) < 1.4
    assert np.sqrt(np.mean(before) / np.mean(after)) > 20


def test_nothing_but_the_biases_changes(still_recording, truth, noise, calibrations):
    """Protects T, K, the effects and their covariance, to the last bit, in SI and in counts."""
    values = {name: 1e-5 for name in GSensitivity().parameters}
    effect = FittedEffect(GSensitivity(), values, dict.fromkeys(values, 1e-6))
    log = switched_on(still_recording, truth, 11)
    old = calibrations[0]
    old = replace(old, gyroscope=replace(old.gyroscope, effects=(effect,)))
    found = []
    for each in (old, in_counts(old)):
        new, kept = update_biases(each, log, noise, "new.csv")
        assert not kept and new.updated == dict.fromkeys(JUMP, "new.csv")
        found.append(new)
        for sensor in JUMP:
            one, other = (getattr(c, sensor) for c in (each, new))
            assert one.T.tobytes() == other.T.tobytes() and one.K.tobytes() == other.K.tobytes()
            assert one.effects == other.effects and one.names == other.names
            k = len(one.names) - 3
            assert one.covariance[:k, :k].tobytes() == other.covariance[:k, :k].tobytes()
            assert not np.any(one.b == other.b)
    si, counts = (each.accelerometer for each in found)
    np.testing.assert_allclose(COUNTS.to_si(counts.b), si.b, rtol=1e-9, atol=1e-9)
    std = [counts.std[f"b{k}"] * COUNTS.scale for k in range(3)]
    np.testing.assert_allclose(std, [si.std[f"b{k}"] for k in range(3)], rtol=1e-6)
    # the effect stays in the effect: the bias is the rest of the rate
    without = update_biases(calibrations[0], log, noise, "new.csv")[0].gyroscope
    assert np.abs(found[0].gyroscope.b - without.b).max() > 1e-7


def test_a_bias_that_the_log_does_not_determine_stays(still_recording, truth, noise, calibrations):
    """Protects an accelerometer from the one or two attitudes of a short log."""
    made, old = switched_on(still_recording, truth, 12), calibrations[0]
    f = made.poses.f / np.linalg.norm(made.poses.f, axis=1, keepdims=True)
    near = f @ f[0] > 0.999
    for keep in (np.arange(len(f)) == 0, near | (np.arange(len(f)) == np.argmin(f @ f[0]))):
        new, kept = update_biases(old, made.select(keep), noise, "log")
        assert set(kept) == {"accelerometer"} and "three or more" in kept["accelerometer"]
        assert new.accelerometer is old.accelerometer
        assert new.updated == {"gyroscope": "log"}
        std = [new.gyroscope.std[f"b{k}"] for k in range(3)]
        error = new.gyroscope.b - truth.gyroscope.b - JUMP["gyroscope"]
        assert np.all(np.abs(error) < 4 * np.array(std))
    bare = [SensorCalibration.nominal(u, "none") for u in (ACCELERATION_UNIT, RATE_UNIT)]
    with pytest.raises(ImuloopError, match=r"no bias can be updated: accelerometer: .*gyroscope: "):
        update_biases(Calibration("d", 9.8, *bare), made, noise, "log")
