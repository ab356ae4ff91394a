"""Simulated recordings with the noise model that belongs to their truth."""

from dataclasses import replace

import numpy as np

from imuloop.calibrate.poses import Poses
from imuloop.calibrate.recording import record
from imuloop.core.noise_model import AxisNoise, Coefficient, NoiseModel
from imuloop.core.units import RawUnit
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import Noise

ACCELERATION_UNIT = RawUnit("m/s^2", 1.0)
RATE_UNIT = RawUnit("rad/s", 1.0)


class IndependentMeans:
    """Stands in for a noise model: each pose's mean has a variance of its own, SI."""

    def __init__(self, variance):
        self.variance = variance

    def pose_mean_covariance(self, windows):
        return np.tile(np.eye(len(windows)) * self.variance, (6, 1, 1))


def known(value):
    return Coefficient(float(value), (float(value), float(value)), float(value), True)


def known_noise(truth):
    """Return the noise model that the truth declares."""
    axes = {}
    for sensor, letter in ((truth.accelerometer, "a"), (truth.gyroscope, "g")):
        for i, axis in enumerate("xyz"):
            coefficients = (known(getattr(sensor.noise, name)[i]) for name in "QNBKR")
            axes[letter + axis] = AxisNoise(*coefficients)
    return NoiseModel(truth.name, axes)


def planned(truth, session="multi_position", **changes):
    """Return a device with one of its sessions alone, the plan of it changed."""
    return replace(truth, sessions={session: replace(truth.sessions[session], **changes)})


def recorded(*samples):
    segments = [segment_session(s, "multi_position", SegmentSettings())[0] for s in samples]
    return record(list(samples), segments, 30.0)


def recording(truth, seed, session="multi_position"):
    return recorded(simulate_session(truth, session, seed))


def poses_of(f):
    """Return poses of 5 s each with these mean specific forces, (n, 3), at rest."""
    n = len(f)
    start = 10.0 * np.arange(n)
    return Poses(
        np.zeros(n, int), np.zeros(n, int), start, start + 5, np.full(n, 5.0), np.full(n, 500), f,
        np.zeros((n, 3)), np.full((n, 6), 1e-6), None,
    )  # fmt: skip


def slopes(function, x, step=1e-6):
    """Return the derivative of a function by differences, a column per parameter."""
    steps = np.eye(len(x)) * step
    return np.transpose([(function(x + h) - function(x - h)) / (2 * step) for h in steps])


def noiseless(truth):
    """Return the same device with next to no noise: none at all leaves no level of rest."""
    whisper = Noise(N=(1e-7, 1e-7, 1e-7))
    return replace(
        truth,
        accelerometer=replace(truth.accelerometer, noise=whisper),
        gyroscope=replace(truth.gyroscope, noise=whisper),
    )


def difference(calibration, truth, names):
    """Return estimate less truth of the parameters `names`, T01 … b2."""
    places = [(name[0], tuple(int(i) for i in name[1:])) for name in names]
    return np.array([getattr(calibration, k)[i] - getattr(truth, k)[i] for k, i in places])


def scores(calibration, truth, names):
    """Return (estimate - truth) / standard error of the parameters `names`."""
    return difference(calibration, truth, names) / [calibration.std[name] for name in names]
