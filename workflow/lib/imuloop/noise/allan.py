"""Overlapping Allan deviation of records that may be cut into stretches."""

import numpy as np
from scipy.special import chdtri

from imuloop.core.tables import table

# columns of allan.parquet
COLUMNS = ("axis", "tau_s", "adev", "ci_low", "ci_high", "edf", "stage")
# terms that are summed at a time: fits the cache
CHUNK = 32768


def averaging_factors(length, settings):
    """Return log-spaced averaging factors m, tau = m / rate, for the longest stretch's samples.

    Ascending from 1, shape (k,); empty where the stretch is too short for any.
    """
    longest = int(length * settings.longest_tau_share)
    if longest < 1:
        return np.empty(0, dtype=int)
    count = int(np.ceil(np.log10(longest) * settings.points_per_decade)) + 1
    return np.unique(np.rint(np.geomspace(1, longest, count)).astype(int))


def terms(factors, length):
    """Return the number of overlapping terms of a stretch; 0 where it is below 2."""
    count = np.asarray(length) + 1 - 2 * np.asarray(factors)
    return np.where(count < 2, 0, count)


def allan_variance(stretches, factors):
    r"""Return the overlapping Allan variance, pooled over stretches, shape (k,), unit squared.

    .. math::
        \sigma^2(m) = \sum_s M_s \sigma_s^2(m) / \sum_s M_s,\quad M_s = n_s + 1 - 2m

    Takes evenly sampled stretches of any unit and averaging factors m. No term reaches over the end
    of a stretch, so that what lies between two of them, be it a gap, a knock or a lasting change of
    level, does not enter. Not-a-number where no stretch is long enough.

    References
    ----------
    W. J. Riley, Handbook of Frequency Stability Analysis, NIST SP 1065 (2008), eq. (11).
    """
    factors = np.asarray(factors)
    total, weight = np.zeros(len(factors)), np.zeros(len(factors))
    # changes of x over m samples, and how these change m samples on: memory that is used again
    changes, second = np.empty(2 * CHUNK), np.empty(CHUNK)
    for values in stretches:
        count, x = terms(factors, len(values)), _integral(values)
        weight += count
        # chunk by chunk, so that the short averages of all factors find their samples in the cache
        for i in range(0, count.max(initial=0), CHUNK):
            part = x[i:]
            for k in np.flatnonzero(count > i).tolist():
                size, m = min(CHUNK, int(count[k]) - i), int(factors[k])
                if m < size:
                    both = m + size
                    change = np.subtract(part[m : m + both], part[:both], out=changes[:both])
                    later, earlier = change[m:], change[:size]
                else:
                    first, middle, last = (part[j * m : j * m + size] for j in range(3))
                    later = np.subtract(last, middle, out=changes[:size])
                    earlier = np.subtract(middle, first, out=second[:size])
                difference = np.subtract(later, earlier, out=second[:size])
                total[k] += difference @ difference
    mean = np.divide(total, weight, out=np.full(len(total), np.nan), where=weight > 0)
    return mean / (2.0 * factors**2)


def allan_table(axis, tau, variance, edf, stage="raw"):
    """Return one axis' rows of allan.parquet: the deviation with its 95 % interval.

    Averaging times `tau` in s, Allan variance in the unit of the axis squared and equivalent
    degrees of freedom, shape (k,) each; edf s^2 / sigma^2 follows chi-square.
    """
    variance = np.asarray(variance)
    low, high = (np.sqrt(end) for end in interval(variance, np.asarray(edf)))
    return table(COLUMNS, axis, tau, np.sqrt(variance), low, high, edf, stage)


def interval(variance, edf):
    """Return the 95 % interval of a variance by chi-square with `edf` degrees of freedom."""
    return tuple(variance * edf / chdtri(edf, above) for above in (0.025, 0.975))


def _integral(values):
    """Return the sums of the values before each and of all; without the mean, for the digits."""
    x = np.zeros(len(values) + 1)
    np.subtract(values, np.mean(values), out=x[1:])
    return np.cumsum(x, out=x)
