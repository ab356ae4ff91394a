"""The model for MATLAB's imuSensor, taken and simulated as it does."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from export.devices import (
    MATLAB_IMU_SENSOR,
    RATE,
    K,
    N,
    device,
    fitted,
    g_sensitivity,
    warm_device,
    warm_samples,
)
from imuloop.core.noise_model import Coefficient
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, SENSORS
from imuloop.effects.temperature import BiasTemperature

# flicker of every axis of the device
B = 3e-5
SHORT = {"accelerometer": "accel", "gyroscope": "gyro"}


def allan(x, m):
    means = x.reshape(*x.shape[:-1], -1, m).mean(axis=-1)
    return np.sqrt(np.mean(np.diff(means) ** 2, axis=-1) / 2)


def assigned(text):
    """Return what a MATLAB script assigns: arrays by name, text as it stands."""
    found = {}
    text = "\n".join(line.split("%")[0] for line in re.split(r"\r|\n", text))
    for name, value in re.findall(r"^([\w.]+) = (.*?);\s*$", text.replace("...\n", ""), re.M):
        if value.startswith("["):
            rows = [row.split() for row in value.strip("[]").split(";")]
            value = np.squeeze(np.array(rows, dtype=float))
        found[name] = value
    return found


def imu_sensor(board, truth):
    found, logged = assigned(MATLAB_IMU_SENSOR.text(board)), truth.copy()
    warmer = truth["temperature"].to_numpy()[:, None] - 25
    f = truth[list(ACCELERATION)].to_numpy()
    # it reads gravity less acceleration, the negative of specific force
    for name, u, sign in (("accel", -f, -1), ("gyro", truth[list(ANGULAR_RATE)].to_numpy(), 1)):
        reading = u @ (found[f"{name}.AxesMisalignment"] / 100).T + found[f"{name}.ConstantBias"]
        reading = reading + warmer * found.get(f"{name}.TemperatureBias", np.zeros(3))
        if name == "gyro" and "gSensitivity" in found:
            reading += f @ found["gSensitivity"].T
        logged[list(ACCELERATION if name == "accel" else ANGULAR_RATE)] = sign * reading
    return logged


@pytest.mark.parametrize("warm", [True, False])
def test_imu_sensor_measures_what_the_calibration_takes_back(warm):
    line, other = fitted(BiasTemperature(1, 18.0), (5e-3,)), fitted(BiasTemperature(1), (4e-4,))
    board = warm_device(accelerometer=(line,) * warm, gyroscope=(*(other,) * warm, g_sensitivity()))
    truth = warm_samples()
    back = board.calibration.apply(imu_sensor(board, truth))
    np.testing.assert_allclose(back, truth, rtol=0, atol=1e-12)


def test_imu_sensors_noise_has_the_allan_deviation_of_our_model():
    board = device()
    found = assigned(MATLAB_IMU_SENSOR.text(board))
    for name, axes in SENSORS.items():
        of = f"{SHORT[name]}."
        assert found[f"{of}NoiseDensity"].tolist() == [N[axis] for axis in axes]
        assert found[f"{of}RandomWalk"].tolist() == [K[axis] for axis in axes]
        assert found[f"{of}BiasInstability"].tolist() == [B] * 3
        assert found[f"{of}NoiseType"] == "'single-sided'"
    rng, n, m, poles = np.random.default_rng(1), 400_000, 100, 1000
    assert found["accel.BiasInstabilityCoefficients"] == f"fractalcoef({poles})"
    white = found["accel.NoiseDensity"][0] * np.sqrt(RATE) * rng.standard_normal(n)
    walk = np.cumsum(found["accel.RandomWalk"][0] / np.sqrt(RATE) * rng.standard_normal(n))
    # Kasdin, equation 116, alpha = 1
    k = np.arange(1, poles + 1)
    a = np.concatenate([[1], np.cumprod((k - 1.5) / k)])
    flicker = lfilter([1], a, found["accel.BiasInstability"][0] * rng.standard_normal(n))
    noise, unseen = board.noise.axes["ax"], Coefficient()
    processes = (
        replace(noise, K=unseen, B=unseen),
        replace(noise, N=unseen, B=unseen),
        replace(noise, N=unseen, K=unseen),
    )
    expected = [np.sqrt(each.allan_variance(m / RATE)) for each in processes]
    # 4,000 means: 1.5 %; the flicker's floor holds to a few per cent over 100 samples
    np.testing.assert_allclose(allan(np.array([white, walk, flicker]), m), expected, rtol=0.06)
