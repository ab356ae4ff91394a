"""Families of devices simulated in numpy alone: truth of a type, measurements of each device.

Every parameter has a spread between devices and its own errors; both are known here.
"""

import numpy as np

from imuloop.core.noise_model import AxisNoise, Coefficient, NoiseModel
from imuloop.core.units import RawUnit
from imuloop.family.family import Member, tried_effects
from imuloop.model.calibration import Calibration
from imuloop.model.sensor_calibration import SensorCalibration

NAMES = {
    "accelerometer": "T01 T02 T12 K0 K1 K2 b0 b1 b2".split(),
    "gyroscope": "T01 T02 T10 T12 T20 T21 K0 K1 K2 b0 b1 b2".split(),
}
UNITS = {"accelerometer": "m/s^2", "gyroscope": "rad/s"}
CHANNELS = "ax ay az gx gy gz".split()
EVERY = [f"{s}.{n}" for s, names in NAMES.items() for n in names]
EVERY += [f"{c}.{term}" for c in CHANNELS for term in "NBK"]
NOTHING = {"sensors": {s: {"poses": {"candidates": []}} for s in NAMES}}


def sensor(name, values, std):
    """Return the calibration of a sensor by value and standard error of each parameter."""
    T, K, b = np.eye(3), np.ones(3), np.zeros(3)
    for key in NAMES[name]:
        place, value = [int(i) for i in key[1:]], values[f"{name}.{key}"]
        if key[0] == "T":
            T[tuple(place)] = value
        else:
            {"K": K, "b": b}[key[0]][place[0]] += value
    covariance = np.diag([std[f"{name}.{key}"] ** 2 for key in NAMES[name]])
    unit = RawUnit(UNITS[name], 1.0)
    names = tuple(NAMES[name])
    return SensorCalibration(unit, T, K, b, names, covariance, method="multi_position")


def coefficient(logarithm, std):
    value, low, high = np.exp(logarithm + 1.959964 * std * np.array([0, -1, 1]))
    return Coefficient(float(value), (float(low), float(high)), float(high), True)


def member(name, values, std, diagnosis=NOTHING):
    """Return a device by value and standard error of each of `EVERY` parameter."""
    axes = {
        c: AxisNoise(**{t: coefficient(values[f"{c}.{t}"], std[f"{c}.{t}"]) for t in "NBK"})
        for c in CHANNELS
    }
    sensors = (sensor(s, values, std) for s in NAMES)
    calibration = Calibration(name, 9.80665, *sensors)
    return Member(name, calibration, NoiseModel(name, axes), tried_effects(diagnosis))


class Family:
    """The truth of a type, and measurements of its devices, `y` and `std`, (n, p)."""

    def __init__(self, seed, count=50, unlike=()):
        rng, p = np.random.default_rng(seed), len(EVERY)
        self.spread = 10 ** rng.uniform(-4, -2, p)
        self.mean = self.spread * rng.normal(0, 3, p)
        # from far better than the spread to worse than it, and devices differ
        self.std = self.spread * 10 ** rng.uniform(-1.3, 0.2, p) * rng.lognormal(0, 0.3, (count, p))
        true = self.mean + self.spread * rng.normal(size=(count, p))
        self.y = true + self.std * rng.normal(size=(count, p))
        self.names = [f"d{k}" for k in range(count)]
        # devices that stand out, by five spreads of the measured parameter
        self.odd = {}
        for name in unlike:
            k, sign = int(rng.integers(count)), rng.choice([-1, 1])
            at = [i for i, parameter in enumerate(EVERY) if parameter.startswith(name)]
            far = 5 * np.hypot(self.spread[at], self.std[k, at])
            self.y[k, at] = self.mean[at] + sign * far
            self.odd[f"d{k}"] = name

    def members(self):
        """Return the devices."""
        devices = []
        for k, name in enumerate(self.names):
            values, std = (dict(zip(EVERY, rows[k], strict=True)) for rows in (self.y, self.std))
            devices.append(member(name, values, std))
        return devices
