"""The Allan deviation of a record, and its relatives: Hadamard, modified, total and M-sample."""

from functools import cache

import numpy as np
import pandas as pd

from imuloop.core.errors import ImuloopError
from imuloop.noise.allan import averaging_factors, interval, pooled_mean_square, terms
from imuloop.noise.settings import NoiseSettings

# decades of tau on each side over which the slope of a curve is taken
SLOPE_DECADES = 0.5
# share of a stretch up to which the reflected ends leave the total variance that of Allan
REFLECTED = 0.05
# function of AllanTools (an extra), and exponents of S(f) ~ f^alpha for which the degrees of
# freedom are known, lowest and highest
DEVIATIONS = {
    "allan": ("oadev", -2, 1),
    "total": ("totdev", -2, 1),
    "modified": ("mdev", -2, 2),
    "hadamard": ("ohdev", -3, 1),
}


def allan(values, rate, deviation="allan"):
    """Return the overlapping Allan deviation of an evenly sampled record, without gaps.

    Parameters
    ----------
    values : array_like, shape (n,) or (n, k), or DataFrame
        Record of each axis, any unit.
    rate : float
        Samples per second, Hz.
    deviation : {'allan', 'total', 'modified', 'hadamard'}
        Which.

    Returns
    -------
    DataFrame
        A row per axis and averaging time: `axis`, `tau_s`, `adev` in the unit of the values, and
        its 95 % interval by the noise that the slope shows, `ci_low` and `ci_high`.

    Raises
    ------
    ImuloopError
        If a value is not finite, or there are too few.
    """
    table = pd.DataFrame(values)
    if not np.isfinite(table.to_numpy(float)).all():
        raise ImuloopError("values: some are not finite; give a stretch without")
    factors, parts = averaging_factors(len(table), NoiseSettings()), []
    if not len(factors):
        raise ImuloopError(f"values: {len(table)} samples are too few for an Allan deviation")
    for axis, column in table.items():
        x = column.to_numpy(float)
        variance = deviation_variance(deviation, [x], factors)
        low, high = deviation_interval(deviation, [len(x)], factors, variance)
        rows = {"axis": axis, "tau_s": factors / rate, "adev": np.sqrt(variance)}
        parts.append(pd.DataFrame(rows | {"ci_low": np.sqrt(low), "ci_high": np.sqrt(high)}))
    return pd.concat(parts, ignore_index=True)


def deviation_variance(name, stretches, factors):
    """Return an Allan, total, modified Allan or Hadamard variance, pooled over stretches.

    The total one is without the correction for its bias at long averages under flicker and walk
    (-24 % and -38 % of the variance at half the record).

    Takes one of `DEVIATIONS`, of which all but the total one overlap, then what
    `imuloop.noise.allan.allan_variance` takes; shape (k,).

    References
    ----------
    W. J. Riley, Handbook of Frequency Stability Analysis, NIST SP 1065 (2008), eqs. (14), (20),
    (25).
    """
    import allantools

    factors, deviations = np.asarray(factors), getattr(allantools, DEVIATIONS[name][0])
    total, weight = np.zeros(len(factors)), np.zeros(len(factors))
    for x in stretches:
        count = _count(name, len(x), factors)
        used = np.flatnonzero(count)
        if len(used):
            # without the mean no digits are lost
            taus, deviation, *_ = deviations(
                x - np.mean(x), rate=1.0, data_type="freq", taus=factors[used]
            )
            at = np.searchsorted(factors, np.rint(taus))
            total[at] += count[at] * deviation**2
            weight[at] += count[at]
    return np.divide(total, weight, out=np.full(len(factors), np.nan), where=weight > 0)


def _count(name, length, factors):
    """Return the terms of a stretch at each factor, 0 where it is too short."""
    if name == "total":
        return np.where(factors < length, length - 1, 0)
    # of the modified variance one phase more than samples
    return terms(factors, length + (name == "modified"), 2 if name == "allan" else 3)


def m_sample_variance(stretches, factors, samples):
    r"""Return the M-sample variance without dead time, pooled over stretches, shape (k,).

    The mean over all groups of M consecutive averages of their sample variance; M = 2 is the Allan
    variance. A group begins at every sample.

    .. math:: \sigma^2(M, \tau) = \Big\langle \frac{1}{M-1} \sum_{k=1}^M
        (\bar x_k - \bar x)^2 \Big\rangle

    References
    ----------
    D. W. Allan, Statistics of atomic frequency standards, Proc. IEEE 54 (1966), 221-230.
    """

    def squares(x, m, i, j):
        averages = [x[i + k * m : j + k * m] for k in range(samples + 1)]
        return np.var(np.diff(averages, axis=0), axis=0, ddof=1).sum()

    factors = np.asarray(factors)
    return pooled_mean_square(stretches, factors, samples, squares) / factors**2.0


def deviation_interval(name, lengths, factors, variance):
    """Return the 95 % interval of a pooled variance by the noise that the slope of its curve shows.

    For stretches of `lengths` samples, which count as independent; not-a-number where the table of
    degrees of freedom has no entry.

    References
    ----------
    C. A. Greenhall and W. J. Riley, PTTI 2003; NIST SP 1065, table 7 (total).
    """
    edf = []
    for m, exponent in zip(factors, _exponents(name, factors, variance), strict=True):
        counts = [(_count(name, n, m), n) for n in lengths]
        parts = [
            count**2 / _freedom(name, int(n) + 1, int(m), int(exponent))
            for count, n in counts
            if count
        ]
        edf.append(sum(count for count, _ in counts) ** 2 / sum(parts) if parts else np.nan)
    return interval(variance, np.array(edf, float))


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
    return np.clip(np.minimum.accumulate(exponents), *DEVIATIONS[name][1:])


@cache
def _freedom(name, phases, m, exponent):
    """Return the degrees of freedom of a stretch; not-a-number where the tables have no entry."""
    import allantools

    edf = allantools.edf_greenhall
    if name == "hadamard":
        return edf(exponent, 3, m, phases, overlapping=True)
    if name in ("allan", "modified"):
        return edf(exponent, 2, m, phases, overlapping=True, modified=name == "modified")
    if m <= REFLECTED * phases:
        return edf(exponent, 2, m, phases, overlapping=True)
    return allantools.edf_totdev(phases, m, exponent) if exponent <= 0 else np.nan
