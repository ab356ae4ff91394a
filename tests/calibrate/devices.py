"""Simulated recordings with the noise model that belongs to their truth."""

from dataclasses import replace

import numpy as np

from imuloop.calibrate.recording import record
from imuloop.core.noise_model import AxisNoise, Coefficient, NoiseModel
from imuloop.core.units import RawUnit
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import Noise

ACCELERATION_UNIT = RawUnit("m/s^2", 1.0)
RATE_UNIT = RawUnit("rad/s", 1.0)


def known_noise(truth):
    """Return the noise model that the truth declares."""

    def known(value):
        return Coefficient(float(value), (float(value), float(value)), float(value), True)

    axes = {}
    for sensor, letter in ((truth.accelerometer, "a"), (truth.gyroscope, "g")):
        for i, axis in enumerate("xyz"):
            coefficients = (known(getattr(sensor.noise, name)[i]) for name in "QNBKR")
            axes[letter + axis] = AxisNoise(*coefficients)
    return NoiseModel(truth.name, axes)


def recording(truth, seed, session="multi_position"):
    """Return the poses and rotations of a simulated session."""
    samples = simulate_session(truth, session, seed)
    segments, _ = segment_session(samples, session, SegmentSettings())
    return record([samples], [segments], 30.0)


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
    return np.array(
        [
            getattr(calibration, name[0])[tuple(int(i) for i in name[1:])]
            - getattr(truth, name[0])[tuple(int(i) for i in name[1:])]
            for name in names
        ]
    )
