"""NetCDF files: variables over time, a sensor's three axes as one variable or as three."""

import re

import numpy as np
import pandas as pd
import pyarrow as pa

from imuloop.core.errors import ImuloopError, RejectedLog
from imuloop.core.samples import CHANNELS, TEMPERATURE
from imuloop.ingest.columns import AXES, resolve, stated_unit
from imuloop.ingest.raw_log import STAMP, RawLog

ENDINGS = (".nc", ".nc4", ".cdf", ".netcdf")

# nanoseconds in the units of CF times
_CF_NANOSECONDS = {
    "nanosecond": 1,
    "microsecond": 10**3,
    "millisecond": 10**6,
    "second": 10**9,
    "sec": 10**9,
    "s": 10**9,
    "minute": 60 * 10**9,
    "hour": 3600 * 10**9,
    "day": 86400 * 10**9,
}


def read(paths, columns=None, batch_rows=1 << 16):
    """Read a NetCDF file.

    Parameters
    ----------
    paths : dict
        ``{"log": path}``.
    columns : dict, optional
        Quantity to variables. A sensor is one variable of shape (time, 3), or three.
    batch_rows : int
        Rows held at once.

    Raises
    ------
    ImuloopError
        If a declared variable is not there.
    RejectedLog
        If the file is no NetCDF file.
    """
    # takes long to import, and most runs need none
    import netCDF4

    try:
        dataset = netCDF4.Dataset(str(paths["log"]))
    except OSError as error:
        raise RejectedLog("the file is not a whole NetCDF file") from error
    dimension, series = _series(dataset, columns)
    names = list(series)
    chosen = resolve(names, _expanded(columns, dataset, names))
    keys = [names[i] for i in chosen.positions()]
    units = {
        quantity: unit
        for quantity, found in chosen.found(names).items()
        if (unit := _attribute_unit(dataset, series, quantity, found))
    }

    def batches():
        with dataset:
            rows = len(dataset.dimensions[dimension])
            for begin in range(0, rows, batch_rows):
                part = slice(begin, begin + batch_rows)
                held = {}
                for key in keys:
                    variable = series[key][0]
                    if variable not in held:
                        held[variable] = _values(dataset[variable], dimension, part)
                rest = iter(keys[len(CHANNELS) :])
                arrays = {
                    name: pa.array(_float(_column(held, series[key])))
                    for name, key in zip(CHANNELS, keys, strict=False)
                }
                if chosen.time is not None:
                    key = next(rest)
                    arrays[STAMP] = _stamps(_column(held, series[key]), dataset[series[key][0]])
                if chosen.temperature is not None:
                    arrays[TEMPERATURE] = pa.array(_float(_column(held, series[next(rest)])))
                yield pa.RecordBatch.from_pydict(arrays)

    return RawLog(
        batches=batches(),
        temperature=chosen.temperature is not None,
        found=chosen.found(names),
        units=units,
    )


def _series(dataset, columns):
    """Return the dimension of time and name -> (variable, axis or None) of all series over it."""
    numeric = [v for v in dataset.variables.values() if getattr(v.dtype, "kind", "O") in "iuf"]
    lengths = {d: len(dataset.dimensions[d]) for v in numeric for d in v.dimensions}
    if not lengths:
        raise RejectedLog("the file has no variables of numbers")
    dimension = max(lengths, key=lengths.get)
    series = {}
    for variable in numeric:
        if variable.dimensions == (dimension,):
            series[variable.name] = (variable.name, None)
        elif variable.ndim == 2 and dimension in variable.dimensions:
            if min(variable.shape) == len(AXES):
                for axis, letter in enumerate(AXES):
                    series[f"{variable.name}.{letter}"] = (variable.name, axis)
    # the coordinate of the time dimension is the time, whatever its name
    if dimension in series and "time" not in (columns or {}):
        series = {("time" if k == dimension else k): v for k, v in series.items()}
    return dimension, series


def _expanded(columns, dataset, names):
    """Return declared columns with each (time, 3) variable as its three series."""
    expanded = dict(columns or {})
    for quantity, value in expanded.items():
        if isinstance(value, list) and len(value) == 1:
            value = value[0]
        if isinstance(value, str) and quantity in ("acceleration", "angular_rate"):
            if f"{value}.x" not in names:
                known = ", ".join(dataset.variables)
                raise ImuloopError(
                    f"columns.{quantity}: no variable '{value}' of shape (time, 3); "
                    f"there are {known}"
                )
            expanded[quantity] = [f"{value}.{letter}" for letter in AXES]
    return expanded


def _attribute_unit(dataset, series, quantity, found):
    name = series[found[0] if isinstance(found, list) else found][0]
    return stated_unit(quantity, getattr(dataset[name], "units", ""))


def _values(variable, dimension, part):
    """Return rows `part` of a variable, time along the first axis; masked."""
    along = variable.dimensions[0] == dimension
    try:
        values = np.ma.asarray(variable[part] if along else variable[:, part])
    except (RuntimeError, OSError) as error:
        raise RejectedLog(f"the file cannot be read to its end: {error}") from error
    return values if along else values.T


def _column(held, where):
    name, axis = where
    return held[name] if axis is None else held[name][:, axis]


def _float(values):
    return np.ma.filled(values.astype(float), np.nan)


def _stamps(values, variable):
    """Return stamps: dates where the variable says `seconds since ...`, else its numbers."""
    mask = np.ma.getmaskarray(values)
    units = re.fullmatch(r"\s*(\w+?)s?\s+since\s+(.+)", str(getattr(variable, "units", "")))
    if not units or units[1] not in _CF_NANOSECONDS:
        return pa.array(np.ma.getdata(values), mask=mask)
    origin = pd.Timestamp(units[2].replace("UTC", "").strip())
    origin = (origin.tz_localize("UTC") if origin.tz is None else origin).as_unit("ns").value
    step = _CF_NANOSECONDS[units[1]]
    data = np.ma.getdata(values)
    if data.dtype.kind == "f":
        mask = mask | ~np.isfinite(data)
        whole = np.floor(np.where(mask, 0.0, data))
        part = np.where(mask, 0.0, data) - whole
        since = whole.astype(np.int64) * step + np.rint(part * step).astype(np.int64)
    else:
        since = data.astype(np.int64) * step
    return pa.array(since + origin, pa.timestamp("ns"), mask=mask)
