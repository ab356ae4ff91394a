"""The covariance of the residuals of both sensors against noise that is drawn sample by sample."""

from dataclasses import replace

import numpy as np
import pytest

from calibrate.devices import known, planned, recording, true_pair
from imuloop.core.noise_model import AxisNoise, NoiseModel
from imuloop.core.samples import CHANNELS
from imuloop.simulate.noise import flicker, walk, white
from imuloop.simulate.truth import example_truth

SEEDS, DRAWS, RATE = 5, 3000, 25.0
PLAN = {"poses": 3, "initial_rest_s": 10.0, "rest_s": (3.0, 8.0), "move_s": (1.0, 1.5)}
TRUTH = planned(example_truth(rate=RATE), **PLAN)
# size of slow noise beside white noise of size one, s^-1/2 and s^-1, and how it is drawn: over a
# move of a second it is nearly as large
SLOW = {"B": (1.0, flicker), "K": (0.6, walk)}


@pytest.fixture(scope="module")
def device():
    """A PairCovariance, and what errors of each channel's samples make of the residuals.

    The latter by differences, for the means at the poses and the samples along the moves.
    """
    made = recording(TRUTH, 2)
    pair, x = true_pair(TRUTH, made)
    plain, step, gains = pair.model_at(x, made).residuals(x)[0], 1e-6, []
    for axis in range(6):
        name, columns = "fw"[axis // 3], []
        for table in ("poses", "rotations"):
            whole = getattr(made, table)
            for at in np.ndindex(getattr(whole, name).shape[:-1]):
                values = getattr(whole, name).copy()
                values[(*at, axis % 3)] += step
                changed = replace(made, **{table: replace(whole, **{name: values})})
                columns.append((pair.model_at(x, changed).residuals(x)[0] - plain) / step)
        gains.append(np.transpose(columns))
    return pair, pair.covariance_at(x, made), made, gains


def drawn(made, term, rng):
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


@pytest.mark.parametrize("axis", range(6), ids=CHANNELS)
@pytest.mark.parametrize("term", SLOW)
def test_it_is_that_of_drawn_records(device, term, axis):
    pair, covariance, made, gains = device
    found = np.cov((drawn(made, term, np.random.default_rng(axis)) @ gains[axis].T).T)
    own = AxisNoise(N=known(1.0), **{term: known(SLOW[term][0])})
    # of the other channels next to nothing
    noise = dict.fromkeys(CHANNELS, AxisNoise(N=known(1e-9))) | {CHANNELS[axis]: own}
    off, size = found - covariance.by(NoiseModel("d", noise)), np.sqrt(np.diag(found))
    # of velocities, rotations, and whichever of gravity and rates the channel is of
    assert np.count_nonzero(size > 1e-6) == 5 * len(made.rotations) + len(made.poses)
    # an angle that next to none of it enters has what the turn within a sample lets in
    kinds = pair.rows(made)[1]
    counts = size > 0.1 * np.array([size[kinds == k].max() for k in range(5)])[kinds] + 1e-6
    off = off[np.ix_(counts, counts)] / np.outer(size[counts], size[counts])
    # five standard deviations
    assert np.abs(off).max() < 5 * np.sqrt(2 / DRAWS)


def test_its_components_are_what_it_is_the_sum_of(device):
    _, covariance, *_ = device
    noise = NoiseModel("d", dict.fromkeys(CHANNELS, AxisNoise(*map(known, (0, 1e-3, 3e-4, 1e-5)))))
    sizes = {(c, term): getattr(noise.axes[c], term).value for c in CHANNELS for term in "BK"}
    rest = covariance.by(noise.with_sizes(dict.fromkeys(sizes, 0.0)))
    parts = sum(size**2 * covariance.component(*which) for which, size in sizes.items())
    whole = covariance.by(noise)
    np.testing.assert_allclose(rest + parts, whole, atol=1e-10 * whole.max())


@pytest.mark.parametrize("walk", [0.0, 1e-5, 1e-3])
def test_of_rates_the_bias_is_the_mean_over_all_rests_however_they_walk(device, walk):
    _, covariance, made, _ = device
    axes = dict.fromkeys(CHANNELS, AxisNoise(N=known(2e-4), K=known(walk)))
    poses = len(made.poses)
    for axis in range(3):
        rows = poses + 3 * np.arange(poses) + axis
        own = covariance.by(NoiseModel("d", axes))[np.ix_(rows, rows)]
        weights = np.linalg.solve(own, np.ones(poses))
        share = made.poses.duration_s / made.poses.duration_s.sum()
        np.testing.assert_allclose(weights / weights.sum(), share, rtol=1e-6)
        # and as well known as white noise lets it be
        assert weights.sum() == pytest.approx(made.poses.duration_s.sum() / 2e-4**2, rel=1e-6)


def test_the_rates_have_the_rounding_of_the_angular_rate():
    made, rounding = recording(TRUTH, 1), np.arange(6) * 1e-8
    pair, x = true_pair(TRUTH, made, moves=False)
    n = len(made.poses)
    plain, rounded = (
        pair.covariance_at(
            x, replace(made, poses=replace(made.poses, extra_variance=np.tile(more, (n, 1))))
        )
        .by(pair.noise)
        .diagonal()[n : 4 * n]
        for more in (0 * rounding, rounding)
    )
    np.testing.assert_allclose((rounded - plain).reshape(n, 3), rounding[None, 3:].repeat(n, 0))


def test_turns_to_both_ends_of_a_rest_that_tilts_share_their_noise(device):
    """Of one record of white noise over the rest, the turns from its mean to start and end."""
    pair, _, made, _ = device
    rng, n = np.random.default_rng(3), len(made.poses)
    poses = replace(made.poses, tilt=np.arange(n) % 2 * 1e-3)
    made = replace(made, poses=poses)
    _, x = true_pair(TRUTH, made)
    covariance = pair.covariance_at(x, made)
    draws, count, errors = 400, 200, []
    plain = pair.model_at(x, made).residuals(x)[0]
    for _ in range(draws):
        walks = np.cumsum(rng.normal(size=(n, count, 3)), axis=1)
        walks *= np.sqrt(poses.duration_s / count)[:, None, None]
        walks[poses.tilt == 0] = 0.0
        mean = walks.mean(axis=1)
        turned = replace(poses, to_start=-1e-6 * mean, to_end=1e-6 * (walks[:, -1] - mean))
        errors.append(pair.model_at(x, replace(made, poses=turned)).residuals(x)[0] - plain)
    found = np.cov(np.transpose(errors)) * 1e12
    expected = sum(columns @ columns.T for columns in covariance.tilted)
    # the velocity of a move beside such a rest does not count
    at = pair.rows(made)[1] == list(pair.kinds).index("rotation")
    size = np.sqrt(np.diag(expected))[at]
    off = (found - expected)[np.ix_(at, at)] / np.outer(size, size)
    assert len(off) == 6
    assert np.abs(off).max() < 5 * np.sqrt(2 / draws)


def square(values, covariance, biases):
    """Return chi square and its degrees of freedom where biases, derivatives (n, q), are free."""
    white = np.linalg.solve(np.linalg.cholesky(covariance), np.column_stack([values, biases]))
    q = np.linalg.qr(white[:, 1:][:, np.any(biases, axis=0)])[0]
    left = white[:, 0] - q @ (q.T @ white[:, 0])
    return np.array([left @ left, len(left) - q.shape[1]])


# of both sensors among all parameters: slow noise has its mean over the rests in them
BIASES = np.r_[6:9, 18:21]


def test_errors_at_the_truth_have_the_predicted_covariance():
    truth = planned(example_truth(), poses=20, move_s=(1.0, 2.0), temperature=None)
    found = {}
    for seed in range(SEEDS):
        made = recording(truth, 100 + seed)
        pair, x = true_pair(truth, made)
        (r, jacobian), kinds = pair.model_at(x, made).residuals(x), pair.rows(made)[1]
        covariance = pair.covariance_at(x, made).by(pair.noise)
        groups = {kind: kinds == k for k, kind in enumerate(pair.kinds)} | {"all": kinds >= 0}
        for kind, rows in groups.items():
            own = covariance[np.ix_(rows, rows)]
            more = square(r[rows], own, jacobian[np.ix_(rows, BIASES)])
            found[kind] = found.get(kind, 0) + more
    for kind, (chi2, dof) in found.items():
        assert chi2 / dof == pytest.approx(1, abs=3 * np.sqrt(2 / dof)), kind


def test_a_walk_of_the_rate_is_common_to_rotations_and_the_poses_beside_them():
    noise = replace(TRUTH.gyroscope.noise, B=(0.0, 0.0, 0.0), K=(3e-5, 3e-5, 3e-5))
    truth = example_truth(gyroscope=replace(TRUTH.gyroscope, noise=noise))
    together, alone = np.zeros(2), np.zeros(2)
    for seed in range(SEEDS):
        made = recording(truth, seed)
        pair, x = true_pair(truth, made, moves=False)
        r, jacobian = pair.model_at(x, made).residuals(x)
        covariance = pair.covariance_at(x, made).by(pair.noise)
        n, first = len(made.poses), made.rotations.first
        apart = covariance.copy()
        apart[: 4 * n, 4 * n :] = apart[4 * n :, : 4 * n] = 0
        # an error of the rate turns gravity as one of the bias does: less what the mean of the
        # poses at both ends makes of it
        less = np.eye(len(r))[4 * n :]
        turned = (-jacobian[4 * n :, 18:21] / truth.gyroscope.K).reshape(-1, 2, 3)
        for k, pose in enumerate(first):
            for end in n + 3 * np.array([pose, pose + 1]):
                less[2 * k : 2 * k + 2, end : end + 3] -= turned[k] / 2
        biases = less @ jacobian[:, BIASES[:3]]
        together += square(less @ r, less @ covariance @ less.T, biases)
        alone += square(less @ r, less @ apart @ less.T, biases)
    off = 3 * np.sqrt(2 / together[1])
    assert together[0] / together[1] == pytest.approx(1, abs=off)
    # as if rates and rotations had nothing in common
    assert alone[0] / alone[1] < 1 - off
