"""The mean of the angular rate at rest: where it must not be so small, and where it may."""

import numpy as np
import pytest

from imuloop.core.gravity import EARTH_RATE
from imuloop.core.samples import CHANNELS
from imuloop.core.units import DEGREE
from imuloop.ingest.rest_means import RestMeans

STEPS = (None, None, None)
# white noise of a fair MEMS gyroscope, (rad/s)/sqrt(Hz)
WHITE = 1e-4
# Earth's rotation, as a level device sees it some way from the pole, rad/s
EARTH = EARTH_RATE * np.array([0.6, 0.0, 0.8])


def at_rest(seed, hours, *, white=WHITE, mean=EARTH, rate=20.0):
    rng = np.random.default_rng(seed)
    n = round(hours * 3600 * rate)
    x = dict(zip(CHANNELS, rng.normal(size=(6, n)) * white * np.sqrt(rate), strict=True))
    x["az"] += 9.8
    for name, value in zip(CHANNELS[3:], mean, strict=True):
        x[name] += value
    return x


def figures(x, rate=20.0, steps=STEPS, rows=1 << 17):
    means = RestMeans(rate)
    for start in range(0, len(x["ax"]), rows):
        means.add({name: x[name][start : start + rows] for name in CHANNELS})
    return means.figures(steps)


def test_earth_alone_is_mean_enough():
    for seed in range(5):
        found = figures(at_rest(seed, hours=0.5))
        assert not found["tracked"]
    found = figures(at_rest(1, hours=4, rate=4.0), rate=4.0)
    assert found["rate"] == pytest.approx(EARTH_RATE, rel=0.1)
    assert not found["tracked"]


def test_no_mean_at_all_is_reported_once_noise_resolves_earth():
    none = (0.0, 0.0, 0.0)
    # noise that cannot show it
    for seed in range(5):
        assert not figures(at_rest(seed, hours=0.1, mean=none))["tracked"]
    found = figures(at_rest(1, hours=2.0, mean=none))
    assert found["tracked"]
    assert found["upper"] < EARTH_RATE / 2


def test_a_bias_that_wanders_is_no_fault():
    rng = np.random.default_rng(3)
    x = at_rest(3, hours=1.0)
    for name in CHANNELS[3:]:
        x[name] = x[name] + np.cumsum(rng.normal(size=len(x[name]))) * 2e-8
    assert not figures(x)["tracked"]


@pytest.mark.parametrize("seconds", [1.0, 10.0, 60.0])
def test_a_running_mean_taken_away_is_reported(seconds):
    x = at_rest(4, hours=1.5, mean=(0.01, -0.02, 0.005))
    for name in CHANNELS[3:]:
        n = round(seconds * 20)
        total = np.concatenate([np.zeros(n), np.cumsum(x[name])])
        x[name] = x[name] - (total[n:] - total[:-n]) / np.minimum(np.arange(len(x[name])) + 1, n)
    found = figures(x)
    assert found["tracked"]
    assert found["noise_share"] < 0.5


def test_rates_in_rad_taken_as_degrees_are_reported_where_the_bias_is_small():
    # 2 deg/h of bias; declared deg/s, so made 57 times smaller than they are
    x = at_rest(5, hours=1.0, white=1e-5, mean=EARTH + 2 * DEGREE / 3600)
    assert not figures(x)["tracked"]
    for name in CHANNELS[3:]:
        x[name] = x[name] * DEGREE
    assert figures(x)["tracked"]
