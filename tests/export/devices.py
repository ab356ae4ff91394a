"""Devices to export: one with all that a calibration can hold, one of which nothing is known."""

from dataclasses import replace

import numpy as np
import pandas as pd

from imuloop.core.noise_model import AxisNoise, Coefficient, NoiseModel
from imuloop.core.samples import CHANNELS, SENSORS
from imuloop.core.units import DEGREE, RawUnit
from imuloop.effects.other_sensor import GSensitivity
from imuloop.effects.temperature import BiasTemperature, ScaleTemperature
from imuloop.export.export import FORMATS
from imuloop.export.values import Exported
from imuloop.model.calibration import Calibration
from imuloop.model.effect import Channels, FittedEffect, find_effect
from imuloop.model.sensor_calibration import SensorCalibration

KALIBR, OPENVINS, VINS_FUSION, ORB_SLAM3, ALLAN_VARIANCE_ROS, ROS, *_ = FORMATS
IMU_TK_ACC, IMU_TK_GYRO, PX4, ARDUPILOT, *_ = FORMATS[6:]
MATLAB_IMU_SENSOR, C_HEADER = FORMATS[10:]
COUNT, DEGREES = RawUnit("count", 0.0024, 32768.0), RawUnit("deg/s", DEGREE)
# N, K, B of each axis; the worst: az and gy, of K ax and gz
N = dict(zip(CHANNELS, (7e-4, 8e-4, 1.1e-3, 6.1e-5, 7.7e-5, 6.5e-5), strict=True))
K = dict(zip(CHANNELS, (1.2e-4, 3e-5, 4e-5, 1e-6, 2e-6, 5e-6), strict=True))
# of these axes the walk was not seen
UNSEEN = ("ay", "gz")
RATE = 200.0
# degC, of the data
COLD, WARM = -5.0, 45.0
HOSTILE = (
    'x\ny: 1\r\nacc_n: 9\u2028%YAML:1.0\x85"a": {b\x0b\x0c: [1\x00\x1b[2J\u202e\ud800 '
    "{{ 1 // 0 }} {% x # */ ??/ \\"
)


def of_calibrated(board, values):
    """Return by axis the density of calibrated samples, of those as logged on independent axes."""
    densities = {}
    for name, axes in SENSORS.items():
        calibration = board.sensor(name)
        M = calibration.T @ np.diag(calibration.K) / calibration.raw_unit.scale
        variance = M**2 @ np.array([values[axis] ** 2 for axis in axes])
        densities |= dict(zip(axes, np.sqrt(variance), strict=True))
    return densities


def _coefficient(value, seen=True):
    return Coefficient(value if seen else None, (0.9 * value, value), value, seen)


def _axis(name):
    return AxisNoise(
        N=_coefficient(N[name]), K=_coefficient(K[name], name not in UNSEEN), B=_coefficient(3e-5)
    )


def _accelerometer():
    T = np.array([[1, 2e-3, -4e-3], [0, 1, 1.5e-3], [0, 0, 1]])
    scale = 0.0024 * np.array([1.01, 0.985, 1.003])
    return SensorCalibration(
        COUNT, T, scale, 32768 + np.array([41.3, -12.7, 88.1]), method="multi_position"
    )


def _gyroscope(*effects):
    T = np.array([[1, 3e-3, -1e-3], [-6e-3, 1, 2.5e-3], [7e-3, -2e-3, 1]])
    K = DEGREE * np.array([1.02, 0.99, 1.004])
    return SensorCalibration(
        DEGREES, T, K, np.array([0.31, -1.2, 0.07]), effects=effects, method="multi_position"
    )


def g_sensitivity(seed=1):
    values = np.random.default_rng(seed).normal(0, 2e-4, 9)
    effect = GSensitivity()
    return FittedEffect(effect, dict(zip(effect.parameters, values, strict=True)), {})


FOUND = (g_sensitivity(),)


def device(label="Board A", effects=FOUND):
    return Exported(
        "board",
        label,
        Calibration("board", 9.8072, _accelerometer(), _gyroscope(*effects)),
        NoiseModel("board", {name: _axis(name) for name in CHANNELS}),
        RATE,
        ("ax: a note",),
    )


def unknown(label="Board B"):
    reason = "no session could be used"
    nominal = (SensorCalibration.nominal(unit, reason) for unit in (COUNT, DEGREES))
    noise = NoiseModel("board", dict.fromkeys(CHANNELS, AxisNoise()))
    return Exported("board", label, Calibration("board", 9.80665, *nominal), noise, None)


def with_sensor(exported, name, **changes):
    sensor = replace(exported.sensor(name), **changes)
    return replace(exported, calibration=replace(exported.calibration, **{name: sensor}))


def without_flicker(exported):
    axes = {name: replace(noise, B=Coefficient()) for name, noise in exported.noise.axes.items()}
    return replace(exported, noise=replace(exported.noise, axes=axes))


def turning_device(board=None, accelerometer=None):
    """Return a device with what rate and its change do to specific force; or with other effects."""
    board = board or device()
    sizes = {"lever_arm": 5e-3, "rate_sensitivity": 0.02}
    if accelerometer is None:
        rng = np.random.default_rng(5)
        effects = [(find_effect(name)(), size) for name, size in sizes.items()]
        accelerometer = tuple(
            FittedEffect(e, {n: float(rng.normal(0, size)) for n in e.parameters}, {})
            for e, size in effects
        )
    return with_sensor(board, "accelerometer", effects=accelerometer)


def samples(n=200, seed=0):
    """Return samples as ingest writes them, SI: turns of up to 200 deg/s at up to 2 g."""
    rng = np.random.default_rng(seed)
    table = pd.DataFrame(rng.uniform(-1, 1, (n, 6)) * ([20.0] * 3 + [3.5] * 3), columns=CHANNELS)
    table.insert(0, "t", np.arange(n) / RATE)
    return table


def fitted(effect, sizes, seed=3):
    """Return an effect with parameters of these sizes, three a size."""
    values = np.random.default_rng(seed).uniform(0.5, 1, 3 * len(sizes)) * np.repeat(sizes, 3)
    values[1::3] *= -1
    names = effect.parameters
    return FittedEffect(effect, dict(zip(names, map(float, values), strict=True)), {})


def warm_device(label="Board A", accelerometer=None, gyroscope=None):
    cubic, square = BiasTemperature(3, 18.0), BiasTemperature(2, 21.0)
    if accelerometer is None:
        accelerometer = (fitted(cubic, (5e-3, 2e-4, 4e-6)), fitted(ScaleTemperature(18.0), (2e-4,)))
    if gyroscope is None:
        gyroscope = (fitted(square, (4e-4, 6e-6)), g_sensitivity())
    board = with_sensor(device(label, gyroscope), "accelerometer", effects=accelerometer)
    return replace(board, temperature_range=(COLD, WARM))


def narrow_device(board=None, accelerometer=(10.0, 30.0), gyroscope=(10.0, 30.0)):
    """Return a device, mostly the warm one, its effects seen at these temperatures, in 0.5 g."""
    board, n = board or warm_device(), 200
    f = 4.9 * np.sin(np.linspace(0, 6, n)[:, None] + np.arange(3))
    for name, ends in zip(SENSORS, (accelerometer, gyroscope), strict=True):
        seen = [Channels(np.zeros(n), f, f, np.linspace(*ends, n))]
        effects = tuple(e.with_ranges(seen) for e in board.sensor(name).effects)
        board = with_sensor(board, name, effects=effects)
    return board


def warm_samples(cold=COLD, warm=WARM):
    table = samples()
    table["temperature"] = np.clip(np.linspace(COLD, WARM, len(table)), cold, warm)
    return table


def calibration_with(board, effects, aligned=True):
    """Return the calibration of a device with only these effects, and T where `aligned`."""
    for name in SENSORS:
        sensor = board.sensor(name)
        kept = tuple(e for e in sensor.effects if e.name in effects)
        board = with_sensor(board, name, T=sensor.T if aligned else np.eye(3), effects=kept)
    return board.calibration
