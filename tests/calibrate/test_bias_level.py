"""A bias wanders after its calibration by what flicker and walk predict."""

import numpy as np

from calibrate.devices import coefficient
from imuloop.core.noise_model import AxisNoise
from imuloop.report.tables import wander
from imuloop.simulate.noise import flicker, walk


def test_an_hour_later_a_minute_differs_by_what_flicker_and_walk_predict():
    rng, dt, n = np.random.default_rng(1), 5.0, 732
    B, K = 3e-5, 1e-6
    predicted, pulls = wander(AxisNoise(B=coefficient(B), K=coefficient(K)), 3600.0, 60.0), []
    for _ in range(1000):
        record = flicker(n, dt, B, rng) + walk(n, dt, K, rng)
        pulls.append((record[-12:].mean() - record[:12].mean()) / predicted)
    # three standard errors of the share
    assert abs(np.mean(np.abs(pulls) < 1.96) - 0.95) < 3 * np.sqrt(0.95 * 0.05 / len(pulls))
