"""Slow tilts in a static session: cut where both sensors see them; no drift is taken for one."""

import numpy as np
import pytest

from imuloop.core.samples import Samples
from imuloop.core.units import DEGREE
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from imuloop.segment.tilt import tilts
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
