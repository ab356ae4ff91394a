"""Low-pass filters before the output: the power that they leave of noise in front of them."""

from dataclasses import dataclass

import numpy as np
from scipy.fft import rfft
from scipy.interpolate import BSpline

# points of a gain from 0 to half the rate
POINTS = 4097
# what makes the autocorrelation of white noise a B-spline, and its degree
DEGREES = {"held or averaged": 1, "interpolated": 3, "averaged three times": 5}
# frequency at which held and interpolated values have half their power, share of the sensor's rate
HALF_POWER = {1: 0.442946, 3: 0.318917, 5: 0.261938}


def _butterworth(order):
    """Return the power gain of a digital Butterworth filter (bilinear transform)."""

    def gain(frequency, corner):
        ratio = np.tan(np.pi * np.minimum(frequency, 0.4999)) / np.tan(np.pi * corner)
        return 1 / (1 + ratio ** (2 * order))

    return gain


def _sampled_butterworth(order):
    """Return the power gain of an analogue Butterworth filter, sampled: with its aliases."""

    def gain(frequency, corner):
        if order == 1:
            # the sum of all aliases, as of an exponential moving average
            phi = np.exp(-2 * np.pi * corner)
            return (1 - phi) ** 2 / ((1 - phi) ** 2 + 4 * phi * np.sin(np.pi * frequency) ** 2)
        alias = np.arange(-20, 21)
        power = 1 / (1 + ((np.append(0.0, frequency)[:, None] + alias) / corner) ** (2 * order))
        total = power.sum(axis=1)
        return total[1:] / total[0]

    return gain


def _spline(degree):
    """Return the power gain of values that are held or averaged, interpolated, averaged again.

    The autocorrelation of white noise is then a B-spline of degree 1, 3 or 5 in the lag over the
    interval of the sensor or of the average.
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


# power gain of each kind over frequency and corner, both as shares of the rate
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
    """A filter in front of the output.

    `kind` is a key of `GAINS`; `corner`, where the power has fallen to a half, is a share of the
    rate; `floor` is the share of the white noise that enters behind the filter.
    """

    kind: str
    corner: float
    floor: float = 0.0

    def gain(self, frequency):
        """Return the power gain at frequencies, shares of the rate up to 0.5, shape (k,)."""
        gain = GAINS[self.kind](np.asarray(frequency, float), self.corner)
        return self.floor + (1 - self.floor) * gain
