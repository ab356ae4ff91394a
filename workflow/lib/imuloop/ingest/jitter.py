"""Jitter of time stamps: a test whether the samples were taken at their time stamps."""

import numpy as np

from imuloop.core.gaps import gap_limit

# standard errors by which β has to differ from a half
SURE = 4.0


class JitterTest:
    r"""Tests whether samples were taken at their time stamps or at even steps.

    If the samples were taken at time stamps with jitter, the angular rate shows the jitter whenever
    the device turns: a late sample has moved on along the slope of the rate. With the time t, the
    angular rate w of an axis, the step T and the jitter :math:`e_k = t_k - k T` of sample k,

    .. math:: \beta = \frac{\sum (w_k - (w_{k-1} + w_{k+1})/2)\,d_k s'_k}{\sum d_k^2 s_k s'_k},
        \quad d_k = e_k - (e_{k-1} + e_{k+1})/2

    is 1 if the samples were taken at their time stamps, and 0 if they were taken at even steps and
    stamped late. s and s' are two estimates of the slope dw/dt from different samples, so that
    their noise is independent. Steps over dropped samples are left out.

    Parameters
    ----------
    step : float
        Usual step T, s.
    grid : float, optional
        Resolution of the time stamps, s: it is the most by which it makes a step longer.
    """

    def __init__(self, step, grid=0.0):
        self.step, self.longest = step, gap_limit(step) + grid
        # numerator and denominator of β, and variance of the numerator
        self._numerator = self._denominator = self._variance = 0.0

    def add(self, t, w):
        """Add a part of a log to the sums: time, s, (n,), and angular rate, rad/s, (3, n)."""
        complete = np.diff(t) <= self.longest
        complete = complete[1:] & complete[:-1]
        jitter = (bend(t) * complete)[2:-2]
        for x in w:
            slope, other_slope = (x[5:-1] - x[1:-5]) / 4, (x[6:] - x[:-6]) / 6
            terms = bend(x)[2:-2] * jitter * (other_slope / self.step)
            self._numerator += terms.sum()
            self._variance += terms @ terms
            self._denominator += (jitter**2 * slope) @ other_slope / self.step**2

    @property
    def followed(self):
        """Whether β is significantly above a half; false if the device did not turn."""
        return self._differs_from_half(1)

    @property
    def even(self):
        """Whether β is significantly below a half; false if the device did not turn."""
        return self._differs_from_half(-1)

    def _differs_from_half(self, sign):
        """Return whether β - 1/2 has the sign, 1 or -1, and exceeds `SURE` standard errors."""
        difference = sign * (self._numerator - self._denominator / 2)
        return bool(difference > SURE * np.sqrt(self._variance) and self._denominator > 0)


def bend(x):
    """Return each inner sample of x, (n,), less the mean of its two neighbours, (n - 2,)."""
    return x[1:-1] - (x[:-2] + x[2:]) / 2
