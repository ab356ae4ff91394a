"""A test of whether samples were taken at their uneven time stamps, or evenly and stamped late."""

import numpy as np

from imuloop.core.gaps import gap_limit

# the result is sure if β differs from a half by more than this number of standard errors
SURE = 4.0


def jitter_sign(t, w, step, grid=0.0):
    r"""Return 1 if samples were taken at their time stamps, -1 at even steps, 0 if neither is sure.

    If samples were taken at time stamps with jitter, the angular rate shows the jitter while the
    device turns: a sample that was taken late is farther along the slope of the rate. With the time
    stamp t, the angular rate w of an axis, the step T and the jitter :math:`e_k = t_k - k T` of
    sample k, the ratio

    .. math:: \beta = \frac{\sum (w_k - (w_{k-1} + w_{k+1})/2)\,d_k s'_k}{\sum d_k^2 s_k s'_k},
        \quad d_k = e_k - (e_{k-1} + e_{k+1})/2

    is 1 if the samples were taken at their time stamps, and 0 if they were taken at even steps and
    stamped late. s and s' are two estimates of the slope dw/dt from different samples, so that
    their noise is independent. Steps over dropped samples are left out. The result is 0 if β
    differs from 1/2 by less than `SURE` standard errors, as without a turn.

    Parameters
    ----------
    t : array, shape (n,)
        Time, s.
    w : array_like, shape (3, n)
        Angular rate, rad/s.
    step : float
        Usual step T, s.
    grid : float, optional
        Resolution of the time stamps, s. Rounding makes a step longer by at most this value.
    """
    complete = np.diff(t) <= gap_limit(step) + grid
    jitter = (bend(t) * (complete[1:] & complete[:-1]))[2:-2]
    # numerator and denominator of β, and variance of the numerator
    numerator = denominator = variance = 0.0
    for x in w:
        slope, other_slope = (x[5:-1] - x[1:-5]) / 4, (x[6:] - x[:-6]) / 6
        terms = bend(x)[2:-2] * jitter * (other_slope / step)
        numerator += terms.sum()
        variance += terms @ terms
        denominator += (jitter**2 * slope) @ other_slope / step**2
    difference = numerator - denominator / 2
    sure = denominator > 0 and abs(difference) > SURE * np.sqrt(variance)
    return int(np.sign(difference)) if sure else 0


def bend(x):
    """Return each inner sample minus the mean of its two neighbours, (n - 2,); `x` has n, (n,)."""
    return x[1:-1] - (x[:-2] + x[2:]) / 2
