"""The error of a bias concerns its mean level over the rests; its later wander comes on top."""

import numpy as np

from calibrate.devices import (
    calibrate_recording,
    coefficient,
    plan_session,
    record_samples,
    without_noise,
)
from imuloop.core.noise_model import AxisNoise, NoiseModel
from imuloop.core.samples import CHANNELS
from imuloop.report.tables import wander
from imuloop.simulate.noise import flicker, walk, white
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import example_truth
from seeds import seeds

RATE = 25.0
TRUTH = plan_session(example_truth(rate=RATE), poses=20, initial_rest_s=20.0, temperature=None)
QUIET = without_noise(TRUTH)
# N, B and K of both sensors, SI
NOISE = {"a": (1.5e-3, 3e-4, 2e-5), "g": (1.6e-4, 3e-5, 2e-6)}


def shares(pulls):
    """Return the share within 1.96 standard errors, and by how much chance moves it."""
    return np.mean(np.abs(pulls) < 1.96), 3 * np.sqrt(0.95 * 0.05 / np.size(pulls))


@seeds(8, 170)
def test_the_interval_of_a_bias_covers_its_level_over_the_rests(seeds):
    axes = {
        c: AxisNoise(**dict(zip("NBK", map(coefficient, NOISE[c[0]]), strict=True)))
        for c in CHANNELS
    }
    pulls = []
    for seed in range(100, 100 + seeds):
        log, rng = simulate_session(QUIET, "multi_position", seed), np.random.default_rng([seed, 9])
        slow, how = np.zeros((6, len(log))), (len(log), 1 / RATE)
        for channel, course in zip(CHANNELS, slow, strict=True):
            N, B, K = NOISE[channel[0]]
            course += flicker(*how, B, rng) + walk(*how, K, rng)
            log[channel] += course + white(*how, N, rng)
        made = record_samples(log)
        found = calibrate_recording(made, NoiseModel("d", axes), TRUTH.gravity)
        ends = np.searchsorted(made.logs[0].t, [made.poses.start_s, made.poses.end_s]).T
        resting = np.concatenate([np.arange(*each) for each in ends])
        levels = np.split(slow[:, resting].mean(axis=1), 2)
        for own, true, level in zip(
            found, (TRUTH.accelerometer, TRUTH.gyroscope), levels, strict=True
        ):
            pulls.append((own.b - true.b - level) / [own.std[f"b{i}"] for i in range(3)])
    share, chance = shares(pulls)
    assert abs(share - 0.95) < chance


def test_an_hour_later_a_minute_differs_by_what_flicker_and_walk_predict():
    rng, dt, n = np.random.default_rng(1), 5.0, 732
    B, K = 3e-5, 1e-6
    predicted, pulls = wander(AxisNoise(B=coefficient(B), K=coefficient(K)), 3600.0, 60.0), []
    for _ in range(1000):
        record = flicker(n, dt, B, rng) + walk(n, dt, K, rng)
        pulls.append((record[-12:].mean() - record[:12].mean()) / predicted)
    share, chance = shares(pulls)
    assert abs(share - 0.95) < chance
