"""Residuals of both sensors: their derivative by the parameters, and by effects of either."""

import numpy as np
import pytest

from calibrate.devices import plan_session, recording, slopes, true_fit, without_noise
from imuloop.model.effect import find_effect
from imuloop.model.effects import SensorEffect
from imuloop.model.state import BIAS, COUNT, State
from imuloop.simulate.truth import example_truth

# the axes of velocities and angles turn with the parameters, which counts where the model errs; and
# are others beyond where two components of gravity are equal, as in a first pose with z up
PLAN = {"poses": 12, "initial_rest_s": 10.0, "up": (0.3, -0.5, 0.8)}
TRUTH = without_noise(plan_session(example_truth(rate=200.0), **PLAN))
EFFECTS = {
    "accelerometer": ("quadratic", "lever_arm", "time_offset", "rate_sensitivity", "anisoinertia"),
    "gyroscope": ("g_sensitivity", "gyro_axis_delay"),
}


@pytest.fixture(scope="module")
def example_recording():
    return recording(TRUTH, 1)


COUNTED = {
    "both sensors": {},
    "without velocities": {"moves": False},
    "the accelerometer alone": {"moves": False, "sensors": ("accelerometer",)},
    "the gyroscope alone": {"moves": False, "sensors": ("gyroscope",)},
    "the bias of the gyroscope held": {"moves": False, "bias_held": True},
}


@pytest.mark.parametrize("counted", COUNTED)
def test_the_derivative_is_that_of_the_residuals(example_recording, counted):
    joint, x = true_fit(TRUTH, example_recording, **COUNTED[counted])
    effects = [SensorEffect(find_effect(name)(), s) for s in joint.estimated for name in EFFECTS[s]]
    x = State(x).with_effects(effects).x
    measured = joint.measure(x, example_recording, effects)
    jacobian, kinds = measured.at(x).jacobian, joint.rows(example_recording)[1]
    numeric = slopes(lambda x: measured.at(x).residual, x)
    assert jacobian.shape == numeric.shape == (len(kinds), len(x))
    if joint.factors.bias_held:
        assert not jacobian[:, BIAS].any()
        numeric[:, BIAS] = 0.0
    # to the turn within one sample
    most = np.where(np.arange(len(x)) < COUNT, 1e-3, 1e-2)
    for kind in joint.kinds:
        own, theirs = jacobian[kinds == kind], numeric[kinds == kind]
        worst = np.abs(own - theirs).max(axis=0)
        assert np.all(worst < most * np.abs(own).max(axis=0) + 1e-7), kind
        assert np.any(own[:, :COUNT])
