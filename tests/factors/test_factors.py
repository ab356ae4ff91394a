"""Residuals of both sensors: their derivative by the parameters, and by effects of either."""

from dataclasses import replace

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
        ours, theirs = jacobian[kinds == kind], numeric[kinds == kind]
        worst = np.abs(ours - theirs).max(axis=0)
        assert np.all(worst < most * np.abs(ours).max(axis=0) + 1e-7), kind
        assert np.any(ours[:, :COUNT])


def chi_square(values, covariance, biases):
    """Return chi square and its degrees of freedom where biases, derivatives (n, q), are free."""
    white = np.linalg.solve(np.linalg.cholesky(covariance), np.column_stack([values, biases]))
    q = np.linalg.qr(white[:, 1:][:, np.any(biases, axis=0)])[0]
    residual = white[:, 0] - q @ (q.T @ white[:, 0])
    return np.array([residual @ residual, len(residual) - q.shape[1]])


# of both sensors among all parameters: slow noise has its mean over the rests in them
BIASES = np.r_[6:9, 18:21]


@pytest.mark.parametrize("walk", [0.0, 3e-5], ids=["as usual", "a walk of the rate"])
def test_errors_at_the_truth_have_the_predicted_covariance(walk):
    """A walk is common to rotations, to the poses beside them, and to velocities."""
    truth = plan_session(example_truth(), poses=20, move_s=(1.0, 2.0), temperature=None)
    if walk:
        noise = replace(truth.gyroscope.noise, B=(0.0, 0.0, 0.0), K=(walk,) * 3)
        truth = replace(truth, gyroscope=replace(truth.gyroscope, noise=noise))
    sums = {}
    for seed in range(5):
        log = recording(truth, 100 + seed)
        joint, x = true_fit(truth, log)
        at, kinds = joint.measure(x, log).at(x), joint.rows(log)[1]
        r, jacobian, covariance = at.residual, at.jacobian, at.noise.by(joint.noise)
        groups = {kind: kinds == kind for kind in joint.kinds} | {"all": kinds != ""}
        for kind, rows in groups.items():
            block = covariance[np.ix_(rows, rows)]
            more = chi_square(r[rows], block, jacobian[np.ix_(rows, BIASES)])
            sums[kind] = sums.get(kind, 0) + more
    for kind, (chi2, dof) in sums.items():
        assert chi2 / dof == pytest.approx(1, abs=3 * np.sqrt(2 / dof)), kind
