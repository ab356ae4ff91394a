"""Simulated recordings with the noise model that belongs to their truth."""

from dataclasses import replace

import numpy as np

from imuloop.calibrate.calibrate import calibrate_sensors
from imuloop.calibrate.poses import Poses
from imuloop.calibrate.recording import Recording, record
from imuloop.calibrate.rotations import Rotations
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.noise_model import AxisNoise, Coefficient, NoiseModel
from imuloop.core.samples import CHANNELS
from imuloop.core.units import RawUnit
from imuloop.estimate.joint_fit import JointFit
from imuloop.factors.factors import Factors
from imuloop.model.state import State
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import Noise

ACCELERATION_UNIT = RawUnit("m/s^2", 1.0)
RATE_UNIT = RawUnit("rad/s", 1.0)
UNITS = {"accelerometer": ACCELERATION_UNIT, "gyroscope": RATE_UNIT}
# of no channel is it known: the variance within each pose counts alone
UNKNOWN_NOISE = NoiseModel("d", dict.fromkeys(CHANNELS, AxisNoise()))


def coefficient(value):
    return Coefficient(float(value), (float(value), float(value)), float(value), True)


def known_noise(truth):
    """Return the noise model that the truth declares."""
    axes = {}
    for sensor, letter in ((truth.accelerometer, "a"), (truth.gyroscope, "g")):
        for i, axis in enumerate("xyz"):
            coefficients = (coefficient(getattr(sensor.noise, name)[i]) for name in "QNBKR")
            axes[letter + axis] = AxisNoise(*coefficients)
    return NoiseModel(truth.name, axes)


def plan_session(truth, session="multi_position", **changes):
    """Return a device with one of its sessions alone, the plan of it changed."""
    return replace(truth, sessions={session: replace(truth.sessions[session], **changes)})


def record_samples(*samples):
    segments = [segment_session(s, "multi_position", SegmentSettings())[0] for s in samples]
    return record(list(samples), segments, 30.0)


def recording(truth, seed, session="multi_position"):
    return record_samples(simulate_session(truth, session, seed))


def calibrate_recording(recording, noise, gravity, prior=None, turns=None, units=UNITS, **settings):
    """Return the accelerometer's and the gyroscope's calibration by a recording."""
    how = units, CalibrateSettings(**settings), prior, turns
    sensors = calibrate_sensors(recording, noise, gravity, *how)
    return sensors["accelerometer"], sensors["gyroscope"]


def at_rest(f, error=1e-5):
    """Return a recording of poses of mean specific force f, (n, 3), known to standard errors.

    5 s each, on and off; without a rotation.
    """
    n = len(f)
    start, variance = 10.0 * np.arange(n), np.broadcast_to(error, n)[:, None] ** 2 * np.ones(6)
    poses = Poses(
        np.zeros(n, int), np.zeros(n, int), start, start + 5, np.full(n, 5.0), np.full(n, 500), f,
        np.zeros((n, 3)), 500 * variance, None, np.zeros((n, 6)), np.zeros(n), np.zeros((n, 2)),
        np.zeros((n, 2, 3)),
    )  # fmt: skip
    none, t, along = np.zeros(0), np.zeros((0, 2)), np.zeros((0, 2, 3))
    rotations = Rotations(
        none.astype(int), none, none, t, along, along, None, t[:, 1:] > 0,
        t[:, :0].astype(int), np.zeros((0, 0, 3, 3)), np.zeros((0, 0, 3, 3)), none, none, none > 0,
    )  # fmt: skip
    return Recording(poses, rotations)


def slopes(function, x, step=1e-6):
    """Return the derivative of a function by differences, a column per parameter."""
    steps = np.eye(len(x)) * step
    return np.transpose([(function(x + h) - function(x - h)) / (2 * step) for h in steps])


def true_parameters(truth):
    """Return the base parameters of both sensors, the accelerometer's first, (21,)."""
    a, g = truth.accelerometer, truth.gyroscope
    of_force, of_turn = a.T[np.triu_indices(3, 1)], g.T[~np.eye(3, dtype=bool)]
    return np.concatenate([of_force, a.K, a.b, of_turn, g.K, g.b])


def true_fit(truth, log, moves=True, **how):
    """Return the JointFit of a recording at the true parameters, and these.

    With the velocity of all moves, or without any; others as in Factors.
    """
    x, noise, factors = true_parameters(truth), known_noise(truth), Factors(truth.gravity, **how)
    if moves:
        factors = replace(factors, quiet=np.ones(len(log.rotations), dtype=bool))
        factors = factors.without_rotation(log, State(x), noise)
    return JointFit(factors, noise, UNITS, x), x


def without_noise(truth):
    """Return the device with almost no noise: without any noise a rest would have no level."""
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


def in_counts(sensor, scale, offset=32768.0):
    """Return the SensorCalibration, in SI, of the same sensor logged in counts."""
    unit = RawUnit("count", scale, offset)
    factor = np.array([{"K": scale, "b": 1 / scale}.get(name[0], 1.0) for name in sensor.names])
    covariance = sensor.covariance * np.outer(factor, factor)
    values = {"K": sensor.K * scale, "b": unit.from_si(sensor.b), "covariance": covariance}
    return replace(sensor, raw_unit=unit, **values)


def scores(calibration, truth, names):
    """Return (estimate - truth) / standard error of the parameters `names`."""
    return difference(calibration, truth, names) / [calibration.std[name] for name in names]
