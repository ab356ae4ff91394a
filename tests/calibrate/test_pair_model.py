"""Residuals of both sensors: their derivative by what is estimated, and by effects of either."""

import numpy as np
import pytest

from calibrate.devices import noiseless, planned, recording, slopes, true_pair
from imuloop.calibrate.sensor_pair import OfSensor
from imuloop.core.effect import find_effect
from imuloop.core.samples import SENSORS
from imuloop.simulate.truth import example_truth

# the axes of velocities and angles turn with the parameters, which counts where the model errs; and
# are others beyond where two components of gravity are equal, as in a first pose with z up
PLAN = {"poses": 12, "initial_rest_s": 10.0, "up": (0.3, -0.5, 0.8)}
TRUTH = noiseless(planned(example_truth(rate=200.0), **PLAN))
EFFECTS = {
    "accelerometer": ("quadratic", "lever_arm", "time_offset", "rate_sensitivity", "anisoinertia"),
    "gyroscope": ("g_sensitivity", "gyro_axis_delay"),
}


@pytest.fixture(scope="module")
def made():
    return recording(TRUTH, 1)


HELD = {
    "all free": {},
    "at the poses alone": {"moves": False},
    "the accelerometer alone": {"moves": False, "estimated": ("accelerometer",)},
    "the accelerometer fixed": {"moves": False, "estimated": ("gyroscope",)},
    "the bias of the gyroscope held": {"bias": (np.zeros(3), np.full(3, 1e-12))},
}


@pytest.mark.parametrize("held", HELD)
def test_the_derivative_is_that_of_the_residuals(made, held):
    pair, x = true_pair(TRUTH, made, **HELD[held])
    fixed = {"the accelerometer alone": 12, "the accelerometer fixed": 9}.get(held, 0)
    assert len(x) == 21 - fixed - 3 * ("bias" in HELD[held])
    sensors = [s for s in SENSORS if s in pair.estimated]
    effects = [OfSensor(find_effect(name)(), s) for s in sensors for name in EFFECTS[s]]
    model = pair.model_at(x, made, effects)
    x = np.append(x, np.zeros(sum(len(e.parameters) for e in effects)))
    values, jacobian = model.residuals(x)
    numeric, kinds = slopes(lambda x: model.residuals(x)[0], x), pair.rows(made)[1]
    assert jacobian.shape == (len(kinds), len(x)) and len(values) == len(kinds)
    # to the turn within one sample
    most = np.where(np.arange(len(x)) < len(pair.free), 1e-3, 1e-2)
    for k, kind in enumerate(pair.kinds):
        own, theirs = jacobian[kinds == k], numeric[kinds == k]
        worst = np.abs(own - theirs).max(axis=0)
        assert np.all(worst < most * np.abs(own).max(axis=0) + 1e-7), kind
        assert np.any(own[:, : len(pair.free)])
