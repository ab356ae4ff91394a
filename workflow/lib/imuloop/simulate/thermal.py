"""Temperature: how a device follows its surroundings, and what its thermometer shows of it."""

import numpy as np
from scipy.signal import lfilter


def lagged(x, dt, tc):
    """Return the first-order lag ``tc dy/dt = x - y`` of a signal, from ``y = x`` on.

    Exact for a signal that is linear between its samples.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Signal.
    dt, tc : float
        Distance of samples and time constant, s; 0 leaves the signal as it is.
    """
    if not tc:
        return x
    phi = np.exp(-dt / tc)
    share = (1 - phi) * tc / dt
    return lfilter([1 - share, share - phi], [1, -phi], x, zi=[share * x[0]])[0]


def read_out(thermometer, temperature, dt, seed):
    """Return the temperature that is logged, degC.

    Parameters
    ----------
    thermometer : Thermometer
        Lag, noise and step.
    temperature : ndarray, shape (n,)
        Of the device, degC.
    dt : float
        Distance of samples, s.
    seed : SeedSequence
        Of its noise.
    """
    shown = lagged(temperature, dt, thermometer.lag_s)
    if thermometer.noise:
        noise = np.random.default_rng(seed).standard_normal(len(shown))
        shown = shown + thermometer.noise * noise
    return np.round(shown / thermometer.step) * thermometer.step if thermometer.step else shown
