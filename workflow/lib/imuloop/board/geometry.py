"""How the frames of a board's devices lie to each other: rotation and lever arm of each."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

from imuloop.board.agreement import calibration_errors
from imuloop.calibrate.gyroscope import cross_matrix
from imuloop.core.errors import ImuloopError

# samples of a mean that is taken twice, of both sides of the equation alike: what is near half the
# sampling rate is knocks, which no two devices sample alike
SMOOTHED = 5
# s; longer motion is cut into parts that scatter independently, and fewer say nothing of scatter
PART_S, LEAST_PARTS, LEAST_ROWS = 2.0, 10, 8
# Tukey's biweight, 95 % efficient; median length of a vector of three standard normal errors
BIWEIGHT, MEDIAN_LENGTH, ITERATIONS = 4.685, 1.538, 20
# takes M and β, row by row, to the turn that M is for its antisymmetric part
TO_TURN = np.zeros((3, 3, 4))
TO_TURN[range(3), [2, 0, 1], [1, 2, 0]], TO_TURN[range(3), [1, 2, 0], [2, 0, 1]] = 0.5, -0.5
TO_TURN = TO_TURN.reshape(3, 12)


@dataclass(frozen=True)
class Pose:
    """A device beside the first one: x_first = C x_device.

    `rotation`, C, (3, 3), and `rotation_std` about the first one's axes, rad, (3,); `arm` from the
    first one's place, on its axes, and `arm_std`, m, (3,).
    """

    rotation: np.ndarray
    rotation_std: np.ndarray
    arm: np.ndarray
    arm_std: np.ndarray


def poses(shared, calibrations):
    """Return the Pose of each device of a Shared motion, all beside the first one.

    The differences of specific force along the motion give the arm r, angular rates and gravity at
    rest the rotation C = exp(φ) C₀, both by robust least squares:

        C f − f₀ = α × r + ω × (ω × r) + ψ × C f + b
        w₀ − C₀ w = φ × C₀ w + S C₀ w + b',  and the same of f at rest

    with ω the mean rate of all devices, α its slope, and ψ, b, S (symmetric), b' what the
    calibrations leave. The first accelerometer's place is the origin: an arm that all share shows
    in no difference. The σ of C holds the errors of both calibrations.

    Raises
    ------
    ImuloopError
        If there is too little motion.
    """
    rows = np.flatnonzero(shared.moving)
    edges, t = [0], shared.t[rows]
    while edges[-1] < len(t):
        edges.append(int(np.searchsorted(t, t[edges[-1]] + PART_S)))
    part = np.repeat(np.arange(len(edges) - 1), np.diff(edges))
    keep = np.bincount(part)[part] >= LEAST_ROWS
    rows, part = rows[keep], np.unique(part[keep], return_inverse=True)[1]
    if (count := len(np.unique(part))) < LEAST_PARTS:
        raise ImuloopError(f"motion of {count} times {PART_S:g} s at most, {LEAST_PARTS} needed")
    f, w, still = _smooth(shared.f)[:, rows], _smooth(shared.w)[:, rows], shared.at_rest(shared.f)
    starts = [np.eye(3), *(Rotation.align_vectors(w[0], own)[0].as_matrix() for own in w[1:])]
    f, w, still = (np.einsum("kij,knj->kni", starts, own) for own in (f, w, still))
    together = np.einsum("kij,knj->ni", starts, shared.w) / len(w)
    # a spline's slope has 99.9 % at a twelfth of the sampling rate, a central difference 96 %
    slope = CubicSpline(shared.t, together)(shared.t, 1)
    levers = cross_matrix(slope) + cross_matrix(together) @ cross_matrix(together)
    levers = _smooth(levers[None])[0, rows]
    found = [Pose(np.eye(3), *np.zeros((3, 3)))]
    for k, start in enumerate(starts[1:], 1):
        arm, arm_std = fit([levers, cross_matrix(f[k]), _ones(f[k])], f[k] - f[0], part, part)
        pair = calibrations[0], calibrations[k]
        turns = [_turn(w[[0, k]], start, part, part, [c.gyroscope for c in pair])]
        if (rests := len(still[k])) >= LEAST_PARTS:
            of_each, of_all = np.arange(rests), np.zeros(rests)
            sensors = [c.accelerometer for c in pair]
            turns.append(_turn(still[[0, k]], start, of_each, of_all, sensors))
        values, variances = np.array(turns).swapaxes(0, 1)
        variance = 1 / (1 / variances).sum(axis=0)
        turn = Rotation.from_rotvec(variance * (values / variances).sum(axis=0)).as_matrix()
        found.append(Pose(turn @ start, np.sqrt(variance), arm[:3], arm_std[:3]))
    return found


def _turn(x, start, part, alike, sensors):
    """Return the turn φ, rad, and its variance with the errors of both sensors' calibrations.

    Of vectors that both devices show, (2, n, 3), the second's turned by C₀ already.
    """
    columns = [-cross_matrix(x[1]), _symmetric(x[1]), _ones(x[1])]
    turn, std = fit(columns, x[0] - x[1], part, alike)
    frames = [TO_TURN @ calibration_errors(sensor) @ TO_TURN.T for sensor in sensors]
    return turn[:3], std[:3] ** 2 + np.diag(frames[0] + start @ frames[1] @ start.T)


def fit(columns, values, part, alike):
    """Return robust least-squares parameters of vectors, (n, 3), and their standard errors.

    Errors within a part are not independent: σ is that of the jackknife, which leaves out a part at
    a time (Bell and McCaffrey, Survey Methodology 28 (2002) 169). Rows that are `alike` have errors
    of one size. Parts are in order, from zero on; the columns are (n, 3, p) each.
    """
    design = np.concatenate(columns, axis=2)
    starts, squares = np.flatnonzero(np.diff(part, prepend=-1)), design.swapaxes(1, 2) @ design
    x, weights = np.zeros(design.shape[2]), np.ones(len(part))
    for _ in range(ITERATIONS):
        of_x = np.einsum("nij,ni->nj", design, values - design @ x)
        x = x + np.linalg.solve(np.tensordot(weights, squares, 1), weights @ of_x)
        length = pd.Series(np.linalg.norm(values - design @ x, axis=1))
        # of a log without noise there is no size
        size = (length.groupby(alike).transform("median") / MEDIAN_LENGTH + 1e-12).to_numpy()
        inside = np.maximum(1 - (length.to_numpy() / (BIWEIGHT * size)) ** 2, 0.0)
        weights = inside**2 / size**2
    # with residuals their weights change, too
    of_x = np.einsum("nij,ni->nj", design, values - design @ x)
    bent = 4 * inside / (BIWEIGHT * size**2) ** 2
    slopes = (
        weights[:, None, None] * squares - bent[:, None, None] * of_x[:, :, None] * of_x[:, None]
    )
    slopes, scores = (np.add.reduceat(each, starts) for each in (slopes, weights[:, None] * of_x))
    left = np.linalg.solve(slopes.sum(axis=0) - slopes, scores[..., None])[..., 0]
    return x, np.sqrt((len(left) - 1) * left.var(axis=0))


def _symmetric(x):
    """Return the derivative of S x by the six elements of a symmetric matrix, (n, 3, 6)."""
    columns = np.einsum("ia,nb->niab", np.eye(3), x)
    columns = columns + columns.swapaxes(2, 3)
    return columns[..., *np.triu_indices(3)]


def _ones(x):
    return np.broadcast_to(np.eye(3), (len(x), 3, 3))


def _smooth(values):
    return uniform_filter1d(uniform_filter1d(values, SMOOTHED, axis=1), SMOOTHED, axis=1)
