"""Gravity's direction carried through a stretch of rests and rotations, by gyroscope and filter."""

from dataclasses import dataclass

import numpy as np

from imuloop.core.rotation import exponential, matrix, multiply, prefix_product, step_vectors

# gains of the filter, 1/s and 1/s²: those of the article's experiments
K_P, K_I = 1.0, 0.3
# s of the rest before a stretch in which the filter settles, and of the rest after it
SETTLE = 30.0
# s; a filter's step where samples come faster, the turn within it integrated with all of them
FILTER_STEP = 0.01


@dataclass(frozen=True)
class Stretch:
    """A stretch of a log from a rest, through rotations and rests, to a rest.

    Its poses, (p,); the time of its samples, s, (k,), which are that piece of the log; first and
    last sample of each pose, (p,), counted from the first of the stretch.
    """

    poses: np.ndarray
    t: np.ndarray
    piece: slice
    arrive: np.ndarray
    leave: np.ndarray


def stretches(recording, block):
    """Return the longest stretches whose rotations follow each other within a block, in order.

    A rotation belongs to the block (ndarray of int, shape (n,), of each pose) that it starts from.
    """
    first = recording.rotations.first
    cuts = np.flatnonzero((np.diff(first) != 1) | (np.diff(block[first]) != 0)) + 1
    groups = [g for g in np.split(first, cuts) if len(g)]
    return [_stretch(recording, np.append(g, g[-1] + 1)) for g in groups]


def _stretch(recording, index):
    poses = recording.poses
    t = recording.logs[poses.session[index[0]]].t
    start, end = poses.start_s[index], poses.end_s[index]
    # `end_s` is open: the pose's last sample is the one before it
    arrive, leave = np.searchsorted(t, start), np.searchsorted(t, end) - 1
    arrive[0] = max(arrive[0], np.searchsorted(t, end[0] - SETTLE))
    leave[-1] = min(leave[-1], np.searchsorted(t, start[-1] + SETTLE))
    piece = slice(arrive[0], leave[-1] + 1)
    return Stretch(index, t[piece], piece, arrive - piece.start, leave - piece.start)


def attitudes(w, t):
    """Return the attitude at each sample, quaternions that take its axes to those at the start.

    Takes the angular rate, rad/s, shape (..., k, 3), and the time, s, (k,).
    """
    turned = prefix_product(exponential(step_vectors(w, np.diff(t))))
    start = np.broadcast_to([1.0, 0, 0, 0], (*turned.shape[:-2], 1, 4))
    return np.concatenate([start, turned], axis=-2)


def angle(a, b):
    """Return the angle between directions, shape (..., 3), rad."""
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(axis=-1))


def gyroscope_errors(q, stretch, u):
    """Return the error of gravity's direction that the gyroscope alone carries along.

    ``u(t) = C(t)ᵀ C(t₀) u(t₀)`` with the attitude C, quaternions q, shape (..., k, 4), against the
    direction u at the p rests, (p, 3). Gives the errors from each rest to the first sample of the
    next, rad, (..., p - 1), and from the first rest to the first and the last sample of each of the
    others, (..., p - 1, 2).
    """
    arrive, leave = (matrix(q[..., at, :]) for at in (stretch.arrive, stretch.leave))
    fixed = np.einsum("...pij,pj->...pi", leave, u)
    once = np.einsum("...pji,...pj->...pi", arrive[..., 1:, :, :], fixed[..., :-1, :])
    marks = np.stack([arrive, leave], axis=-3)[..., 1:, :, :, :]
    through = np.einsum("...pmji,...j->...pmi", marks, fixed[..., 0, :])
    return angle(once, u[1:]), angle(through, u[1:, None])


def filter_errors(runs):
    """Return the errors of gravity's direction that a filter carries along, side by side.

    Takes of each stretch attitudes q, (r, k, 4), and specific force f, m/s^2, (r, k, 3), of r
    models, the stretch, and the direction u at its p rests. Gives of each the errors at the first
    and the last sample of each rest but the first, rad, (r, p - 1, 2).
    """
    steps = [_filter_steps(q, f, stretch) for q, f, stretch, _ in runs]
    longest, errors = max(len(force) for _, _, force, _ in steps), []
    sides = [np.zeros((longest, len(steps), *each.shape[1:])) for each in steps[0][1:]]
    for k, own in enumerate(steps):
        for side, each in zip(sides, own[1:], strict=True):
            # what ends earlier stays where it is
            side[len(each) :, k] = np.eye(3) if each.ndim == 4 else 0.0
            side[: len(each), k] = each
    found = mahony(*sides)
    for k, ((at, *_), (_, _, stretch, u)) in enumerate(zip(steps, runs, strict=True)):
        wanted = np.searchsorted(at, _wanted(stretch)) - 1
        errors.append(angle(found[wanted, k], u[1:, None, None]).transpose(2, 0, 1))
    return errors


def _wanted(stretch):
    """Return the first and the last sample of each rest but the first, (p - 1, 2)."""
    return np.column_stack([stretch.arrive, stretch.leave])[1:]


def _filter_steps(q, f, stretch):
    """Return the samples that are a filter's steps, and turns, force and time of `mahony`."""
    t = stretch.t
    every = max(1, round(FILTER_STEP / np.median(np.diff(t))))
    at = np.unique(np.concatenate([np.arange(0, len(t), every), _wanted(stretch).ravel()]))
    back = q[:, at[:-1]] * np.array([1, -1, -1, -1])
    turns = matrix(multiply(back, q[:, at[1:]])).swapaxes(-1, -2)
    force = np.add.reduceat(f, at[:-1] + 1, axis=1)
    size = np.linalg.norm(force, axis=-1, keepdims=True)
    # without specific force, where the accelerometer was not read, nothing corrects
    force = np.divide(force, size, out=np.zeros_like(force), where=size > 0).swapaxes(0, 1)
    return at, turns.swapaxes(0, 1), force, np.diff(t[at])


def mahony(turns, force, steps):
    """Return gravity's direction by the explicit complementary filter, shape (s, n, r, 3).

    With the direction v that is estimated and a that is measured, σ = a × v,

        v̇ = v × (w - β + k_P σ),   β̇ = -k_I σ

    the turn by w - β is taken first, then the correction. Takes the matrix of each of s steps of r
    filters of n stretches, all beside each other, (s, n, r, 3, 3), from the axes before to those
    after it; the direction of specific force, (s, n, r, 3), which they start from; and the time
    steps, s, (s, n).

    References
    ----------
    Mahony, Hamel, Pflimlin, "Nonlinear complementary filters on the special orthogonal group",
    IEEE Transactions on Automatic Control 53 (2008), section V, here for one direction.
    """
    found, v = np.empty((*force.shape, 1)), force[0, ..., None]
    # -[β ×] holds the bias; with σ = a × v its change -k_I σ adds k_I (a vᵀ - v aᵀ)
    slant = np.zeros((*v.shape[:-1], 3))
    steps = steps[..., None, None, None]
    for k, (turn, a, dt) in enumerate(zip(turns, force[..., None], steps, strict=True)):
        v = turn @ v
        v = v + dt * (slant @ v)
        outer = K_I * dt * a @ v.swapaxes(-1, -2)
        slant = slant + outer - outer.swapaxes(-1, -2)
        # v × σ = a - v (v · a)
        pull = K_P * dt * a
        v = v * (1 - v.swapaxes(-1, -2) @ pull) + pull
        v = found[k] = v / np.sqrt(v.swapaxes(-1, -2) @ v)
    return found[..., 0]
