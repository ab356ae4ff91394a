"""The Allan deviation of a record, and its relatives by AllanTools: Hadamard, modified, total."""

from functools import cache

import numpy as np
import pandas as pd

from imuloop.core.errors import ImuloopError
from imuloop.noise.allan import allan_variance, averaging_factors, interval, terms
from imuloop.noise.curve import CurveVariance, fit_curve
from imuloop.noise.settings import NoiseSettings

# decades of tau on each side over which the slope of a curve is taken
SLOPE_DECADES = 0.5
# share of a stretch up to which the reflected ends leave the total variance that of Allan
REFLECTED = 0.05
# function of AllanTools (an extra), and exponents of S(f) ~ f^alpha for which the degrees of
# freedom are known, lowest and highest
DEVIATIONS = {"total": ("totdev", -2, 1), "modified": ("mdev", -2, 2), "hadamard": ("ohdev", -3, 1)}


def allan(values, rate, deviation="allan"):
    """Return the overlapping Allan deviation of an evenly sampled record, without gaps.

    Parameters
    ----------
    values : array_like, shape (n,) or (n, k), or DataFrame
        Record of each axis, any unit.
    rate : float
        Samples per second, Hz.
    deviation : {'allan', 'total', 'modified', 'hadamard'}
        Which; all but the first need the extra `deviations`.

    Returns
    -------
    DataFrame
        A row per axis and averaging time: `axis`, `tau_s`, `adev` in the unit of the values, and
        its 95 % interval by the noise that the curve shows, `ci_low` and `ci_high`.

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
    tau, curve = factors / rate, CurveVariance.of(factors, [len(table)], rate)
    for axis, column in table.items():
        x = column.to_numpy(float)
        if deviation == "allan":
            variance = allan_variance([x], factors)
            edf = curve.degrees_of_freedom(np.square(fit_curve(tau, variance, curve)), tau)
        else:
            variance, edf = deviation_variance(deviation, [x], factors)
        low, high = interval(variance, edf)
        rows = {"axis": axis, "tau_s": tau, "adev": np.sqrt(variance)}
        parts.append(pd.DataFrame(rows | {"ci_low": np.sqrt(low), "ci_high": np.sqrt(high)}))
    return pd.concat(parts, ignore_index=True)


def deviation_variance(name, stretches, factors):
    """Return a total, modified Allan or Hadamard variance and its degrees of freedom, (k,) each.

    Pooled over stretches, which count as independent. The total one does not overlap and is without
    the correction for its bias at long averages under flicker and walk (-24 % and -38 % of the
    variance at half the record). Degrees of freedom are those of the noise that the slope of the
    curve shows, not-a-number where the tables have no entry.

    Takes one of `DEVIATIONS`, then what `imuloop.noise.allan.allan_variance` takes.

    References
    ----------
    W. J. Riley, Handbook of Frequency Stability Analysis, NIST SP 1065 (2008), eqs. (14), (20),
    (25), table 7; C. A. Greenhall and W. J. Riley, PTTI 2003.
    """
    import allantools

    factors, (function, *known) = np.asarray(factors), DEVIATIONS[name]
    count = np.array([_count(name, len(x), factors) for x in stretches])
    total = np.zeros(len(factors))
    for x, weight in zip(stretches, count, strict=True):
        if weight.any():
            # without the mean no digits are lost
            taus, deviation, *_ = getattr(allantools, function)(
                x - np.mean(x), rate=1.0, data_type="freq", taus=factors[weight > 0]
            )
            at = np.searchsorted(factors, np.rint(taus))
            total[at] += weight[at] * deviation**2
    number = count.sum(axis=0)
    variance = np.divide(total, number, out=np.full(len(factors), np.nan), where=number > 0)
    edf = np.full(len(factors), np.nan)
    for i, exponent in enumerate(np.clip(_exponents(factors, variance), *known)):
        each = [
            n**2 / _freedom(name, len(x) + 1, int(factors[i]), int(exponent))
            for n, x in zip(count[:, i], stretches, strict=True)
            if n
        ]
        edf[i] = number[i] ** 2 / sum(each) if each else np.nan
    return variance, edf


def _count(name, length, factors):
    """Return the terms of a stretch at each factor, 0 where it is too short."""
    if name == "total":
        return np.where(factors < length, length - 1, 0)
    # of the modified variance one phase more than samples
    return terms(factors, length + (name == "modified"), 3)


def _exponents(factors, variance):
    """Return the exponent alpha of S(f) ~ f^alpha at each point, from the slope -1 - alpha."""
    decades = np.log10(factors)
    logarithm = np.log10(variance, out=np.full(len(decades), np.nan), where=variance > 0)
    exponents = np.zeros(len(decades), dtype=int)
    for i, here in enumerate(decades):
        near = (np.abs(decades - here) <= SLOPE_DECADES) & np.isfinite(logarithm)
        if near.sum() > 1:
            exponents[i] = np.rint(-1 - np.polyfit(decades[near], logarithm[near], 1)[0])
    # a sensor's curve turns upwards; at its uncertain end a steeper fall is chance
    return np.minimum.accumulate(exponents)


@cache
def _freedom(name, phases, m, exponent):
    """Return the degrees of freedom of a stretch; not-a-number where the tables have no entry."""
    from allantools import edf_greenhall, edf_totdev

    if name == "total" and m > REFLECTED * phases:
        return edf_totdev(phases, m, exponent) if exponent <= 0 else np.nan
    order, modified = 3 if name == "hadamard" else 2, name == "modified"
    return edf_greenhall(exponent, order, m, phases, overlapping=True, modified=modified)
