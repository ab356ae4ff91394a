"""Turns by hand at 2 kHz, and the log of a slower logger; nothing of it knows a spectrum.

A turn begins with a jerk at the edge that it is tipped over, follows the minimum-jerk course with
corrections and tremor, and ends as the device lands on an edge and rocks: angular rate jumps within
the milliseconds of a contact.
"""

from itertools import pairwise

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, TIME

RATE = 2000
# shortest and longest contact, s
CONTACT = 0.004, 0.04
# from the point that it turns about to the sensor, m
ARM = np.array([0.04, -0.02, 0.03])


def _contact(t, at, rng):
    """Return a step of one at an instant, as long as a contact, its torque half a sine."""
    x = (t - at) / np.exp(rng.uniform(*np.log(CONTACT)))
    return (1 - np.cos(np.pi * np.clip(x, 0, 1))) / 2


def bell(x):
    """Return the minimum-jerk course of a rate over 0 < x < 1, its integral one."""
    x = np.clip(x, 0, 1)
    return 30 * (x - x * x) ** 2


def turn(rng):
    """Return the angular rate of a turn, rad/s, (n, 3), at rest at both ends."""
    seconds, begin = rng.uniform(0.4, 1.5), 0.2
    t = np.arange(round((seconds + 1.0) * RATE)) / RATE
    angle, axis = rng.uniform(0.5, 2.6), rng.standard_normal(3)
    x = (t - begin) / seconds
    w = np.outer(bell(x) * angle / seconds, axis / np.linalg.norm(axis))
    for _ in range(rng.integers(1, 4)):
        lasts = rng.uniform(0.15, 0.4)
        start = begin + rng.uniform(0, max(seconds - lasts, 0.01))
        w += np.outer(bell((t - start) / lasts) / lasts, 0.15 * angle * rng.standard_normal(3))
    tremor, axis = 2 * np.pi * rng.uniform(8, 12), rng.standard_normal(3)
    wave = 64 * np.clip(x - x * x, 0, 1) ** 3 * np.sin(tremor * t + rng.uniform(0, 2 * np.pi))
    w += np.outer(wave * 0.0026 * tremor, axis / np.linalg.norm(axis))
    lands = begin + seconds * rng.uniform(0.75, 0.97)
    w *= 1 - _contact(t, lands, rng)[:, None]
    edges = [lands, *lands + np.cumsum(rng.uniform(0.02, 0.1, rng.integers(1, 5)))]
    jumps = [(*pair, rng.uniform(0.1, 0.7)) for pair in pairwise(edges)]
    if rng.random() < 0.7:
        jumps.append((begin, begin + rng.uniform(0.02, 0.06), 0.3))
    for start, end, size in jumps:
        rocks = _contact(t, start, rng) - _contact(t, end, rng)
        w += np.outer(rocks, size * rng.standard_normal(3))
    return w


def log(rate, seed, truth, poses=40):
    """Return the log of a session of such turns of a device, and of rests between them.

    The device turns about a point next to the sensor, so that contacts are knocks.
    """
    rng = np.random.default_rng(seed)
    pieces = [np.zeros((50 * RATE, 3))]
    for _ in range(poses):
        pieces += [turn(rng), np.zeros((round(rng.uniform(4, 6) * RATE), 3))]
    w = np.concatenate(pieces)
    moving = np.flatnonzero(w[:-1].any(axis=1) | w[1:].any(axis=1))
    body, up = np.zeros((len(w), 3)), Rotation.random(rng=rng)
    whole, last = up.as_matrix()[2], 0
    body[:] = whole
    C = np.eye(3)
    # gravity's direction on body axes follows every turn
    steps = Rotation.from_rotvec((w[moving] + w[moving + 1]) / (2 * RATE)).as_matrix()
    for at, step in zip(moving, steps, strict=True):
        body[last : at + 1] = C.T @ whole
        C, last = C @ step, at + 1
    body[last:] = C.T @ whole
    change = np.gradient(w, 1 / RATE, axis=0)
    f = truth.gravity * body + np.cross(change, ARM) + np.cross(w, np.cross(w, ARM))
    step = round(RATE / rate)
    kept, columns = slice(rng.integers(step), None, step), {}
    for values, names, sensor in (
        (f, ACCELERATION, truth.accelerometer),
        (w, ANGULAR_RATE, truth.gyroscope),
    ):
        u = values[kept] @ np.linalg.inv(sensor.T).T
        u = u + np.array(sensor.noise.N) * np.sqrt(rate) * rng.standard_normal(u.shape)
        columns |= dict(zip(names, (u / sensor.K + sensor.b).T, strict=True))
    return pd.DataFrame({TIME: np.arange(len(u)) / rate, **columns})
