"""Over 40 simulated devices: no bias, and 95 % intervals that hold."""

import numpy as np
import pytest

from calibrate.devices import (
    ACCELERATION_UNIT,
    RATE_UNIT,
    difference,
    known_noise,
    recording,
)
from imuloop.calibrate import accelerometer, gyroscope
from imuloop.calibrate.calibrate import calibrate_accelerometer, calibrate_gyroscope
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.simulate.truth import example_truth

SEEDS = 40


@pytest.fixture(scope="module")
def scores():
    """Return (estimate - truth) / standard error of each sensor, a row a seed."""
    truth, settings = example_truth(), CalibrateSettings()
    noise = known_noise(truth)
    rows = {"accelerometer": [], "gyroscope": []}
    for seed in range(SEEDS):
        made = recording(truth, seed)
        force = calibrate_accelerometer(
            made.poses, noise, truth.gravity, ACCELERATION_UNIT, settings
        )
        turn = calibrate_gyroscope(made, noise, force, RATE_UNIT, settings)
        for name, fitted, true, names in (
            ("accelerometer", force, truth.accelerometer, accelerometer.NAMES),
            ("gyroscope", turn, truth.gyroscope, gyroscope.NAMES),
        ):
            std = np.array([fitted.std[n] for n in names])
            rows[name].append(difference(fitted, true, names) / std)
    return {name: np.array(values) for name, values in rows.items()}


@pytest.mark.parametrize("sensor", ["accelerometer", "gyroscope"])
def test_parameters_are_unbiased(scores, sensor):
    # the mean score of 40 devices has a standard error of 1/sqrt(40)
    drift = scores[sensor].mean(axis=0) * np.sqrt(SEEDS)
    assert np.all(np.abs(drift) < 3.3), drift


@pytest.mark.parametrize("sensor", ["accelerometer", "gyroscope"])
def test_intervals_cover_the_truth(scores, sensor):
    covered = (np.abs(scores[sensor]) < 1.96).mean()
    assert 0.90 <= covered <= 0.98, covered
