"""The figure that chooses the multiples."""

import numpy as np
import pytest

from imuloop.segment.multiples import attitudes, choose_multiples, expected_error
from imuloop.segment.settings import SegmentSettings

G = 9.80665


def directions(n, seed):
    u = np.random.default_rng(seed).normal(size=(n, 3))
    return u / np.linalg.norm(u, axis=1)[:, None]


def measured(u, noise=0.0, seed=0):
    # scale, misalignment and bias of a consumer part; noise of a pose mean, of g
    M = np.array([[1.01, -0.004, 0.009], [0, 0.985, 0.02], [0, 0, 1.004]])
    noise = np.random.default_rng(seed).normal(size=u.shape) * noise * G
    return G * u @ M.T + [0.3, -0.5, 0.2] + noise


def features(f):
    x, y, z = (f / G).T
    return np.column_stack([x * x, y * y, z * z, x * y, x * z, y * z, x, y, z])


@pytest.mark.parametrize("n", [15, 40])
def test_figure_bounds_the_error_found_in_other_attitudes(n):
    """Monte-Carlo: calibrate with n poses by least squares, then measure 2000 other attitudes."""
    elsewhere = features(measured(directions(2000, 1)))
    made, figure = [], []
    for seed in range(100):
        f = measured(directions(n, 2 + seed), 1e-3, seed)
        solution = np.linalg.lstsq(features(f), np.ones(n), rcond=None)[0]
        made.append(np.sqrt(np.mean((elsewhere @ solution / 2 - 0.5) ** 2)))
        figure.append(expected_error(f))
    ratio = np.array(figure) / made
    # a 95 % limit of σ: between a fifth below and three times the error made
    assert np.mean(ratio > 0.8) > 0.9
    assert 1.0 < np.median(ratio) < 3.0


def test_figure_grows_as_poses_are_lost_and_is_the_same_in_any_frame():
    f = measured(directions(40, 3), 1e-3)
    few = [expected_error(f[:n]) for n in (5, 14, 40)]
    assert few[0] > few[1] > few[2]
    q, _ = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))
    assert expected_error(f @ q) == pytest.approx(few[2], rel=1e-6)


def test_a_pair_that_loses_poses_and_one_that_blurs_them_lose():
    f = np.repeat(measured(directions(30, 6), 2e-4), 100, axis=0)
    every = np.column_stack([np.arange(30) * 100, np.arange(30) * 100 + 90])

    def detect(pair):
        accelerometer, gyroscope = pair
        if gyroscope > 3:  # reaches into the next attitude: the mean is short
            return every[:-1] + np.array([0, 25])
        return every[: 12 if accelerometer == 1 else 30]

    settings = SegmentSettings(accelerometer_multiples=(1, 2), gyroscope_multiples=(3, 10))
    best, error = choose_multiples(f.T, detect, settings)
    assert best == (2, 3)
    assert error == expected_error(attitudes(f.T, every, settings.same_attitude))
    assert choose_multiples(f.T, lambda _: every[:0], settings) == (None, np.inf)
