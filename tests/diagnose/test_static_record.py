"""Static records: a constant bias against the noise model."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from imuloop.core.noise_model import AxisNoise, Coefficient, NoiseModel
from imuloop.core.samples import CHANNELS
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.diagnose.static_record import MOST_MEANS, diagnose_static, level_fit, window_means

RATE, WHITE = 10.0, 1e-3


def noise():
    white = AxisNoise(N=Coefficient(WHITE, (WHITE, WHITE), WHITE, True))
    return NoiseModel("d", dict.fromkeys(CHANNELS, white))


def record(seed, drift=0.0, jump=0.0):
    """Return window means of 40 min of white noise, with a drift, and a jump at half-time."""
    n = int(2400 * RATE)
    t = np.arange(n) / RATE
    x = np.random.default_rng(seed).normal(scale=WHITE * np.sqrt(RATE), size=(n, 6))
    x += drift * t[:, None] + jump * (t > 1200)[:, None]
    samples = pd.DataFrame({"t": t, **dict(zip(CHANNELS, x.T, strict=True))})
    segments = pd.DataFrame(
        {"start_s": [0, 1190, 1210], "end_s": [1190, 1210, 2400],
         "kind": ["static", "disturbed", "static"]}
    )  # fmt: skip
    return window_means(samples, segments, 60.0)


def diagnosed(made, axes=slice(3, 6), sensor="gyroscope"):
    return diagnose_static({"s": made}, noise(), axes, "rad/s", sensor, DiagnoseSettings())


def test_white_noise_is_at_its_floor():
    contents = [diagnosed(record(seed)) for seed in range(20)]
    assert sum(c["verdict"] == "consistent" for c in contents) >= 18
    ratios = [c["residuals"]["bias"]["before"] / c["residuals"]["bias"]["floor"] for c in contents]
    assert np.mean(ratios) == pytest.approx(1, abs=0.1)


def test_a_drift_is_above_the_floor_and_nothing_explains_it():
    content = diagnosed(record(0, drift=1e-6))
    assert content["verdict"] == "unexplained"
    assert content["residuals"]["bias"]["chi2_before"] > 2


def test_after_a_disturbance_the_accelerometer_may_lie_otherwise():
    made = record(0, jump=0.01)
    still = diagnosed(made, slice(0, 3), "accelerometer")
    assert still["verdict"] == "consistent"
    assert diagnosed(made)["verdict"] == "unexplained"


def test_windows_lie_whole_in_undisturbed_stretches():
    made = record(0)
    assert len(made.windows) == 2 * 19
    assert not np.any((made.windows[:, 1] > 1190) & (made.windows[:, 0] < 1210))


def test_a_short_record_says_what_is_needed():
    made = record(0)
    short = type(made)(made.windows[:10], made.stretch[:10], made.means[:10])
    content = diagnosed(short)
    assert content["verdict"] == "not_testable"
    assert "at least 16 min at rest" in content["why"]


def test_levels_of_white_noise_are_plain_means():
    values = np.random.default_rng(1).normal(size=30)
    design = np.repeat(np.eye(2), 15, axis=0)
    bias, chi2 = level_fit(values, 4 * np.eye(30), design)
    np.testing.assert_allclose(bias, [values[:15].mean(), values[15:].mean()])
    assert chi2 == pytest.approx(((values - design @ bias) ** 2).sum() / 4)


def test_stretches_too_short_to_predict_each_other_are_not_testable():
    made = record(0)
    # every window a stretch of its own, then every block of time one
    for stretch in (np.arange(38), np.arange(38) * 8 // 38):
        content = diagnosed(replace(made, stretch=stretch), slice(0, 3), "accelerometer")
        assert content["verdict"] == "not_testable"
        assert content["why"]


def test_a_long_record_is_averaged_over_longer_windows():
    t = np.arange(0, 400 * 3600.0, 60.0)
    samples = pd.DataFrame({"t": t, **dict.fromkeys(CHANNELS, np.zeros(len(t)))})
    segments = pd.DataFrame({"start_s": [0.0], "end_s": [400 * 3600.0], "kind": ["static"]})
    made = window_means(samples, segments, 60.0)
    assert len(made.means) <= MOST_MEANS
    np.testing.assert_allclose(np.diff(made.windows, axis=1), 720.0)
