"""The model for MATLAB's imuSensor, taken and simulated as it does."""

import re

import numpy as np
import pytest

from export.devices import (
    MATLAB_IMU_SENSOR,
    K,
    N,
    device,
    fitted,
    g_sensitivity,
    warm_device,
    warm_samples,
)
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, SENSORS
from imuloop.effects.temperature import BiasTemperature

# flicker of every axis of the device
B = 3e-5
SHORT = {"accelerometer": "accel", "gyroscope": "gyro"}


def assigned(text):
    """Return what a MATLAB script assigns: arrays by name, text as it stands."""
    values = {}
    text = "\n".join(line.split("%")[0] for line in re.split(r"\r|\n", text))
    for name, value in re.findall(r"^([\w.]+) = (.*?);\s*$", text.replace("...\n", ""), re.M):
        if value.startswith("["):
            rows = [row.split() for row in value.strip("[]").split(";")]
            value = np.squeeze(np.array(rows, dtype=float))
        values[name] = value
    return values


def imu_sensor(board, truth):
    model, logged = assigned(MATLAB_IMU_SENSOR.text(board)), truth.copy()
    warmer = truth["temperature"].to_numpy()[:, None] - 25
    f = truth[list(ACCELERATION)].to_numpy()
    # it reads gravity less acceleration, the negative of specific force
    for name, u, sign in (("accel", -f, -1), ("gyro", truth[list(ANGULAR_RATE)].to_numpy(), 1)):
        reading = u @ (model[f"{name}.AxesMisalignment"] / 100).T + model[f"{name}.ConstantBias"]
        reading = reading + warmer * model.get(f"{name}.TemperatureBias", np.zeros(3))
        if name == "gyro" and "gSensitivity" in model:
            reading += f @ model["gSensitivity"].T
        logged[list(ACCELERATION if name == "accel" else ANGULAR_RATE)] = sign * reading
    return logged


@pytest.mark.parametrize("warm", [True, False])
def test_imu_sensor_measures_what_the_calibration_takes_back(warm):
    line, other = fitted(BiasTemperature(1, 18.0), (5e-3,)), fitted(BiasTemperature(1), (4e-4,))
    board = warm_device(accelerometer=(line,) * warm, gyroscope=(*(other,) * warm, g_sensitivity()))
    truth = warm_samples()
    back = board.calibration.apply(imu_sensor(board, truth))
    np.testing.assert_allclose(back, truth, rtol=0, atol=1e-12)


def test_imu_sensor_has_the_densities_of_our_model():
    board = device()
    model = assigned(MATLAB_IMU_SENSOR.text(board))
    for name, axes in SENSORS.items():
        of = f"{SHORT[name]}."
        assert model[f"{of}NoiseDensity"].tolist() == [N[axis] for axis in axes]
        assert model[f"{of}RandomWalk"].tolist() == [K[axis] for axis in axes]
        assert model[f"{of}BiasInstability"].tolist() == [B] * 3
        assert model[f"{of}NoiseType"] == "'single-sided'"
    assert model["accel.BiasInstabilityCoefficients"] == "fractalcoef(1000)"
