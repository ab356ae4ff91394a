"""The Allan deviation of a record and its relatives, as a table."""

import numpy as np
import pandas as pd

from imuloop.core.errors import ImuloopError
from imuloop.noise.allan import allan_variance, averaging_factors, interval, relative_variance
from imuloop.noise.curve import NoiseOfCurve, fit_curve
from imuloop.noise.settings import NoiseSettings


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
        its 95 % interval by the noise that the Allan curve shows, `ci_low` and `ci_high`.

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
    curve = NoiseOfCurve.of(factors, [len(table)], rate)
    asked = NoiseOfCurve.of(factors, [len(table)], rate, deviation)
    for axis, column in table.items():
        x = column.to_numpy(float)
        variance = allan_variance([x], factors)
        edf = asked.degrees_of_freedom(np.square(fit_curve(variance, curve)))
        if deviation != "allan":
            variance = relative_variance(deviation, [x], factors)
        low, high = interval(variance, edf)
        rows = {"axis": axis, "tau_s": factors / rate, "adev": np.sqrt(variance)}
        parts.append(pd.DataFrame(rows | {"ci_low": np.sqrt(low), "ci_high": np.sqrt(high)}))
    return pd.concat(parts, ignore_index=True)
