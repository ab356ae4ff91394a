"""Overlapping Allan deviation by AllanTools, pooled over the stretches of a record."""

from importlib.util import find_spec
from numbers import Real

import numpy as np
import pandas as pd
from scipy.special import chdtri

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import SENSORS
from imuloop.core.tables import joined, table
from imuloop.noise.records import records_by_sensor
from imuloop.noise.settings import NoiseSettings

# columns of allan.parquet
COLUMNS = ("axis", "tau_s", "adev", "ci_low", "ci_high", "edf", "stage")
# exponents of the power spectrum of quantisation, white noise, flicker and walk, and the slopes of
# the deviation that separate one of these kinds of noise from the next. The first slope is close to
# -1, the slope of quantisation: no other noise must be taken for quantisation, which alone has many
# degrees of freedom at long times
EXPONENTS, SLOPES = (2, 0, -1, -2), (-0.9, -0.25, 0.25)
# a slope is measured from averaging times that are shorter by this factor to times longer by it
REACH = 5.0
# number of terms that AllanTools sums at a time: its temporary arrays then fit into the cache, and
# the sum takes half the time
PIECE = 1 << 17


def session_curves(session, settings, stage="raw"):
    """Return the Allan deviation of each axis of a session over the averaging time, as a table.

    The deviation of an axis comes from the rests of the session, the time ranges in which the
    device does not move. The averaging times of each sensor follow from its own sampling rate.

    Parameters
    ----------
    session : RecordedSession
        The session.
    settings : NoiseSettings
        Number of averaging times per decade, and the longest one as a share of the longest rest.
    stage : str
        Text that is written into the column `stage` of each row, such as ``raw``.

    Returns
    -------
    dict of ndarray
        The columns of allan.parquet, with a row per axis and averaging time: ``axis``, averaging
        time ``tau_s``, s, deviation ``adev``, ends ``ci_low`` and ``ci_high`` of its 95 % interval,
        degrees of freedom ``edf`` and ``stage``. They have no rows if the session has no rest, or
        if AllanTools, an optional package, is not installed.
    """
    parts = [no_curves()]
    by_sensor = records_by_sensor([session], []) if find_spec("allantools") else []
    for sensors, (record,) in by_sensor:
        for axis in (axis for sensor in sensors for axis in SENSORS[sensor]):
            stretches = record.stretches(axis)
            if all(np.isfinite(x).all() for x in stretches):
                curve = allan_curve(stretches, record.rate, settings)
                parts.append(table(COLUMNS, axis, *curve, stage))
            # two axes at once would need twice the memory
            del stretches
    return joined(parts)


def no_curves():
    """Return a table with the columns of allan.parquet and without rows."""
    return table(COLUMNS, "", *[[]] * 5, "")


def allan(values, rate):
    """Return the overlapping Allan deviation of an evenly sampled record without gaps.

    Parameters
    ----------
    values : array_like, shape (n,) or (n, k), or DataFrame
        n samples of one axis, or of k axes in columns, any unit.
    rate : float
        Samples per second, Hz.

    Returns
    -------
    DataFrame
        A row per axis and averaging time. `axis` is the name or number of the column, `tau_s` the
        averaging time, s, and `adev` the deviation in the unit of the values. `ci_low` and
        `ci_high` are the ends of its 95 % interval. The interval assumes the type of noise that the
        slope of the curve shows.

    Raises
    ------
    ImuloopError
        If the values are not a table of finite numbers, if they are too few, or if the rate is not
        above 0.
    ModuleNotFoundError
        If AllanTools is not installed.
    """
    if not (isinstance(rate, Real) and 0 < rate < np.inf):
        raise ImuloopError(f"rate: {rate!r} is not a number of samples per second above 0")
    try:
        frame = pd.DataFrame(values).astype(float)
    except (TypeError, ValueError) as error:
        raise ImuloopError(f"values: not numbers of shape (n,) or (n, k): {error}") from error
    if not np.isfinite(frame.to_numpy()).all():
        raise ImuloopError("values: some are not finite; give a stretch without")
    settings, parts = NoiseSettings(), []
    if not len(averaging_factors(len(frame), settings)):
        raise ImuloopError(f"values: {len(frame)} samples are too few for an Allan deviation")
    for axis, column in frame.items():
        curve = allan_curve([column.to_numpy()], rate, settings)
        parts.append(pd.DataFrame({"axis": axis, **dict(zip(COLUMNS[1:5], curve, strict=False))}))
    return pd.concat(parts, ignore_index=True)


def allan_curve(stretches, rate, settings):
    r"""Return the overlapping Allan deviation of an axis at k averaging times, with 95 % intervals.

    The interval follows from the equivalent degrees of freedom ν of the deviation s: with the true
    deviation σ, :math:`\nu s^2/\sigma^2` is a chi-square variable of ν degrees of freedom.

    Parameters
    ----------
    stretches : sequence of ndarray
        Output of the axis in each stretch, a range of samples that are evenly spaced, any unit.
    rate : float
        Sampling rate, Hz.
    settings : NoiseSettings
        Number of averaging times per decade, and the longest one as a share of the longest stretch.

    Returns
    -------
    tau, deviation, low, high, edf : ndarray, shape (k,)
        Averaging times, s; deviations and the ends of their intervals, in the unit of the output;
        equivalent degrees of freedom ν. All are empty if no stretch is long enough.
    """
    lengths = [len(x) for x in stretches]
    factors = averaging_factors(max(lengths), settings)
    variance = allan_variance(stretches, factors)
    edf = degrees_of_freedom(variance, factors, lengths)
    low, high = interval(variance, edf)
    return factors / rate, np.sqrt(variance), np.sqrt(low), np.sqrt(high), edf


def averaging_factors(length, settings):
    """Return the averaging times of an Allan curve as numbers of samples, (k,) of int.

    A factor is an averaging time divided by the sampling interval. The factors ascend from 1 in
    about equal steps of the logarithm. `length` is the number of samples of the longest stretch of
    the record. `settings`, NoiseSettings, have the number of factors per decade, and the largest
    factor as a share of `length`. The array is empty if the stretch is too short.
    """
    longest = int(length * settings.longest_tau_share)
    if longest < 1:
        return np.empty(0, dtype=int)
    count = int(np.ceil(np.log10(longest) * settings.points_per_decade)) + 1
    return np.unique(np.rint(np.geomspace(1, longest, count)).astype(int))


def term_counts(factors, length):
    """Return the number of overlapping terms of the Allan variance in a stretch of samples.

    The number is the weight of the stretch when the variances of several are pooled. A term is the
    difference of the means of two adjoining groups of m samples. `factors` are the numbers m, and
    `length` is the number of samples of the stretch. Both may be arrays, which are broadcast
    against each other; the result has their common shape. It is 0 where there are fewer than two
    terms.
    """
    count = np.asarray(length) + 1 - 2 * np.asarray(factors)
    return np.where(count < 2, 0, count)


def allan_variance(stretches, factors):
    r"""Return the overlapping Allan variance at k averaging times, pooled over stretches, (k,).

    .. math::
        \sigma^2(m) = \sum_s M_s \sigma_s^2(m) / \sum_s M_s,\quad M_s = n_s + 1 - 2m

    Stretch s has :math:`n_s` samples, :math:`M_s` overlapping terms and the Allan variance
    :math:`\sigma_s^2(m)` for means over m samples. No term reaches over the end of a stretch, so a
    gap, a knock or a jump of the bias between two stretches does not matter.

    `stretches` is a sequence of arrays, the evenly spaced samples of each stretch, in any unit; the
    variance is in its square. `factors` are the k numbers m, ascending. The variance is
    not-a-number where no stretch is long enough.

    References
    ----------
    W. J. Riley, Handbook of Frequency Stability Analysis, NIST SP 1065 (2008), eq. (11).
    """
    # this function computes the sum for `oadev`, which would copy the data for each call. It is
    # imported here because the import takes longer than most curves
    from allantools.allantools import calc_adev_phase

    factors = np.asarray(factors)
    total, weight = np.zeros(len(factors)), np.zeros(len(factors))
    for values in stretches:
        count, phase = term_counts(factors, len(values)), np.zeros(len(values) + 1)
        # sums of values without their mean keep more digits
        np.cumsum(values - np.mean(values), out=phase[1:])
        weight += count
        for k in np.flatnonzero(count).tolist():
            m, last = int(factors[k]), int(count[k])
            for i in range(0, last, PIECE):
                part = phase[i : min(i + PIECE, last) + 2 * m]
                deviation, _, number = calc_adev_phase(part, 1.0, m, 1)
                total[k] += number * deviation**2
    return np.divide(total, weight, out=np.full(len(total), np.nan), where=weight > 0)


def degrees_of_freedom(variance, factors, lengths):
    r"""Return the equivalent degrees of freedom ν of a pooled Allan variance, shape (k,).

    .. math:: \nu = \Big(\sum_s M_s\Big)^2 \Big/ \sum_s M_s^2/\nu_s

    :math:`M_s` is the number of overlapping terms in stretch s (`term_counts`). :math:`\nu_s` are
    the degrees of freedom that AllanTools computes for this stretch alone, for the type of noise
    that the slope of the curve shows.

    `variance`, (k,), is the Allan variance at the averaging times `factors`, (k,), which are
    numbers of samples. `lengths` has the number of samples of each stretch.

    References
    ----------
    W. J. Riley, Handbook of Frequency Stability Analysis, NIST SP 1065 (2008), table 5.
    """
    from allantools import edf_greenhall, edf_simple

    def of_stretch(exponent, m, length):
        """Return the degrees of freedom of the Allan variance of one stretch.

        `exponent` is the type of noise, one of `EXPONENTS`, `m` the averaging time in samples, and
        `length` the number of samples of the stretch.
        """
        # for flicker at m = 1 the simple formula of AllanTools 2024.6 lacks a square
        if (exponent, m) == (-1, 1):
            return edf_greenhall(exponent, 2, m, length + 1, overlapping=True)
        return edf_simple(length + 1, m, exponent)

    lengths, repeats = np.unique(lengths, return_counts=True)
    count, edf = term_counts(factors[:, None], lengths), np.empty(len(factors))
    exponents = noise_exponents(variance, factors)
    for k, (exponent, m) in enumerate(zip(exponents.tolist(), factors.tolist(), strict=True)):
        used = count[k] > 0
        nu = np.array([of_stretch(exponent, m, n) for n in lengths[used].tolist()])
        edf[k] = (repeats @ count[k]) ** 2 / (repeats[used] @ (count[k, used] ** 2 / nu))
    return edf


def noise_exponents(variance, factors):
    """Return the type of noise at each averaging time, as an exponent of the spectrum, (k,) of int.

    The degrees of freedom of the Allan variance depend on this type. The power spectrum of the
    noise is proportional to the frequency to the power of the exponent, one of `EXPONENTS`: 2 for
    quantisation, 0 for white noise, -1 for flicker and -2 for random walk. The exponent follows
    from the slope of the Allan deviation on logarithmic scales. The slope is measured between
    averaging times that are `REACH` times shorter and longer.

    `variance`, (k,), is the Allan variance at the averaging times `factors`, (k,), in samples. All
    exponents are 0, for white noise, if there are fewer than two points or if any variance is not
    above 0.
    """
    if len(factors) < 2 or not np.all(variance > 0):
        return np.zeros(len(factors), dtype=int)
    x, y = np.log(factors), np.log(variance) / 2
    low, high = np.maximum(x - np.log(REACH), x[0]), np.minimum(x + np.log(REACH), x[-1])
    slope = (np.interp(high, x, y) - np.interp(low, x, y)) / (high - low)
    exponents = np.take(EXPONENTS, np.digitize(slope, SLOPES))
    # quantisation falls fastest: after an averaging time at which other noise is larger, it is no
    # longer seen
    return np.where(np.logical_or.accumulate(exponents <= 0), np.minimum(exponents, 0), exponents)


def interval(variance, edf):
    """Return the lower and the upper end of the 95 % interval of an estimated variance, a tuple.

    `variance` is the estimate and `edf` its degrees of freedom: the estimate times `edf` over the
    true variance is a chi-square variable. Both are numbers or arrays, and the ends have their
    shape.
    """
    return tuple(variance * edf / chdtri(edf, above) for above in (0.025, 0.975))
