"""A sensor and a thermometer: from what is true to what is logged."""

import numpy as np
from scipy.signal import lfilter

from imuloop.simulate.noise import axis_noise


def output(truth, x, channels):
    """Return the sensor's output before noise, ``u = K (raw - b) = T⁻¹ x + e(u)``, (n, 3), SI.

    e depends on the output itself: solved by repeated substitution, whose error falls by the
    size of de/du, a few per cent at most, in each of four rounds. Takes a SensorTruth, the true
    vectors on body axes, and what gives `Channels` of an output.
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
    """Return what is logged: ``raw = (u + noise)/K + b``, rounded to the step, (n, 3).

    Takes the output before noise, SI, and the bias of this power cycle, raw units.
    """
    raw = np.empty_like(u)
    for axis, child in enumerate(seed.spawn(3)):
        noise = axis_noise(len(u), dt, truth.noise, axis, child)
        raw[:, axis] = (u[:, axis] + noise) / truth.K[axis] + bias[axis]
    return rounded(raw, truth.step)


def rounded(x, step):
    """Return values as multiples of a step; 0 leaves them."""
    return np.round(x / step) * step if step else x


def lagged(x, dt, tc):
    """Return the first-order lag ``tc dy/dt = x - y`` of a signal, shape (n,), from ``y = x`` on.

    Exact for a signal that is linear between its samples, `dt` s apart; `tc` 0 leaves it.
    """
    if not tc:
        return x
    phi = np.exp(-dt / tc)
    share = (1 - phi) * tc / dt
    return lfilter([1 - share, share - phi], [1, -phi], x, zi=[share * x[0]])[0]


def logged_temperature(thermometer, temperature, dt, seed):
    """Return the temperature that a Thermometer logs, (n,), by that of the device, (n,), degC."""
    noise = np.random.default_rng(seed).standard_normal(len(temperature))
    shown = lagged(temperature, dt, thermometer.lag_s) + thermometer.noise * noise
    return rounded(shown, thermometer.step)
