"""Overlapping Allan deviation of records that may be cut into stretches."""

import allantools
import numpy as np
import pandas as pd
from scipy.stats import chi2

# columns of allan.parquet
COLUMNS = ("axis", "tau_s", "adev", "ci_low", "ci_high", "edf", "stage")


def averaging_factors(length, settings):
    """Return log-spaced averaging factors m, tau = m / rate.

    Parameters
    ----------
    length : int
        Samples of the longest stretch.
    settings : NoiseSettings
        Points a decade and longest averaging time.

    Returns
    -------
    ndarray of int, shape (k,)
        Ascending from 1; empty where the stretch is too short for any.
    """
    longest = int(length * settings.longest_tau_share)
    if longest < 1:
        return np.empty(0, dtype=int)
    count = int(np.ceil(np.log10(longest) * settings.points_per_decade)) + 1
    return np.unique(np.rint(np.geomspace(1, longest, count)).astype(int))


def terms(factors, length):
    """Return the number of overlapping terms n + 1 - 2m, 0 where it is below 2."""
    count = np.asarray(length) + 1 - 2 * np.asarray(factors)
    return np.where(count < 2, 0, count)


def allan_variance(stretches, factors):
    r"""Return the overlapping Allan variance, pooled over stretches.

    .. math::
        \sigma^2(m) = \sum_s M_s \sigma_s^2(m) / \sum_s M_s,\quad M_s = n_s + 1 - 2m

    No term reaches over the end of a stretch, so that what lies between two stretches, be it a
    gap, a knock or a lasting change of level, does not enter.

    Parameters
    ----------
    stretches : sequence of array_like, shape (n_s,)
        Evenly sampled output, any unit.
    factors : array_like of int, shape (k,)
        Averaging factors m.

    Returns
    -------
    ndarray, shape (k,)
        Unit of the output squared; not-a-number where no stretch is long enough.

    References
    ----------
    W. J. Riley, Handbook of Frequency Stability Analysis, NIST SP 1065 (2008), eq. (11).
    """
    factors = np.asarray(factors)
    total, weight = np.zeros(len(factors)), np.zeros(len(factors))
    for x in stretches:
        count = terms(factors, len(x))
        used = count > 0
        if not used.any():
            continue
        # without its mean the integral keeps its digits; a rate of 1 makes tau the factor itself
        _, deviation, _, _ = allantools.oadev(
            np.asarray(x) - np.mean(x), rate=1.0, data_type="freq", taus=factors[used]
        )
        total[used] += count[used] * deviation**2
        weight += count
    return np.divide(total, weight, out=np.full(len(factors), np.nan), where=weight > 0)


def allan_table(axis, tau, variance, edf, stage="raw"):
    """Return one axis' rows of allan.parquet.

    Parameters
    ----------
    axis : str
        Name of the axis.
    tau : array_like, shape (k,)
        Averaging times, s.
    variance : array_like, shape (k,)
        Allan variance, unit of the axis squared.
    edf : array_like, shape (k,)
        Equivalent degrees of freedom; edf s^2 / sigma^2 follows chi-square.
    stage : str
        'raw' or 'corrected'.

    Returns
    -------
    DataFrame
        Deviation with its 95 % interval.
    """
    variance, edf = np.asarray(variance), np.asarray(edf)
    low, high = (np.sqrt(variance * edf / chi2.ppf(p, edf)) for p in (0.975, 0.025))
    values = (axis, tau, np.sqrt(variance), low, high, edf, stage)
    return pd.DataFrame(dict(zip(COLUMNS, values, strict=True)))
