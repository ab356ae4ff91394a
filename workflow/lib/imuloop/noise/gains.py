"""Low-pass filters before the output of a sensor: their effect on the power of noise."""

from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.fft import irfft, rfft
from scipy.interpolate import BSpline

from imuloop.core.noise_model import DEGREES, HALF_POWER

# frequencies from 0 to half the rate, shares of the rate, between which gains are interpolated
GRID = np.linspace(0, 0.5, 4097)


def _butterworth(order, frequency, corner):
    """Return the power gain, (k,), of a digital Butterworth filter (bilinear transform).

    `order` is the order of the filter. `frequency`, (k,), are k frequencies, and `corner` is the
    frequency at which the gain is a half, both as shares of the sampling rate.
    """
    ratio = np.tan(np.pi * np.minimum(frequency, 0.4999)) / np.tan(np.pi * corner)
    return 1 / (1 + ratio ** (2 * order))


def _moving_average(frequency, corner):
    """Return the power gain, (k,), of an exponential moving average.

    `frequency`, (k,), are k frequencies, and `corner` is the corner frequency, both as shares of
    the sampling rate. The moving average has the gain of an analogue first-order filter with this
    corner, plus all aliases that sampling adds.
    """
    phi = np.exp(-2 * np.pi * corner)
    return (1 - phi) ** 2 / ((1 - phi) ** 2 + 4 * phi * np.sin(np.pi * frequency) ** 2)


def _second_order_sampled(frequency, corner):
    """Return the power gain, (k,), of an analogue second-order Butterworth filter after sampling.

    `frequency`, (k,), are k frequencies, and `corner` is the corner frequency of the analogue
    filter, both as shares of the sampling rate. The gain includes the aliases, and is divided by
    its value at frequency zero.
    """
    shares = (np.append(0.0, frequency)[:, None] + np.arange(-20, 21)) / corner
    power = (1 / (1 + shares**4)).sum(axis=1)
    return power[1:] / power[0]


def _spline(degree, frequency, corner):
    """Return the power gain, (k,), of values that were held, averaged or interpolated.

    A sensor with white noise may have its own sampling rate, and its values may be resampled to the
    rate of the log. The autocorrelation of the logged noise is then a B-spline of the lag. The unit
    of the lag is the sampling interval of the sensor, or the duration of the average. The power
    gain is the Fourier transform of the autocorrelation.

    `degree` is the degree of the B-spline: 1 for values that are held or averaged once, 3 for
    values that are interpolated, 5 for values that are averaged three times. `frequency`, (k,), are
    k frequencies, and `corner` is the frequency at which the gain is a half, both as shares of the
    rate of the log.
    """
    spline = BSpline.basis_element(np.arange(degree + 2) - (degree + 1) / 2, extrapolate=False)
    covariance = np.nan_to_num(spline(np.arange(len(GRID)) * corner / HALF_POWER[degree]))
    total = 2 * rfft(covariance, 2 * (len(GRID) - 1)).real - covariance[0]
    return np.interp(frequency, GRID, np.maximum(total, 0.0) / total[0])


# power gain of each kind, a function of frequencies, (k,), and the corner, shares of the rate
GAINS = {
    "first order": partial(_butterworth, 1),
    "first order, sampled": _moving_average,
    "second order": partial(_butterworth, 2),
    "second order, sampled": _second_order_sampled,
    "fourth order": partial(_butterworth, 4),
    "eighth order": partial(_butterworth, 8),
    **{kind: partial(_spline, degree) for kind, degree in DEGREES.items()},
}


@dataclass(frozen=True)
class LowPass:
    """A low-pass filter that acts before the output is logged."""

    kind: str  # key of `GAINS`
    corner: float  # frequency at which the power is a half, share of the rate
    floor: float = 0.0  # share of the power of white noise that enters behind the filter

    def gain(self, frequency):
        """Return the power gain of the filter at k frequencies, (k,).

        `frequency`, (k,), is a share of the sampling rate of the log. A frequency above half the
        rate gets the gain at half the rate.
        """
        frequency = np.minimum(np.asarray(frequency, float), 0.5)
        return self.floor + (1 - self.floor) * GAINS[self.kind](frequency, self.corner)

    def autocovariance(self, count):
        """Return the autocovariance of white noise of variance 1 after the filter, (count,).

        `count` is the number of lags, from 0 to `count` - 1 samples. White noise without a filter
        would have 1 at lag 0 and 0 elsewhere.
        """
        covariance = np.zeros(max(count, len(GRID)))
        covariance[: len(GRID)] = irfft(self.gain(GRID))[: len(GRID)]
        return covariance[:count]


def term_gain(term, f, rate):
    """Return the power gain of a low-pass filter, (k,), at k frequencies `f`, Hz, (k,).

    `term` is the filter, a LowPassTerm, with its corner in Hz. `rate` is the sampling rate of the
    output, Hz.
    """
    return LowPass(term.kind, term.corner.value / rate, term.floor).gain(f / rate)


def density(noise, f, rate):
    r"""Return the one-sided power spectral density of the noise of one axis, (k,), SI²/Hz.

    .. math::
        S(f) = 8 Q^2 r \sin^2(\pi f/r) + 2 N^2 + B^2/(\pi f) + 2 K^2/(2 \pi f)^2
        + 2 q^2/(1/T^2 + (2 \pi f)^2)

    `noise` is the AxisNoise of the axis. `f` are k frequencies, (k,), Hz, above 0 and up to half
    the rate. r is the sampling rate of the output, `rate`, Hz. Q, N, B and K are the coefficients
    of quantisation, white noise, flicker and random walk. A Gauss-Markov process has the
    coefficient q and the correlation time T, s; several processes add. If the noise has a low-pass
    filter, its gain multiplies all terms but the first, because quantisation arises behind the
    filter. Sinusoids are left out: each has the power :math:`\Omega^2/2` at a single frequency,
    with its amplitude :math:`\Omega`. The ramp is deterministic and adds nothing.

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
