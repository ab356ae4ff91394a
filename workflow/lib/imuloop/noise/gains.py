"""Low-pass filters before the output of a sensor: their power gain for noise before them."""

from dataclasses import dataclass

import numpy as np
from scipy.fft import rfft
from scipy.interpolate import BSpline

from imuloop.core.noise_model import DEGREES, HALF_POWER

# number of frequencies from 0 to half the output rate at which a gain is computed
POINTS = 4097


def _butterworth(order):
    """Return the power gain of a digital Butterworth filter (bilinear transform), a function.

    It takes frequencies and the corner, shares of the rate.
    """

    def gain(frequency, corner):
        ratio = np.tan(np.pi * np.minimum(frequency, 0.4999)) / np.tan(np.pi * corner)
        return 1 / (1 + ratio ** (2 * order))

    return gain


def _sampled_butterworth(order):
    """Return the power gain of a sampled analogue Butterworth filter with its aliases, a function.

    It takes frequencies and the corner, shares of the rate.
    """

    def gain(frequency, corner):
        if order == 1:
            # the sum of all aliases is the gain of an exponential moving average
            phi = np.exp(-2 * np.pi * corner)
            return (1 - phi) ** 2 / ((1 - phi) ** 2 + 4 * phi * np.sin(np.pi * frequency) ** 2)
        alias = np.arange(-20, 21)
        power = 1 / (1 + ((np.append(0.0, frequency)[:, None] + alias) / corner) ** (2 * order))
        total = power.sum(axis=1)
        return total[1:] / total[0]

    return gain


def _spline(degree):
    """Return the power gain of values that were held, averaged or interpolated, a function.

    White noise of a sensor that is resampled in such a way has an autocorrelation that is a
    B-spline of the lag, in intervals of the sensor or of the average. Its degree is 1 for values
    that are held or averaged, 3 for values that are interpolated, and 5 for values that are
    averaged three times. The power gain is the Fourier transform of the autocorrelation.

    The function takes frequencies and the corner, shares of the output rate.
    """
    knots = np.arange(degree + 2) - (degree + 1) / 2
    spline = BSpline.basis_element(knots, extrapolate=False)

    def gain(frequency, corner):
        lag = np.arange(POINTS) * corner / HALF_POWER[degree]
        covariance = np.nan_to_num(spline(lag))
        total = 2 * rfft(covariance, 2 * (POINTS - 1)).real - covariance[0]
        grid = np.linspace(0, 0.5, POINTS)
        return np.interp(frequency, grid, np.maximum(total, 0.0) / total[0])

    return gain


# power gain of each kind, a function of frequency and corner, both shares of the rate
GAINS = {
    "first order": _butterworth(1),
    "first order, sampled": _sampled_butterworth(1),
    "second order": _butterworth(2),
    "second order, sampled": _sampled_butterworth(2),
    "fourth order": _butterworth(4),
    "eighth order": _butterworth(8),
    **{kind: _spline(degree) for kind, degree in DEGREES.items()},
}


@dataclass(frozen=True)
class LowPass:
    """A low-pass filter before the output."""

    kind: str  # key of `GAINS`
    corner: float  # frequency at which the power is a half, share of the rate
    floor: float = 0.0  # share of the power of white noise that enters behind the filter

    def gain(self, frequency):
        """Return the power gain, (k,), at frequencies, (k,), shares of the rate up to 0.5."""
        gain = GAINS[self.kind](np.asarray(frequency, float), self.corner)
        return self.floor + (1 - self.floor) * gain


def term_gain(term, f, rate):
    """Return the power gain, (k,), of a LowPassTerm at frequencies f, Hz, (k,), by the rate, Hz."""
    return LowPass(term.kind, term.corner.value / rate, term.floor).gain(f / rate)


def density(noise, f, rate):
    r"""Return the one-sided power spectral density of an `AxisNoise` at frequencies f, SI²/Hz.

    .. math::
        S(f) = 8 Q^2 r \sin^2(\pi f/r) + 2 N^2 + B^2/(\pi f) + 2 K^2/(2 \pi f)^2
        + 2 q^2/(1/T^2 + (2 \pi f)^2)

    If there is a low-pass, its gain multiplies all terms but the first. Sinusoids have no
    density: each has the power :math:`\Omega^2/2` at its frequency. The ramp is deterministic
    and adds nothing. r is the `rate` of the output, Hz; f are above 0 and up to half the rate, Hz.

    References
    ----------
    IEEE Std 952-1997 (R2008), annex C, which gives the two-sided densities.
    """
    f = np.asarray(f, float)
    omega = 2 * np.pi * f
    total = 2 * noise.N.square + noise.B.square / (np.pi * f) + 2 * noise.K.square / omega**2
    for process in noise.gauss_markov:
        total = total + 2 * process.q.square / (process.tc.value**-2 + omega**2)
    if noise.low_pass:
        total = total * term_gain(noise.low_pass, f, rate)
    return total + 8 * noise.Q.square * rate * np.sin(np.pi * f / rate) ** 2
