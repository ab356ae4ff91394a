"""Over simulated devices: no bias, and 95 % intervals that hold."""

import numpy as np
import pytest

from calibrate.devices import ACCELERATION_UNIT, RATE_UNIT, known_noise, recording, scores
from imuloop.calibrate import accelerometer, gyroscope
from imuloop.calibrate.calibrate import calibrate_accelerometer, calibrate_gyroscope
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.simulate.truth import example_truth

SEEDS = 8


@pytest.fixture(scope="module")
def of_devices():
    """Return (estimate - truth) / standard error of each sensor, a row a seed."""
    truth, settings = example_truth(), CalibrateSettings()
    noise, rows = known_noise(truth), {"accelerometer": [], "gyroscope": []}
    for seed in range(SEEDS):
        made = recording(truth, seed)
        force = calibrate_accelerometer(
            made.poses, noise, truth.gravity, ACCELERATION_UNIT, settings
        )
        turn = calibrate_gyroscope(made, noise, force, RATE_UNIT, settings)
        rows["accelerometer"].append(scores(force, truth.accelerometer, accelerometer.NAMES))
        rows["gyroscope"].append(scores(turn, truth.gyroscope, gyroscope.NAMES))
    return {sensor: np.array(values) for sensor, values in rows.items()}


@pytest.mark.parametrize("sensor", ["accelerometer", "gyroscope"])
def test_parameters_are_unbiased_and_intervals_cover_the_truth(of_devices, sensor):
    # the mean score has a standard error of 1/sqrt(SEEDS)
    drift = of_devices[sensor].mean(axis=0) * np.sqrt(SEEDS)
    assert np.all(np.abs(drift) < 3.3), drift
    covered = (np.abs(of_devices[sensor]) < 1.96).mean()
    assert 0.88 <= covered <= 0.99, covered
