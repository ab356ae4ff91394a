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


def segment_static(samples):
    segments, _ = segment_session(samples, "static", SETTINGS)
    return segments[segments["kind"] == "disturbed"], segments[segments["kind"] == "static"]


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


def test_the_small_lasting_move_of_the_tablet_is_found():
    """0.012 m/s² on x near sample 470,000 of 720,000, nothing in the gyroscope: the excess of the
    published standard deviation on x over its white noise, sqrt(0.009364² - 0.0074578²), as a
    single step."""
    samples = static_log(0, N)
    samples.loc[470_000:, "ax"] += 0.0119
    disturbed, static = segment_static(samples)
    assert len(disturbed) == 1
    assert disturbed["start_s"].item() < 4700 < disturbed["end_s"].item()
    assert np.diff(disturbed[["start_s", "end_s"]]).item() < 30
    assert np.diff(static["ax_mean"]).item() == pytest.approx(0.0119, abs=1e-4)


def test_a_disturbance_in_the_last_ten_seconds_is_cut_with_its_time():
    """The phone's: shaken by 0.05 m/s² until the end."""
    samples = static_log(1, 72_000)
    samples.loc[71_000:, "ax"] += 0.05 * np.random.default_rng(2).normal(size=1000)
    disturbed, static = segment_static(samples)
    assert disturbed["start_s"].iloc[0] == pytest.approx(710, abs=2.5)
    assert disturbed["end_s"].iloc[-1] == pytest.approx(720)
    assert static["end_s"].max() < 710.1


@pytest.mark.parametrize("channel", ["ax", "gz"])
def test_a_knock_is_cut_tightly_whichever_sensor_feels_it(channel):
    samples = static_log(3, 100_000)
    since = np.maximum(samples["t"].to_numpy() - 500, 0)
    ring = np.exp(-since / 0.1) * np.cos(80 * since) * (samples["t"] >= 500)
    samples[channel] += 20 * samples[channel].std() * ring
    disturbed, static = segment_static(samples)
    assert len(disturbed) == 1 and len(static) == 2
    assert 498 < disturbed["start_s"].item() < 500
    assert 500.2 < disturbed["end_s"].item() < 503


def test_a_tilt_beside_a_knock_and_handling_for_a_tenth_are_both_found():
    samples = static_log(4, 200_000)
    rng = np.random.default_rng(5)
    samples.loc[:20_000, CHANNELS] += rng.normal(size=(20_001, 6)) * [0.5] * 3 + [0] * 6
    samples.loc[120_000:120_020, "az"] += 0.3
    samples.loc[123_000:, "ay"] += 0.01
    disturbed, _ = segment_static(samples)
    for start, end in ((0, 200), (1200, 1200.2), (1230, 1230.01)):
        covered = (disturbed["start_s"] <= start + 0.02) & (disturbed["end_s"] >= end)
        assert covered.sum() == 1, (start, disturbed[["start_s", "end_s"]])
    assert np.sum(disturbed["end_s"] - disturbed["start_s"]) < 280
