"""The plain fit: nine parameters per sensor, equal weights, no effects, given the true rests.

With the data sheet as a prior it fits the accelerometer alone, of however few rests.
"""

import numpy as np
from scipy.optimize import least_squares

from bench.realistic.device import GRAVITY, Sensor

# of the start and the end of a rest that count to the moves: filters and stamps are late, s
MARGIN = 0.1
# an accelerometer as its data sheet has it, and its tolerance: T, K, b; error of a mean at rest
NOMINAL, SHEET = np.repeat([0.0, 1.0, 0.0], 3), np.repeat([0.02, 0.03, 0.5], 3)
KNOWN = 1e-3


def fit(t, force, rate, rests):
    """Return the accelerometer and gyroscope, each a Sensor or None, as Tedaldi's imu_tk fits them.

    `t`, (n,), and `force` and `rate`, (n, 3), are as logged, s, m/s², rad/s; `rests`, (m, 2), start
    and end, s. The first rest gives the gyroscope's bias.
    """
    pieces = [(t > start + MARGIN) & (t < end - MARGIN) for start, end in rests]
    means = np.array([force[piece].mean(axis=0) for piece in pieces])
    accelerometer = fit_accelerometer(means)
    if accelerometer is None:
        return None, None
    up = accelerometer.corrected(means)
    up /= np.linalg.norm(up, axis=1)[:, None]
    moves = [
        (t > end - MARGIN) & (t < start + MARGIN)
        for end, start in zip(rests[:-1, 1], rests[1:, 0], strict=True)
    ]
    return accelerometer, fit_gyroscope(t, rate, moves, up, rate[pieces[0]].mean(axis=0))


def fit_accelerometer(means, prior=False):
    """Return the Sensor that gives the means at rest, (m, 3), the norm of gravity.

    With the prior also where it is not determined: its rows join the norms, known to `KNOWN`.
    """

    def sensor(p):
        T = np.eye(3)
        T[np.triu_indices(3, 1)] = p[:3]
        return Sensor(T, p[3:6], p[6:])

    def residual(p):
        misfit = np.linalg.norm(sensor(p).corrected(means), axis=1) - GRAVITY
        return np.append(misfit / KNOWN, (p - NOMINAL) / SHEET) if prior else misfit

    return _solve(residual, NOMINAL, sensor)


def fit_gyroscope(t, rate, moves, up, bias):
    """Return the Sensor that turns `up`, (m, 3), from each rest to the next as was measured."""
    longest = max(move.sum() for move in moves)
    # moves of one length, a power of two: samples behind the end stand still
    length = 1 << int(longest).bit_length()
    step, first = np.zeros((len(moves), length, 1)), np.zeros((len(moves), length, 3))
    second = first.copy()
    for k, move in enumerate(moves):
        n, values = move.sum() - 1, rate[move] - bias
        step[k, :n, 0], first[k, :n], second[k, :n] = np.diff(t[move]), values[:-1], values[1:]

    def sensor(p):
        T = np.eye(3)
        T[~np.eye(3, dtype=bool)] = p[:6]
        return Sensor(T, p[6:], bias)

    def residual(p):
        candidate = Sensor(sensor(p).T, p[6:], np.zeros(3))
        turned = rotation(step, candidate.corrected(first), candidate.corrected(second))
        return (rotate_back(turned, up[:-1]) - up[1:]).ravel()

    return _solve(residual, np.repeat([0.0, 0.0, 1.0], 3), sensor)


def _solve(residual, start, sensor):
    if len(residual(start)) < len(start):
        return None
    fit = least_squares(residual, start, x_scale="jac")
    good = fit.success and np.abs(fit.x - start).max() < 0.5
    return sensor(fit.x) if good else None


def rotation(step, first, second):
    """Return the unit quaternions, scalar first, (m, 4), of rates over n steps, (m, n, 3).

    Over a step the rate goes evenly from the first to the second: Magnus to the fourth order.
    """
    angle = step * (first + second) / 2 + step**2 / 12 * np.cross(first, second)
    half = np.linalg.norm(angle, axis=2, keepdims=True) / 2
    # sin(x)/x, finite at zero
    q = np.concatenate([np.cos(half), angle / 2 * np.sinc(half / np.pi)], axis=2)
    while q.shape[1] > 1:
        q = product(q[:, ::2], q[:, 1::2])
    return q[:, 0]


def product(p, q):
    """Return the product of quaternions, (…, 4)."""
    w, v, x, u = p[..., :1], p[..., 1:], q[..., :1], q[..., 1:]
    scalar = w * x - np.sum(v * u, axis=-1, keepdims=True)
    return np.concatenate([scalar, w * u + x * v + np.cross(v, u)], axis=-1)


def rotate_back(q, v):
    """Return the directions v, (m, 3), as seen from a body that has turned by q, (m, 4)."""
    twice = 2 * np.cross(-q[:, 1:], v)
    return v + q[:, :1] * twice + np.cross(-q[:, 1:], twice)
