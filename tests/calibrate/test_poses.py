"""Poses and rotations gathered from segments, and poses whose noise is not known."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from calibrate.devices import ACCELERATION_UNIT, RATE_UNIT, known_noise, recording
from imuloop.calibrate.calibrate import calibrate_accelerometer, calibrate_gyroscope, rest_bias
from imuloop.calibrate.pose_fits import AccelerometerPoses, GyroscopePoses
from imuloop.calibrate.poses import gather_poses, gather_rotations, rounded_means
from imuloop.calibrate.recording import record
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.noise_model import AxisNoise, Coefficient, NoiseModel, Sinusoid
from imuloop.core.samples import CHANNELS
from imuloop.core.segments import segment_table
from imuloop.simulate.truth import example_truth

TRUTH = example_truth()


def session(temperature=None):
    """Return 12 s at 10 Hz: rests of 3, 2 and 4 s, the first two one pose; ax counts samples."""
    t = np.arange(120) / 10
    log = pd.DataFrame({"t": t, **dict.fromkeys(CHANNELS, 0.0)})
    log["ax"] = np.arange(120.0)
    if temperature is not None:
        log["temperature"] = temperature
    edges = np.array([0, 3, 4, 6, 8, 12.0])
    kinds = ["static", "motion", "static", "motion", "static"]
    return log, segment_table(log, edges[:-1], edges[1:], kinds, [0, -1, 0, -1, 1])


def test_rests_of_one_pose_are_pooled_by_their_samples():
    _, table = session()
    poses = gather_poses([table, table])
    assert poses.session.tolist() == [0, 0, 1, 1]
    assert poses.n.tolist() == [50, 40, 50, 40]
    assert poses.duration_s.tolist() == [5, 4, 5, 4]
    assert poses.f[0, 0] == pytest.approx((30 * 14.5 + 20 * 49.5) / 50)
    assert poses.temperature is None


def test_a_rotation_runs_from_the_last_sample_of_a_pose_to_the_first_of_the_next():
    log, table = session()
    poses = gather_poses([table, table])
    rotations, _ = gather_rotations(poses, [log, log], [table, table], 30.0)
    # none from the first session to the second
    assert rotations.first.tolist() == [0, 2]
    assert (rotations.start_s[0], rotations.end_s[0]) == (5.9, 8.0)
    assert len(gather_rotations(poses, [log, log], [table, table], 1.9)[0]) == 0


@pytest.mark.parametrize(("noise", "most"), [(0.0, 1.1), (0.1, 2.5), (0.2, 1.8), (0.3, 1.3)])
def test_rounding_to_steps_larger_than_the_noise_adds_its_variance_to_the_means(noise, most):
    rng, step = np.random.default_rng(10), 0.04
    exact = rng.uniform(-1, 1, (4000, 1)) + step * noise * rng.standard_normal((4000, 400))
    logged = np.round(exact / step) * step
    # of what the means are off, that of independent samples is in the variance within the poses
    spread = np.var((logged - exact).mean(axis=1)) - step**2 / 12 / 400
    foreseen = rounded_means(logged.ravel(), logged.var(axis=1))
    assert 0.9 * spread < foreseen < most * spread


def test_noise_over_several_steps_or_values_without_steps_leave_nothing_of_rounding():
    rng = np.random.default_rng(11)
    x = rng.standard_normal((20, 400))
    assert rounded_means(x.ravel(), x.var(axis=1)) == 0.0
    x = np.round(x / 0.5) * 0.5
    assert rounded_means(x.ravel(), x.var(axis=1)) < 1e-9
    assert rounded_means(np.full(50, 9.8), np.zeros(2)) == 0.0


def test_missing_temperatures_are_interpolated():
    temperature = 20.0 + np.arange(120) / 100
    temperature[[0, 1, 2, 50, 51, 110]] = np.nan
    log, table = session(temperature)
    made = record([log], [table], 30.0)
    # on a straight line interpolation is exact; before the first value that value holds
    filled = np.maximum(20.0 + np.arange(120) / 100, 20.03)
    np.testing.assert_allclose(made.logs[0].temperature, filled)
    # a pose of two rests: everything from the first to the last of its samples
    np.testing.assert_allclose(made.poses.temperature, [filled[:60].mean(), filled[80:].mean()])
    assert np.isfinite(made.rotations.temperature).all()


def test_a_session_without_temperature_leaves_none():
    (log, table), (cold, _) = session(np.full(120, 20.0)), session()
    made = record([log, cold], [table, table], 30.0)
    assert made.poses.temperature is None and made.rotations.temperature is None
    assert record([log], [table], 30.0).poses.temperature.tolist() == [20.0, 20.0]
    unknown = log.assign(temperature=np.nan)
    assert record([unknown], [table], 30.0).poses.temperature is None


def test_what_an_effect_remembers_is_averaged_over_poses_and_picked_along_rotations():
    log, table = session()
    made = record([log, log], [table, table], 30.0)

    def remembered(channels, factor):
        return factor * channels.output[:, 0]

    poses = made.pose_channels("accelerometer", lambda y: 2 * y, made.poses.w)
    found = poses.remembered(remembered, 10.0)
    np.testing.assert_allclose(found, 20 * np.array([29.5, 99.5, 29.5, 99.5]))
    np.testing.assert_allclose(poses.output, 2 * made.poses.f)
    along = made.rotation_channels("accelerometer", lambda y: 2 * y, made.rotations.w)
    m, k = made.rotations.t.shape
    found = along.remembered(remembered, 10.0).reshape(m, k)
    np.testing.assert_allclose(found, 20 * made.rotations.f[..., 0])


@pytest.mark.parametrize("axis", range(6))
def test_an_axis_that_never_changes_is_a_reason_and_no_failure(axis):
    made = recording(TRUTH, 0)
    variance = made.poses.variance.copy()
    variance[:, axis] = 0.0
    dead = replace(made, poses=replace(made.poses, variance=variance))
    known = known_noise(TRUTH)
    noise = NoiseModel("d", {**known.axes, CHANNELS[axis]: AxisNoise()})
    settings = CalibrateSettings()
    force = calibrate_accelerometer(dead.poses, noise, TRUTH.gravity, ACCELERATION_UNIT, settings)
    good = calibrate_accelerometer(made.poses, known, TRUTH.gravity, ACCELERATION_UNIT, settings)
    turn = calibrate_gyroscope(dead, noise, good, RATE_UNIT, settings)
    reason = f"{CHANNELS[axis]} never changes within a pose: its noise is not known"
    for sensor, silent in ((force, axis < 3), (turn, axis >= 3)):
        assert (sensor.method, sensor.not_testable) == (
            ("nominal", reason) if silent else ("multi_position", None)
        )
    rest = rest_bias(dead.poses, noise, RATE_UNIT, "bias only")
    assert rest.method == ("nominal" if axis >= 3 else "static")
    model = AccelerometerPoses(noise, TRUTH.gravity, ACCELERATION_UNIT, settings)
    assert model.untestable(dead) == (reason if axis < 3 else None)
    assert reason in GyroscopePoses(noise, force, RATE_UNIT, settings).untestable(dead)


@pytest.mark.parametrize("axis", range(6))
def test_an_axis_of_lines_alone_is_a_reason_and_no_failure(axis):
    made = recording(TRUTH, 0)
    known = known_noise(TRUTH)
    line = Sinusoid(Coefficient(1e-3), Coefficient(4.613))
    noise = NoiseModel("d", {**known.axes, CHANNELS[axis]: AxisNoise(sinusoid=(line,))})
    settings = CalibrateSettings()
    force = calibrate_accelerometer(made.poses, noise, TRUTH.gravity, ACCELERATION_UNIT, settings)
    good = calibrate_accelerometer(made.poses, known, TRUTH.gravity, ACCELERATION_UNIT, settings)
    turn = calibrate_gyroscope(made, noise, good, RATE_UNIT, settings)
    reason = f"{CHANNELS[axis]} shows lines and no noise beside them: its noise is not known"
    assert (force if axis < 3 else turn).not_testable == reason
    # two axes are named both
    both = dict.fromkeys((CHANNELS[axis], CHANNELS[axis - 2]), AxisNoise(sinusoid=(line,)))
    found = made.poses.unknown_noise(NoiseModel("d", {**known.axes, **both}), CHANNELS)
    assert found.startswith(", ".join(c for c in CHANNELS if c in both) + " shows lines")
