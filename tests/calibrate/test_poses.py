"""Poses and rotations gathered from segments, and poses whose noise is not known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import t as student

from calibrate.devices import RATE_UNIT, calibrate_recording, known_noise, recording
from imuloop.calibrate.nominal import rest_bias
from imuloop.calibrate.poses import rounding_variance
from imuloop.core.noise_model import AxisNoise, Coefficient, NoiseModel, SinusoidTerm
from imuloop.core.samples import CHANNELS
from imuloop.simulate.truth import example_truth

TRUTH = example_truth()


@pytest.mark.parametrize(("noise", "most"), [(0.0, 1.1), (0.1, 2.5), (0.3, 1.3)])
def test_rounding_to_steps_larger_than_the_noise_adds_its_variance_to_the_means(noise, most):
    rng, step = np.random.default_rng(10), 0.04
    exact = rng.uniform(-1, 1, (4000, 1)) + step * noise * rng.standard_normal((4000, 400))
    logged = np.round(exact / step) * step
    # errors of the means, without the part that the variance within the poses has already
    spread = np.var((logged - exact).mean(axis=1)) - step**2 / 12 / 400
    foreseen = rounding_variance(logged.ravel(), logged.var(axis=1))
    assert 0.9 * spread < foreseen < most * spread


LINES = AxisNoise(sinusoid=(SinusoidTerm(Coefficient(1e-3), Coefficient(4.613)),))


@pytest.mark.parametrize("axis", [1, 5])
@pytest.mark.parametrize(
    ("axis_noise", "variance", "what"),
    [
        (AxisNoise(), 0.0, "never changes within a pose"),
        (LINES, 1.0, "shows lines and no noise beside them"),
    ],
)
def test_an_axis_without_noise_is_a_reason_and_no_failure(axis, axis_noise, variance, what):
    recording_of_poses, noise_of_all = recording(TRUTH, 0), known_noise(TRUTH)
    factor = np.where(np.arange(6) == axis, variance, 1.0)
    poses = replace(recording_of_poses.poses, variance=recording_of_poses.poses.variance * factor)
    noise = NoiseModel("d", {**noise_of_all.axes, CHANNELS[axis]: axis_noise})
    force, turn = calibrate_recording(
        replace(recording_of_poses, poses=poses), noise, TRUTH.gravity
    )
    reason = f"{CHANNELS[axis]} {what}: its noise is not known"
    for sensor, silent in ((force, axis < 3), (turn, axis >= 3)):
        expected = ("nominal", reason) if silent else ("multi_position", None)
        assert (sensor.method, sensor.not_testable) == expected
    rest = rest_bias(poses, noise, RATE_UNIT, "bias only")
    assert rest.method == ("nominal" if axis >= 3 else "static")


def test_a_bias_that_differs_between_power_cycles_is_as_sure_as_they_agree():
    recording_of_poses, noise = recording(TRUTH, 0), known_noise(TRUTH)
    rng, off = np.random.default_rng(3), 0.01
    count, pulls = 4, []
    cycle = np.arange(len(recording_of_poses.poses)) * count // len(recording_of_poses.poses)
    for _ in range(400):
        w = recording_of_poses.poses.w + off * rng.standard_normal((count, 3))[cycle]
        rest = rest_bias(
            replace(recording_of_poses.poses, w=w, power_cycle=cycle), noise, RATE_UNIT, "bias only"
        )
        pulls.append((rest.b - TRUTH.gyroscope.b) / [rest.std[f"b{k}"] for k in range(3)])
    # Student's t with three degrees of freedom: within 3.182 in 95 %
    assert np.mean(np.abs(pulls) < student.ppf(0.975, count - 1)) == pytest.approx(0.95, abs=0.02)
