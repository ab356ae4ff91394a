"""The covariance of the residuals of both sensors against noise that is drawn sample by sample."""

from dataclasses import replace

import numpy as np
import pytest

from calibrate.devices import coefficient, plan_session, recording, true_fit
from imuloop.core.noise_model import AxisNoise, NoiseModel
from imuloop.core.samples import CHANNELS
from imuloop.simulate.noise import flicker, walk, white
from imuloop.simulate.truth import example_truth

SEEDS, DRAWS, RATE = 5, 3000, 25.0
PLAN = {"poses": 3, "initial_rest_s": 10.0, "rest_s": (3.0, 8.0), "move_s": (1.0, 1.5)}
TRUTH = plan_session(example_truth(rate=RATE), **PLAN)
# size of slow noise where white noise has size one, s^-1/2 and s^-1, and how it is drawn: over a
# move of a second it is nearly as large
SLOW = {"B": (1.0, flicker), "K": (0.6, walk)}


@pytest.fixture(scope="module")
def device():
    """A JointFit, its ResidualCovariance, and what errors of each sample make of the residuals.

    The latter by differences, for the means at the poses and the samples along the moves.
    """
    made = recording(TRUTH, 2)
    joint, x = true_fit(TRUTH, made)
    plain, step, gains = joint.measure(x, made).at(x), 1e-6, []
    for axis in range(6):
        name, columns = "fw"[axis // 3], []
        for table in ("poses", "rotations"):
            whole = getattr(made, table)
            for at in np.ndindex(getattr(whole, name).shape[:-1]):
                values = getattr(whole, name).copy()
                values[(*at, axis % 3)] += step
                changed = replace(made, **{table: replace(whole, **{name: values})})
                moved = joint.measure(x, changed).at(x).residual
                columns.append((moved - plain.residual) / step)
        gains.append(np.transpose(columns))
    return joint, plain.noise, made, gains


def draw_records(made, term, rng):
    """Return records of one channel's noise, at the poses and in the moves, (draws, n)."""
    log, poses, (size, slow) = made.logs[0].t, made.poses, SLOW[term]
    ends = np.searchsorted(log, [poses.start_s, poses.end_s]).T
    moves = np.searchsorted(log, made.rotations.t).ravel()

    def seen(process, size):
        records = np.array([process(len(log), 1 / RATE, size, rng) for _ in range(DRAWS)])
        means = [records[:, i:j].mean(axis=1) for i, j in ends]
        return np.hstack([np.transpose(means), records[:, moves]])

    found = seen(slow, size)
    # the bias is the mean over all rests
    level = found[:, : len(poses)] @ poses.duration_s / poses.duration_s.sum()
    return found - level[:, None] + seen(white, 1.0)


@pytest.mark.parametrize("axis", (0, 4))
@pytest.mark.parametrize("term", SLOW)
def test_it_is_that_of_drawn_records(device, term, axis):
    joint, covariance, made, gains = device
    found = np.cov((draw_records(made, term, np.random.default_rng(axis)) @ gains[axis].T).T)
    own = AxisNoise(N=coefficient(1.0), **{term: coefficient(SLOW[term][0])})
    # of the other channels next to nothing
    noise = dict.fromkeys(CHANNELS, AxisNoise(N=coefficient(1e-9))) | {CHANNELS[axis]: own}
    off, size = found - covariance.by(NoiseModel("d", noise)), np.sqrt(np.diag(found))
    # of velocities, rotations, and whichever of gravity and rates the channel is of
    assert np.count_nonzero(size > 1e-6) == 5 * len(made.rotations) + len(made.poses)
    # an angle with almost no direct share has the share that the turn within a sample lets in
    kinds = joint.rows(made)[1]
    largest = {kind: size[kinds == kind].max() for kind in joint.kinds}
    counts = size > 0.1 * np.array([largest[kind] for kind in kinds.tolist()]) + 1e-6
    off = off[np.ix_(counts, counts)] / np.outer(size[counts], size[counts])
    # five standard deviations
    assert np.abs(off).max() < 5 * np.sqrt(2 / DRAWS)


def chi_square(values, covariance, biases):
    """Return chi square and its degrees of freedom where biases, derivatives (n, q), are free."""
    white = np.linalg.solve(np.linalg.cholesky(covariance), np.column_stack([values, biases]))
    q = np.linalg.qr(white[:, 1:][:, np.any(biases, axis=0)])[0]
    left = white[:, 0] - q @ (q.T @ white[:, 0])
    return np.array([left @ left, len(left) - q.shape[1]])


# of both sensors among all parameters: slow noise has its mean over the rests in them
BIASES = np.r_[6:9, 18:21]


def test_errors_at_the_truth_have_the_predicted_covariance():
    truth = plan_session(example_truth(), poses=20, move_s=(1.0, 2.0), temperature=None)
    found = {}
    for seed in range(SEEDS):
        made = recording(truth, 100 + seed)
        joint, x = true_fit(truth, made)
        at, kinds = joint.measure(x, made).at(x), joint.rows(made)[1]
        r, jacobian, covariance = at.residual, at.jacobian, at.noise.by(joint.noise)
        groups = {kind: kinds == kind for kind in joint.kinds} | {"all": kinds != ""}
        for kind, rows in groups.items():
            own = covariance[np.ix_(rows, rows)]
            more = chi_square(r[rows], own, jacobian[np.ix_(rows, BIASES)])
            found[kind] = found.get(kind, 0) + more
    for kind, (chi2, dof) in found.items():
        assert chi2 / dof == pytest.approx(1, abs=3 * np.sqrt(2 / dof)), kind


def test_a_walk_of_the_rate_is_common_to_rotations_and_the_poses_beside_them():
    noise = replace(TRUTH.gyroscope.noise, B=(0.0, 0.0, 0.0), K=(3e-5, 3e-5, 3e-5))
    truth = example_truth(gyroscope=replace(TRUTH.gyroscope, noise=noise))
    together, alone = np.zeros(2), np.zeros(2)
    for seed in range(SEEDS):
        made = recording(truth, seed)
        joint, x = true_fit(truth, made, moves=False)
        at = joint.measure(x, made).at(x)
        r, jacobian, covariance = at.residual, at.jacobian, at.noise.by(joint.noise)
        n, first = len(made.poses), made.rotations.first
        apart = covariance.copy()
        apart[: 4 * n, 4 * n :] = apart[4 * n :, : 4 * n] = 0
        # an error of the rate turns gravity as one of the bias does, minus its effect on the means
        # of the poses at both ends
        less = np.eye(len(r))[4 * n :]
        turned = (-jacobian[4 * n :, 18:21] / truth.gyroscope.K).reshape(-1, 2, 3)
        for k, pose in enumerate(first):
            for end in n + 3 * np.array([pose, pose + 1]):
                less[2 * k : 2 * k + 2, end : end + 3] -= turned[k] / 2
        biases = less @ jacobian[:, BIASES[:3]]
        together += chi_square(less @ r, less @ covariance @ less.T, biases)
        alone += chi_square(less @ r, less @ apart @ less.T, biases)
    off = 3 * np.sqrt(2 / together[1])
    assert together[0] / together[1] == pytest.approx(1, abs=off)
    # as if rates and rotations had nothing in common
    assert alone[0] / alone[1] < 1 - off
