"""Disturbances of simulated static sessions: none invented, the published sizes found."""

from functools import partial

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from imuloop.core.samples import CHANNELS
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from seeds import seeds
from segment.logs import static_log

SETTINGS = SegmentSettings()
N = 720_000


def is_cut(samples, settings=SETTINGS):
    samples = samples.assign(t=np.arange(len(samples)) / 100)
    return len(segment_session(samples, "static", settings)[0]) > 1


def coloured_noise(seed):
    """White noise, flicker of a phone's size, a walk, warm-up, a day's temperature, rounding."""
    rng = np.random.default_rng(seed)
    x = static_log(seed, N)[list(CHANNELS)].to_numpy(copy=True)
    size = np.array([5e-4, 5e-4, 1e-3, 5e-5, 3e-5, 3e-5])
    for time_constant in (1, 10, 100, 1000):
        a = np.exp(-0.01 / time_constant)
        drive = rng.normal(size=(N, 6)) * np.sqrt(1 - a * a)
        x += lfilter([1], [1, -a], drive, axis=0) * size
    x += np.cumsum(rng.normal(size=(N, 6)), axis=0) * [1e-5, 1e-5, 1e-5, 1e-7, 1e-6, 1e-6]
    u = np.linspace(0, 1, N)[:, None]
    x += np.array([0.1, -0.05, 0.2, 0.01, -0.005, 0.01]) * (1 - np.exp(-u / 0.15))
    x += 0.05 * np.sin(6 * np.pi * u)
    x[:, 3:] = np.round(x[:, 3:] / 0.00106) * 0.00106
    return pd.DataFrame(x, columns=CHANNELS)


@pytest.mark.parametrize(("kind", "seed"), [(partial(static_log, n=N), 0), (coloured_noise, 100)])
def test_an_undisturbed_session_of_two_hours_is_left_whole(kind, seed):
    """At a probability of 1 %; coloured is warm-up, temperature, walk, a quantised gyroscope."""
    assert not is_cut(kind(seed))


@seeds(12, 40)
def test_false_alarms_are_as_many_as_asked(seeds):
    """Short sessions at a probability of 20 %: 1.3 times as many are expected."""
    loose = SegmentSettings(false_alarm=0.2, shortest_static_s=0.0)
    alarms = sum(is_cut(static_log(1000 + seed, 20_000), loose) for seed in range(seeds))
    assert 1 <= alarms <= 0.48 * seeds


def tablet(samples, rng):
    """A move that lasts, of the excess of the published deviation, sqrt(0.009364² - 0.0074578²)."""
    samples.loc[470_000:, "ax"] += 0.0119


def phone(samples, rng):
    """The last ten seconds in a hand."""
    samples.loc[71_000:, "ax"] += 0.05 * rng.normal(size=1000)


def knock(samples, rng, channel):
    since = np.maximum(samples["t"].to_numpy() - 500, 0)
    ring = np.exp(-since / 0.1) * np.cos(80 * since) * (samples["t"] >= 500)
    samples[channel] += 20 * samples[channel].std() * ring


def three(samples, rng):
    """Handling for a tenth of the session, a knock, and a tilt half a minute after it."""
    samples.loc[:20_000, CHANNELS] += rng.normal(size=(20_001, 6)) * ([0.5] * 3 + [0] * 3)
    samples.loc[120_000:120_020, "az"] += 0.3
    samples.loc[123_000:, "ay"] += 0.01


# length of a session, what happens in it, start and end of each disturbance, s, and the seconds
# that are cut in all
CASES = {
    "tablet": (N, tablet, [(4700, 4700)], 30),
    "phone": (72_000, phone, [(710, 720)], 12.5),
    "knock, felt by ax": (100_000, partial(knock, channel="ax"), [(500, 500.2)], 5),
    "knock, felt by gz": (100_000, partial(knock, channel="gz"), [(500, 500.2)], 5),
    "three": (200_000, three, [(0, 200), (1200, 1200.2), (1230, 1230.01)], 280),
}


@pytest.mark.parametrize("case", CASES)
def test_a_disturbance_is_cut_tightly(case):
    n, happen, spans, most = CASES[case]
    samples = static_log(n % 7, n)
    happen(samples, np.random.default_rng(5))
    segments, _ = segment_session(samples, "static", SETTINGS)
    cut = segments[segments["kind"] == "disturbed"]
    for start, end in spans:
        covered = (cut["start_s"] <= start + 0.02) & (cut["end_s"] >= end)
        assert covered.sum() == 1, (start, cut[["start_s", "end_s"]])
    assert len(cut) == len(spans) and np.sum(cut["end_s"] - cut["start_s"]) < most
    if case == "tablet":
        levels = segments.loc[segments["kind"] == "static", "ax_mean"]
        assert np.diff(levels).item() == pytest.approx(0.0119, abs=1e-4)
