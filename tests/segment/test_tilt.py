"""Slow tilts in a static session: cut where both sensors see them; no drift is taken for one."""

import numpy as np
import pytest

from imuloop.core.samples import Samples
from imuloop.core.units import DEGREE
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from imuloop.segment.tilt import rest_tilts, tilts, without_tilts
from seeds import seeds
from segment.logs import G, frame, rests_of

# white noise of a phone's sensors, m/s^2/sqrt(Hz) and rad/s/sqrt(Hz)
NOISE = 1e-3, 6e-5


def tilting_log(degrees, over, seed, seconds=3600.0, rate=20.0, noise=NOISE):
    """A log that tilts about a level axis, at a steady rate in the middle of the session."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate)) / rate
    angle = degrees * DEGREE * np.clip((t - (seconds - over) / 2) / over, 0, 1)
    axis = np.append(rng.normal(size=2), 0.0)
    axis /= np.linalg.norm(axis)
    up = np.cos(angle)[:, None] * [0, 0, 1.0] + np.outer(np.sin(angle), np.cross([0, 0, 1], axis))
    force = G * up + rng.normal(size=(len(t), 3)) * noise[0] * np.sqrt(rate)
    turning = np.gradient(angle, 1 / rate)[:, None] * axis
    bias = rng.normal(size=3) * 0.01
    return frame(t, force, turning + bias + rng.normal(size=(len(t), 3)) * noise[1] * np.sqrt(rate))


@pytest.mark.parametrize(("degrees", "over"), [(1, 300), (2, 600), (5, 600), (5, 1200)])
def test_a_slow_tilt_is_cut_and_its_two_levels_are_kept(degrees, over):
    segments, metadata = segment_session(tilting_log(degrees, over, 0), "static", SegmentSettings())
    assert metadata["slow_tilts"] >= 1
    kept = rests_of(segments)
    # nothing that is kept turns gravity by more than a part of the tilt
    turn = np.degrees(kept[["ax_std", "ay_std"]].to_numpy().max() / G)
    assert turn < 0.15 * degrees + np.degrees(NOISE[0] * np.sqrt(20) / G)
    assert (kept["end_s"] - kept["start_s"]).sum() > 3600 - 1.3 * over - 60


def drifting_log(seed, seconds=3600.0, rate=2.0):
    """A log at rest whose biases follow one course of temperature, of any size and shape."""
    rng = np.random.default_rng(seed)
    n = round(seconds * rate)
    x = np.linspace(0, 1, n)
    courses = (
        x,
        np.sin(np.pi * x),
        1 - np.exp(-x * rng.uniform(2, 20)),
        np.sin(2 * np.pi * x * rng.integers(1, 6)),
        np.cumsum(rng.normal(size=n)) / np.sqrt(n),
    )
    course = courses[seed % len(courses)][:, None]
    # up to 80 mg, and 0.06 deg/s
    force = course * 10 ** rng.uniform(-2, -0.1) * rng.normal(size=3) + [0, 0, G]
    turning = course * 10 ** rng.uniform(-6, -3) * rng.normal(size=3)
    walk = np.cumsum(rng.normal(size=(n, 3)), axis=0) * 10 ** rng.uniform(-9, -6.5)
    white = rng.normal(size=(2, n, 3)) * np.sqrt(rate) * np.reshape(NOISE, (2, 1, 1))
    return frame(np.arange(n) / rate, force + white[0], turning + walk + white[1])


@seeds(20, 60)
def test_biases_that_drift_together_are_no_tilt(seeds):
    cut = 0
    for seed in range(seeds):
        samples = drifting_log(seed)
        cut += len(tilts(Samples(samples), np.array([[0, len(samples)]]), 0.5)) > 0
    # one in a hundred of these, of which most drift far more than a sensor does
    assert cut <= 2 * seeds / 60


def tilted_rests(
    seed, settles=0.0, tau=2.0, rests=25, rate=100.0, noise=(2e-3, 1e-4), drift=(0.0, 0.0)
):
    """Force and rate, (3, n), of rests of 5 s, the ranges, the true tilts, and the bias.

    Each rest begins with a tilt, rad, about its own level axis, that decays. Both biases drift
    by `drift` in each rest, SI, which no other sensor sees.
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
        f, w, ranges, _, bias = tilted_rests(seed, drift=((0.0, 0.0), (5e-3, 2e-4))[seed % 2])
        falsely += any(found.any() for _, found in rest_tilts(f, w, ranges, bias, 0.01))
    # one session in a hundred
    assert falsely <= 2


@pytest.mark.parametrize("tau", [1.0, 3.0])
def test_a_rest_that_settles_is_told_from_one_that_lies_still(tau):
    """Protects: the settling of a soft surface is not taken for noise of the sensors."""
    f, w, ranges, sizes, bias = tilted_rests(1, 0.1 * DEGREE, tau)
    kept, left = without_tilts(f, w, ranges, bias, 0.01)
    assert np.array_equal(kept, ranges) and (left > 0).mean() > 0.7
    # the tilt of each half about its own mean is less than the tilt of the whole
    whole = np.sqrt((sizes**2).mean(axis=1))
    assert 0.4 < np.median(left[left > 0] / whole[left > 0]) < 1
