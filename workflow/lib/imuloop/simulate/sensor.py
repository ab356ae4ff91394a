"""A sensor: from what is true to what is logged."""

import numpy as np

from imuloop.simulate.noise import axis_noise


def output(truth, x, channels):
    """Return the sensor's output before noise, ``u = K (raw - b) = T⁻¹ x + e(u)``.

    e depends on the output itself: solved by repeated substitution, whose error falls by the
    size of de/du, a few per cent at most, in each of four rounds.

    Parameters
    ----------
    truth : SensorTruth
        The sensor.
    x : ndarray, shape (n, 3)
        True specific force (m/s^2) or angular rate (rad/s) on body axes.
    channels : callable
        Gives `Channels` of an output.

    Returns
    -------
    ndarray, shape (n, 3)
        Output on the sensor's own axes, SI.
    """
    ideal = x @ np.linalg.inv(truth.T).T
    effects = [effect.output for effect in truth.effects]
    if truth.extra is not None:
        effects.append(truth.extra)
    u = ideal
    for _ in range(4 if effects else 0):
        now = channels(u)
        u = ideal + sum(effect(now) for effect in effects)
    return u


def logged(truth, u, bias, dt, seed):
    """Return what is logged: ``raw = (u + noise)/K + b``, rounded to the step.

    Parameters
    ----------
    truth : SensorTruth
        The sensor.
    u : ndarray, shape (n, 3)
        Output before noise, SI.
    bias : array_like, shape (3,)
        Bias of this power cycle, raw units.
    dt : float
        Distance of samples, s.
    seed : SeedSequence
        One child an axis.

    Returns
    -------
    ndarray, shape (n, 3)
        Raw units.
    """
    raw = np.empty_like(u)
    for axis, child in enumerate(seed.spawn(3)):
        noise = axis_noise(len(u), dt, truth.noise, axis, child)
        raw[:, axis] = (u[:, axis] + noise) / truth.K[axis] + bias[axis]
    return np.round(raw / truth.step) * truth.step if truth.step else raw
