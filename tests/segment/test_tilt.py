"""Tilts within rests: told from the drift of one sensor, which is no tilt."""

import numpy as np
import pytest

from imuloop.core.units import DEGREE
from imuloop.segment.tilt import rest_tilts, without_tilts
from segment.logs import G


def resting(seed, settles=0.0, tau=2.0, rests=25, rate=100.0, noise=(2e-3, 1e-4), drift=(0.0, 0.0)):
    """Force and rate, (3, n), of rests of 5 s, the ranges, the true tilts, and the bias.

    Each rest begins with a tilt, rad, about its own level axis, that decays. Both biases drift
    by so much in each rest, SI, which no other sensor sees.
    """
    rng, n = np.random.default_rng(seed), round(5 * rate)
    t, bias, parts, sizes = np.arange(n) / rate, rng.normal(size=3) * 0.01, [], []
    for _ in range(rests):
        up, axis = rng.normal(size=(2, 3))
        up /= np.linalg.norm(up)
        axis = np.cross(up, axis)
        axis *= settles / np.linalg.norm(axis)
        angle = np.exp(-t / tau)[:, None] * axis
        force = G * (up + np.cross(up, angle - angle[-1]))
        sizes.append(np.linalg.norm(angle - angle.mean(axis=0), axis=1))
        course = np.column_stack([force, -angle / tau + bias])
        course += np.repeat(drift, 3) * (t / t[-1])[:, None] * rng.normal(size=6)
        parts.append(course + rng.normal(size=(n, 6)) * np.repeat(noise, 3) * np.sqrt(rate))
    ranges = n * np.arange(rests)[:, None] + [0, n]
    f, w = np.split(np.concatenate(parts).T, 2)
    return f, w, ranges, np.array(sizes), bias


def test_what_one_sensor_shows_alone_is_no_tilt():
    """Protects: a sensor's own flicker and walk stay noise, whose weights are right."""
    falsely = 0
    for seed in range(40):
        # half a mg and 0.01 deg/s in five seconds, each sensor for itself
        f, w, ranges, _, bias = resting(seed, drift=((0.0, 0.0), (5e-3, 2e-4))[seed % 2])
        falsely += any(found.any() for _, found in rest_tilts(f, w, ranges, bias, 0.01))
    # one session in a hundred
    assert falsely <= 2


@pytest.mark.parametrize("tau", [1.0, 3.0])
def test_a_rest_that_settles_is_told_from_one_that_lies_still(tau):
    """Protects: what a soft surface does is taken for no noise of the sensors."""
    f, w, ranges, sizes, bias = resting(1, 0.1 * DEGREE, tau)
    kept, left = without_tilts(f, w, ranges, bias, 0.01)
    assert np.array_equal(kept, ranges) and (left > 0).mean() > 0.7
    # the tilt of each half about its own mean is less than that of the whole
    whole = np.sqrt((sizes**2).mean(axis=1))
    assert 0.4 < np.median(left[left > 0] / whole[left > 0]) < 1
