"""Disturbances of simulated static sessions: none invented, the published sizes found."""

import time

import numpy as np
import pytest
from scipy.signal import lfilter

from imuloop.core.samples import CHANNELS, TIME
from imuloop.segment.disturbance import details, disturbed_samples, robust_covariance
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from segment.logs import static_log

SETTINGS = SegmentSettings()
N = 720_000
WHOLE = np.array([[0, N]])


def cut(samples):
    segments, _ = segment_session(samples, "static", SETTINGS)
    return segments[segments["kind"] == "disturbed"], segments[segments["kind"] == "static"]


def coloured(seed):
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
    return x


def test_undisturbed_sessions_of_two_hours_are_left_whole():
    """Eight at a probability of 1 % each: four white, four coloured, with warm-up, temperature,
    walk and a quantised gyroscope. Two alarms would have a probability of 0.5 %."""
    sessions = [static_log(s, N)[list(CHANNELS)].to_numpy() for s in range(4)]
    alarms = sum(disturbed_samples(x, WHOLE, 0.01, SETTINGS)[0].any() for x in sessions)
    del sessions
    alarms += sum(
        disturbed_samples(coloured(100 + s), WHOLE, 0.01, SETTINGS)[0].any() for s in range(4)
    )
    assert alarms < 2


def test_false_alarms_are_as_many_as_asked():
    """Short sessions at a probability of 20 %: the expected number is 1.3 times 20 % of 100."""
    loose = SegmentSettings(false_alarm=0.2, shortest_static_s=0.0)
    alarms = 0
    for seed in range(100):
        x = static_log(1000 + seed, 20_000)[list(CHANNELS)].to_numpy()
        alarms += disturbed_samples(x, np.array([[0, 20_000]]), 0.01, loose)[0].any()
    assert 5 <= alarms <= 40


def test_the_small_lasting_move_of_the_tablet_is_found():
    """0.012 m/s² on x near sample 470,000 of 720,000, nothing in the gyroscope: the excess of the
    published standard deviation on x over its white noise, sqrt(0.009364² - 0.0074578²), as a
    single step."""
    found = 0
    for seed in range(2):
        samples = static_log(seed, N)
        samples.loc[470_000:, "ax"] += 0.0119
        disturbed, static = cut(samples)
        found += (
            len(disturbed) == 1
            and disturbed["start_s"].item() < 4700 < disturbed["end_s"].item()
            and np.diff(disturbed[["start_s", "end_s"]]).item() < 30
            and np.diff(static["ax_mean"]).item() == pytest.approx(0.0119, abs=1e-4)
        )
    assert found == 2


def test_a_disturbance_in_the_last_ten_seconds_is_cut_with_its_time():
    """The phone's, after sample 719,000: shaken by 0.05 m/s² until the end."""
    samples = static_log(1, N)
    samples.loc[719_000:, "ax"] += 0.05 * np.random.default_rng(2).normal(size=1000)
    disturbed, static = cut(samples)
    assert disturbed["start_s"].iloc[0] == pytest.approx(7190, abs=2.5)
    assert disturbed["end_s"].iloc[-1] == pytest.approx(7200)
    assert static["end_s"].max() < 7190.1


@pytest.mark.parametrize("channel", ["ax", "gz"])
def test_a_knock_is_cut_tightly_whichever_sensor_feels_it(channel):
    samples = static_log(3, 100_000)
    t = samples[TIME].to_numpy()
    since = np.maximum(t - 500, 0)
    ring = np.exp(-since / 0.1) * np.cos(80 * since) * (t >= 500)
    samples[channel] += 20 * samples[channel].std() * ring
    disturbed, static = cut(samples)
    assert len(disturbed) == 1
    assert 498 < disturbed["start_s"].item() < 500
    assert 500.2 < disturbed["end_s"].item() < 503
    assert len(static) == 2


def test_a_tilt_beside_a_knock_and_handling_for_a_tenth_are_both_found():
    samples = static_log(4, 200_000)
    rng = np.random.default_rng(5)
    samples.loc[:20_000, CHANNELS] += rng.normal(size=(20_001, 6)) * [0.5] * 3 + [0] * 6
    samples.loc[120_000:120_020, "az"] += 0.3
    samples.loc[123_000:, "ay"] += 0.01
    disturbed, _ = cut(samples)
    for start, end in ((0, 200), (1200, 1200.2), (1230, 1230.01)):
        covered = (disturbed["start_s"] <= start + 0.02) & (disturbed["end_s"] >= end)
        assert covered.sum() == 1, (start, disturbed[["start_s", "end_s"]])
    assert np.sum(disturbed["end_s"] - disturbed["start_s"]) < 280


def test_a_single_sample_thrown_out_is_no_disturbance_but_a_large_one_is():
    samples = static_log(6, 100_000)
    samples.loc[50_000, "ax"] += 9 * 0.0089
    assert len(cut(samples)[0]) == 0
    samples.loc[50_000, "ax"] += 1.0
    assert len(cut(samples)[0]) == 1


def test_the_remainder_between_close_disturbances_is_no_static_stretch():
    samples = static_log(7, 100_000)
    for at in (40_000, 40_800):
        samples.loc[at : at + 10, "ax"] += 1.0
    disturbed, static = cut(samples)
    assert len(disturbed) == 1
    assert len(static) == 2


def test_seconds_for_two_hours_at_100_hz():
    samples = static_log(8, N)
    samples.loc[300_000:, "ax"] += 0.05
    start = time.process_time()
    segment_session(samples, "static", SETTINGS)
    assert time.process_time() - start < 5


def test_covariance_is_that_of_the_undisturbed_part_and_turns_with_the_frame():
    rng = np.random.default_rng(9)
    factor = rng.normal(size=(6, 6)) * 0.3 + np.diag([1, 2, 3, 0.01, 0.02, 0.03])
    x = rng.normal(size=(20_000, 6)) @ factor.T
    truth = factor @ factor.T
    x[:400] *= 1000
    q = np.zeros((6, 6))
    for k in (0, 3):
        q[k : k + 3, k : k + 3], _ = np.linalg.qr(rng.normal(size=(3, 3)))
    covariance = robust_covariance(x, np.zeros(6))
    # 2 % of the vectors raise the scale by the limit at most, never the shape
    shape = np.linalg.solve(truth, covariance)
    eigenvalues = np.linalg.eigvals(shape).real
    assert eigenvalues.max() / eigenvalues.min() < 1.15
    assert eigenvalues.max() < 4.3
    clean = np.linalg.eigvals(np.linalg.solve(truth, robust_covariance(x[400:], np.zeros(6))))
    np.testing.assert_allclose(clean.real, 1, atol=0.1)
    turned = robust_covariance(x @ q.T, np.zeros(6))
    np.testing.assert_allclose(turned, q @ covariance @ q.T, rtol=1e-6, atol=1e-9)


def test_coefficients_depend_on_the_samples_that_they_claim():
    rng = np.random.default_rng(10)
    x = rng.normal(size=(1000, 6))
    stretches = np.array([[3, 411], [500, 1000]])
    before = {w: (c, f) for w, c, f in details(x, stretches, 7)}
    changed = x.copy()
    changed[600:620] += 1
    changed[411:500] = np.nan
    for width, c, first in details(changed, stretches, 7):
        touched = np.any(c != before[width][0], axis=1)
        allowed = (first + 3 * width - 2 > 600) & (first < 620)
        assert np.array_equal(first, before[width][1])
        assert not np.any(touched & ~allowed)
        if width > 2:
            assert touched.any()
        # orthonormal: the variance of white noise is kept on every scale
        if len(c) > 100:
            assert np.mean(before[width][0] ** 2) == pytest.approx(1, abs=0.2)


def test_a_straight_drift_leaves_nothing():
    x = np.linspace(0, 100, 5000)[:, None] * np.arange(1, 7)
    for _, c, _ in details(x, np.array([[0, 5000]]), 8):
        np.testing.assert_allclose(c, 0, atol=1e-8)
