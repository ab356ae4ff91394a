"""From true values to logged ones: the sensors and the thermometer of a simulated device."""

import numpy as np
from scipy.signal import lfilter

from imuloop.simulate.noise import axis_noise


def output(truth, x, channels):
    """Return the output of a sensor before noise, ``u = T⁻¹ x + e(u)``, SI, (n, 3).

    Without noise, u equals ``K (raw - b)`` of the logged values raw. The effects e depend on the
    output u itself, so the equation is solved by repeated substitution. Each of four rounds
    multiplies the error by de/du, a few per cent at most.

    Parameters
    ----------
    truth : SensorTruth
        The sensor: misalignment T, scale factors K, biases b and effects e.
    x : ndarray, shape (n, 3)
        True specific force or angular rate on body axes at n samples, SI.
    channels : callable
        Function of an output of the sensor, (n, 3), SI, that returns the `Channels`: the inputs of
        the effects, such as this output, the time and the temperature.
    """
    ideal = x @ np.linalg.inv(truth.T).T
    effects = [effect.output for effect in truth.effects]
    if truth.extra is not None:
        effects.append(truth.extra)
    u = ideal
    for _ in range(4 if effects else 0):
        inputs = channels(u)
        u = ideal + sum(effect(inputs) for effect in effects)
    return u


def logged(truth, u, bias, dt, seed):
    """Return the logged values ``raw = (u + noise)/K + b``, rounded, raw units, (n, 3).

    Parameters
    ----------
    truth : SensorTruth
        The sensor: scale factors K, noise and the step of rounding.
    u : ndarray, shape (n, 3)
        Output before noise at n samples, SI.
    bias : ndarray, shape (3,)
        The bias b in this power cycle, raw units.
    dt : float
        Time between two samples, s.
    seed : SeedSequence
        Seed of the random numbers of the noise.
    """
    raw = np.empty_like(u)
    for axis, child in enumerate(seed.spawn(3)):
        noise = axis_noise(len(u), dt, truth.noise, axis, child)
        raw[:, axis] = (u[:, axis] + noise) / truth.K[axis] + bias[axis]
    return rounded(raw, truth.step)


def rounded(x, step):
    """Return the array `x` rounded to multiples of `step`, or unchanged if `step` is 0."""
    return np.round(x / step) * step if step else x


def lagged(x, dt, tc):
    """Return the response y of a first-order lag, ``tc dy/dt = x - y``, to n samples of x, (n,).

    `x`, (n,), are samples `dt` s apart, and `tc` is the time constant, s. y starts at the first
    value of x. The result is exact if x is linear between the samples. If `tc` is 0, there is no
    lag and the result is x.
    """
    if not tc:
        return x
    # over a step y keeps the share `kept` of its value. The rest comes from x, whose change within
    # the step enters with the mean of exp(-s/tc) over it
    kept = np.exp(-dt / tc)
    mean = (1 - kept) * tc / dt
    return lfilter([1 - mean, mean - kept], [1, -kept], x, zi=[mean * x[0]])[0]


def logged_temperature(thermometer, temperature, dt, seed):
    """Return n samples of the temperature that a thermometer logs, degC, (n,).

    `thermometer` is a Thermometer, with its lag, noise and rounding. `temperature`, (n,), is the
    temperature of the device, degC, `dt` the time between two samples, s, and `seed` the
    SeedSequence of the noise.
    """
    noise = np.random.default_rng(seed).standard_normal(len(temperature))
    reading = lagged(temperature, dt, thermometer.lag_s) + thermometer.noise * noise
    return rounded(reading, thermometer.step)
