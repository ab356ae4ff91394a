"""One unbroken record of an axis: its estimate, and the lines that are found in it with 90 %."""

from dataclasses import replace

import numpy as np
from scipy.optimize import brentq
from scipy.signal import lfilter
from scipy.special import betaincinv, chndtrinc

from imuloop.noise.axis import estimate_axis
from imuloop.noise.modes import modes
from imuloop.noise.periodogram import Periodogram, chance_at_one, chance_over_band
from imuloop.noise.settings import NoiseSettings
from imuloop.noise.signal import Signal

# chance of finding what lies at one limit
PROBABILITY = 0.9
# chance of a line in noise that has none
LEVEL = NoiseSettings().significance


def unbroken(rate, samples):
    """Return the Signal of one stretch, without values."""
    return Signal(rate, *np.array([[0], [samples], [0]]))


def estimate_record(x, rate, settings):
    """Return the AxisEstimate of `x`, shape (n,), of `rate` in Hz."""
    signal = replace(unbroken(rate, len(x)), values=np.asarray(x, float))
    return estimate_axis(modes([signal]), [signal], settings)


def line_limit(sampling, density, frequency, level=LEVEL):
    r"""Return the amplitude of a line that is found with 90 %.

    Twice I/S is non-central chi-square with two degrees of freedom and
    :math:`\lambda = A^2 n/(r S)`; `density` is S, one-sided, as a function of frequency in Hz.
    """
    n, rng = sampling.lengths.sum(), np.random.default_rng(0)
    noise = Periodogram.of(replace(sampling, values=rng.standard_normal(n)), density)
    _, m = noise.noise(frequency)
    ratio = brentq(
        lambda x: chance_over_band(chance_at_one(x, m), noise.independent) - level, 0.1, 1e6
    )
    half = (m + 1) / 2
    # the line itself, some three values wide, lies in the block that it is compared with
    share = betaincinv(half, half, 0.5 ** (1 / 3)) * m / (m - 3)
    noncentrality = chndtrinc(-2 * ratio * np.log1p(-share), 2, 1 - PROBABILITY)
    return np.sqrt(noncentrality * sampling.rate * density(np.array([frequency]))[0] / n)


def gauss_markov(n, dt, q, tc, rng):
    """Return a stationary first-order Gauss–Markov process, ``dx/dt = -x/tc + q·white``, (n,)."""
    phi, std = np.exp(-dt / tc), q * np.sqrt(tc / 2)
    drive = rng.standard_normal(n) * std * np.sqrt(1 - phi**2)
    drive[0] /= np.sqrt(1 - phi**2)
    return lfilter([1.0], [1.0, -phi], drive)
