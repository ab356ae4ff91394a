"""Relatives of the Allan deviation: Hadamard, modified, total and M-sample, over stretches."""

from functools import cache

import numpy as np

from imuloop.noise import allan
from imuloop.noise.allan import CHUNK, integral, pooled_mean_square, terms

# decades of tau on each side over which the slope of a curve is taken
SLOPE_DECADES = 0.5
# share of a stretch up to which the reflected ends leave the total variance that of Allan
REFLECTED = 0.05
# exponents of S(f) ~ f^alpha for which the degrees of freedom are known, lowest and highest
EXPONENTS = {"hadamard": (-3, 1), "modified": (-2, 2), "total": (-2, 1)}


def hadamard_variance(stretches, factors):
    r"""Return the overlapping Hadamard variance, pooled over stretches.

    Third differences of the integral X, so that a ramp of the output does not enter:

    .. math:: \sigma_H^2 = \langle (X_{i+3m} - 3 X_{i+2m} + 3 X_{i+m} - X_i)^2 \rangle / 6 m^2

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
    W. J. Riley, Handbook of Frequency Stability Analysis, NIST SP 1065 (2008), eq. (20).
    """

    def squares(x, m, i, j):
        third = _third_differences(x, m, i, j)
        return third @ third

    factors = np.asarray(factors)
    return pooled_mean_square(stretches, factors, 3, squares) / (6.0 * factors**2.0)


def _third_differences(x, m, i, j):
    """Return the third differences over m samples from i to j - 1."""
    third = x[i + m : j + m] - x[i + 2 * m : j + 2 * m]
    third *= 3.0
    third += x[i + 3 * m : j + 3 * m]
    third -= x[i:j]
    return third


def modified_variance(stretches, factors):
    r"""Return the modified Allan variance, pooled over stretches.

    The second differences d of the integral are averaged over m samples before the square, which
    tells quantisation from white noise of the integral; averages of the output they are not.

    .. math:: \mathrm{mod}\,\sigma^2 = \Big\langle \Big(\frac 1 m
        \sum_{i=j}^{j+m-1} d_i\Big)^2 \Big\rangle / 2 m^2,\quad d_i = X_{i+2m} - 2X_{i+m} + X_i

    Parameters, Returns
    -------------------
    As `hadamard_variance`.

    References
    ----------
    NIST SP 1065, eq. (14).
    """
    factors = np.asarray(factors)
    total, weight = np.zeros(len(factors)), np.zeros(len(factors))
    for stretch in stretches:
        # one phase more than samples: M = (n + 1) + 1 - 3m
        count = terms(factors, len(stretch) + 1, 3)
        weight += count
        x = integral(stretch)
        for k in np.flatnonzero(count):
            total[k] += _squares_of_moving_sums(x, factors[k], count[k])
    mean_square = np.divide(total, weight, out=np.full(len(factors), np.nan), where=weight > 0)
    return mean_square / (2.0 * factors**4.0)


def _squares_of_moving_sums(x, m, count):
    """Return the sum of squares of the sums over m neighbouring second differences."""
    # from one sum to the next a difference enters and one leaves: together a third difference
    moving = np.sum(x[2 * m : 3 * m] - 2 * x[m : 2 * m] + x[:m])
    total = moving**2
    for i in range(0, count - 1, CHUNK):
        sums = _third_differences(x, m, i, min(i + CHUNK, count - 1))
        sums[0] += moving
        np.cumsum(sums, out=sums)
        total += sums @ sums
        moving = sums[-1]
    return total


def total_variance(stretches, factors):
    r"""Return the total variance, pooled over stretches.

    The Allan variance of a record whose integral is continued at both ends by its own reflection,
    X_{-j} = 2 X_0 - X_j, so that each sample but the outermost is the centre of a term at any m.

    Parameters, Returns
    -------------------
    As `hadamard_variance`; factors below the length of a stretch.

    References
    ----------
    NIST SP 1065, eq. (25); without the correction for its bias at long averages under flicker
    and walk (-24 % and -38 % of the variance at half the record).
    """
    factors = np.asarray(factors)
    total, weight = np.zeros(len(factors)), np.zeros(len(factors))
    for stretch in stretches:
        used = np.flatnonzero(factors < len(stretch))
        if not len(used):
            continue
        count = len(stretch) - 1
        weight[used] += count
        x = integral(stretch)
        reach = int(factors[used].max())
        x = np.concatenate([2 * x[0] - x[reach:0:-1], x, 2 * x[-1] - x[-2 : -reach - 2 : -1]])
        for start in range(0, count, CHUNK):
            stop = min(start + CHUNK, count)
            i, j = reach + 1 + start, reach + 1 + stop
            for k in used:
                m = factors[k]
                second = x[i + m : j + m] - x[i:j]
                second -= x[i:j]
                second += x[i - m : j - m]
                total[k] += second @ second
    mean_square = np.divide(total, weight, out=np.full(len(factors), np.nan), where=weight > 0)
    return mean_square / (2.0 * factors**2.0)


def m_sample_variance(stretches, factors, samples):
    r"""Return the M-sample variance without dead time, pooled over stretches.

    The mean over all groups of M consecutive averages of their sample variance,

    .. math:: \sigma^2(M, \tau) = \Big\langle \frac{1}{M-1} \sum_{k=1}^M
        (\bar x_k - \bar x)^2 \Big\rangle

    M = 2 is the Allan variance. A group begins at every sample.

    Parameters
    ----------
    stretches, factors
        As for `hadamard_variance`.
    samples : int
        Averages a group, M; 2 or more.

    Returns
    -------
    ndarray, shape (k,)
        Unit of the output squared; not-a-number where no stretch is long enough.

    References
    ----------
    D. W. Allan, Statistics of atomic frequency standards, Proc. IEEE 54 (1966), 221-230.
    """

    def squares(x, m, i, j):
        mean = (x[i + samples * m : j + samples * m] - x[i:j]) / samples
        total = 0.0
        for first in range(0, samples * m, m):
            part = x[i + first + m : j + first + m] - x[i + first : j + first]
            part -= mean
            total += part @ part
        return total

    factors = np.asarray(factors)
    mean_square = pooled_mean_square(stretches, factors, samples, squares)
    return mean_square / ((samples - 1) * factors**2.0)


def interval(name, lengths, factors, variance):
    """Return the 95 % interval of a variance by the noise that the slope of its curve tells.

    Parameters
    ----------
    name : str
        'hadamard', 'modified' or 'total'.
    lengths : sequence of int
        Samples of each stretch; stretches count as independent.
    factors : array_like of int, shape (k,)
        Averaging factors m.
    variance : array_like, shape (k,)
        The variance, pooled.

    Returns
    -------
    low, high : ndarray, shape (k,)
        Not-a-number where the table of degrees of freedom has no entry.

    References
    ----------
    C. A. Greenhall and W. J. Riley, PTTI 2003; NIST SP 1065, table 7 (total).
    """
    edf = np.array(
        [
            _edf(name, lengths, int(m), exponent)
            for m, exponent in zip(factors, _exponents(name, factors, variance), strict=True)
        ]
    )
    return allan.interval(variance, edf)


def _exponents(name, factors, variance):
    """Return the exponent alpha of S(f) ~ f^alpha at each point, from the slope -1 - alpha."""
    decades = np.log10(factors)
    logarithm = np.log10(variance, out=np.full(len(decades), np.nan), where=variance > 0)
    exponents = np.zeros(len(decades), dtype=int)
    for i, here in enumerate(decades):
        near = (np.abs(decades - here) <= SLOPE_DECADES) & np.isfinite(logarithm)
        if near.sum() > 1:
            exponents[i] = np.rint(-1 - np.polyfit(decades[near], logarithm[near], 1)[0])
    # a sensor's curve turns upwards; at its uncertain end a steeper fall is chance
    return np.clip(np.minimum.accumulate(exponents), *EXPONENTS[name])


def _edf(name, lengths, m, exponent):
    """Return the degrees of freedom of a mean over stretches, weighted by their terms."""
    phases = np.asarray(lengths) + 1
    count = {
        "total": np.where(phases - 1 > m, phases - 2, 0),
        "hadamard": terms(m, phases - 1, 3),
        "modified": terms(m, phases, 3),
    }[name]
    parts = [
        each**2 / _edf_of_stretch(name, int(n), m, int(exponent))
        for each, n in zip(count, phases, strict=True)
        if each
    ]
    return count.sum() ** 2 / sum(parts) if parts else np.nan


@cache
def _edf_of_stretch(name, phases, m, exponent):
    """Return the degrees of freedom by the tables; not-a-number where they have no entry."""
    # half a second, and only for those who ask for these views
    from allantools import edf_greenhall, edf_totdev

    if name == "hadamard":
        return edf_greenhall(exponent, 3, m, phases, overlapping=True)
    if name == "modified":
        return edf_greenhall(exponent, 2, m, phases, overlapping=True, modified=True)
    if m <= REFLECTED * phases:
        return edf_greenhall(exponent, 2, m, phases, overlapping=True)
    return edf_totdev(phases, m, exponent) if exponent <= 0 else np.nan
