"""The check of an old calibration: false alarms, power, and what a log cannot test."""

from dataclasses import replace

import numpy as np
import pytest

from calibrate.devices import ACCELERATION_UNIT, RATE_UNIT, known_noise, planned, recording
from imuloop.calibrate.calibrate import calibrate_accelerometer, calibrate_gyroscope
from imuloop.calibrate.recording import record
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.errors import ImuloopError
from imuloop.core.model import Calibration, SensorCalibration
from imuloop.core.units import RawUnit
from imuloop.simulate.truth import Noise, example_truth
from imuloop.validate.drift import check_drift, holm
from imuloop.validate.drift_residuals import OldParameters
from seeds import least


def white(sensor):
    return replace(sensor, noise=Noise(N=sensor.noise.N))


@pytest.fixture(scope="module")
def truth():
    made = planned(example_truth(rate=25.0), poses=24, initial_rest_s=20.0)
    return replace(made, accelerometer=white(made.accelerometer), gyroscope=white(made.gyroscope))


@pytest.fixture(scope="module")
def noise(truth):
    return known_noise(truth)


@pytest.fixture(scope="module")
def still(truth):
    quiet = [
        replace(s, noise=Noise(N=tuple(1e-3 * np.array(s.noise.N))))
        for s in (truth.accelerometer, truth.gyroscope)
    ]
    return recording(replace(truth, accelerometer=quiet[0], gyroscope=quiet[1]), 5)


def drawn(still, truth, seed, force=None, turn=None):
    """Return the recording with noise of its own; its raw values changed by force and turn."""
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


def calibrated(made, noise, truth):
    settings = CalibrateSettings()
    force = calibrate_accelerometer(made.poses, noise, truth.gravity, ACCELERATION_UNIT, settings)
    turn = calibrate_gyroscope(made, noise, force, RATE_UNIT, settings)
    return Calibration("d", truth.gravity, force, turn)


@pytest.fixture(scope="module", params=[30, pytest.param(100, marks=pytest.mark.study)])
def calibrations(request, still, truth, noise):
    return [calibrated(drawn(still, truth, seed), noise, truth) for seed in range(request.param)]


@pytest.fixture(scope="module")
def unchanged(still, truth, noise, calibrations):
    """The check of each calibration on a log of the same device."""
    return [
        check_drift(each, drawn(still, truth, 1000 + seed), noise)
        for seed, each in enumerate(calibrations)
    ]


def test_false_alarms_are_as_rare_as_the_level_says(unchanged):
    # 5 % at most: Holm and the sharing make it fewer
    assert 1 <= sum(drift.drifted for drift in unchanged) <= least(len(unchanged), 0.05, 0.995)


@pytest.mark.parametrize("sensor", ["accelerometer", "gyroscope"])
def test_each_parameter_scatters_by_its_error(unchanged, sensor):
    sigmas = {}
    for drift in unchanged:
        for change in drift.sensors[sensor].changes:
            sigmas.setdefault(change.name, []).append(change.sigmas)
    # the standard deviation of 100 has an error of 7 %
    size = {name: np.sqrt(np.mean(np.square(values))) for name, values in sigmas.items()}
    assert all(abs(s - 1) < 2.5 / np.sqrt(len(unchanged)) for s in size.values()), size
    joint = [drift.sensors[sensor].chi2 for drift in unchanged]
    expected = unchanged[0].sensors[sensor].dof
    assert abs(np.mean(joint) - expected) < 4 * np.sqrt(2 * expected / len(joint))


def moved_force(values):
    return values / [1, 1, 1.002] + np.array([0.01, 0, 0])


def moved_turn(values):
    return values + np.array([0, 1e-3, 0])


def test_a_drift_is_found_where_it_is_and_nowhere_else(still, truth, noise, calibrations):
    found, others = [], 0
    for seed, each in enumerate(calibrations[:20]):
        drift = check_drift(each, drawn(still, truth, 2000 + seed, moved_force, moved_turn), noise)
        assert drift.drifted and not drift.bias_only
        names = {n: {c.name for c in s.changes if c.drifted} for n, s in drift.sensors.items()}
        found.append(names["accelerometer"] >= {"K2", "b0"} and "b1" in names["gyroscope"])
        others += sum(map(len, names.values())) - 3
        changes = {c.name: c for c in drift.sensors["accelerometer"].changes}
        assert abs(changes["b0"].change - 0.01) < 5 * changes["b0"].std
        assert abs(changes["K2"].change - 0.002) < 5 * changes["K2"].std
    assert all(found) and others <= 2


def test_a_turn_on_that_is_allowed_is_no_drift(still, truth, noise, calibrations):
    made = drawn(still, truth, 7, lambda f: f + np.array([0.01, 0, 0]), moved_turn)
    drift = check_drift(calibrations[0], made, noise)
    assert drift.drifted and drift.bias_only
    allowed = check_drift(calibrations[0], made, noise, turn_on=(0.01, 1e-3))
    assert not allowed.drifted
    assert allowed.sensors["gyroscope"].turn_on == (1e-3,) * 3


def test_one_rest_shows_the_bias_along_gravity_and_the_gyroscope_s(
    still, truth, noise, calibrations
):
    made = drawn(still, truth, 8, lambda f: f + np.array([0, 0, 0.02]))
    upright = np.argmax(made.poses.f[:, 2])
    one = made.select(np.arange(len(made.poses)) == upright)
    found = check_drift(calibrations[0], one, noise)
    force, turn = found.sensors["accelerometer"], found.sensors["gyroscope"]
    assert [c.name.startswith("b along (") for c in force.changes] == [True]
    u = made.poses.f[upright] / np.linalg.norm(made.poses.f[upright])
    assert force.drifted and abs(force.changes[0].change - 0.02 * u[2]) < 5 * force.changes[0].std
    assert set(force.untested) == set(calibrations[0].accelerometer.names)
    assert {c.name for c in turn.changes} == {"b0", "b1", "b2"} and not turn.drifted
    assert "K0" in turn.untested and "1 rest(s)" in turn.why


def test_raw_units_change_nothing(still, truth, noise, calibrations):
    old, made = calibrations[0], drawn(still, truth, 10)
    counts = RawUnit("count", 0.0024, 32768.0)
    force = old.accelerometer
    factor = np.ones(9)
    factor[3:6], factor[6:] = 0.0024, 1 / 0.0024
    in_counts = replace(
        force,
        raw_unit=counts,
        K=force.K * 0.0024,
        b=counts.from_si(force.b),
        covariance=force.covariance * np.outer(factor, factor),
    )
    olds = [replace(old, accelerometer=s) for s in (force, in_counts)]
    one, other = (OldParameters.of(each, "accelerometer").x for each in olds)
    np.testing.assert_allclose(other, one, rtol=1e-12, atol=1e-12)
    one, other = (check_drift(each, made, noise) for each in olds)
    for a, b in zip(one.sensors.values(), other.sensors.values(), strict=True):
        np.testing.assert_allclose(a.chi2, b.chi2, rtol=1e-6)


def test_what_was_never_calibrated_is_not_tested(still, truth, noise, calibrations):
    bare = SensorCalibration.nominal(ACCELERATION_UNIT, "no poses")
    drift = check_drift(
        replace(calibrations[0], accelerometer=bare), drawn(still, truth, 13), noise
    )
    force, turn = drift.sensors.values()
    assert force.drifted is None and "estimated nothing" in force.why
    # without an accelerometer there is no direction of gravity: rests alone
    assert {c.name for c in turn.changes} == {"b0", "b1", "b2"} and not drift.drifted
    bare = [SensorCalibration.nominal(u, "none") for u in (ACCELERATION_UNIT, RATE_UNIT)]
    with pytest.raises(ImuloopError, match=r"nothing can be tested: accelerometer: .*gyroscope: "):
        check_drift(Calibration("d", 9.8, *bare), still, noise)
    with pytest.raises(ImuloopError, match="no rest"):
        check_drift(calibrations[0], record([], [], 30.0), noise)


def test_holm_against_its_paper():
    # S. Holm 1979: the smallest times m, the next times m - 1, …, never falling, at most 1
    np.testing.assert_allclose(holm([0.03, 0.01, 0.04, 0.6]), [0.09, 0.04, 0.09, 0.6])
