"""NetCDF files: variables over time, a sensor's three axes as one variable or as three."""

import os
import re
from contextlib import suppress
from pathlib import Path

import numpy as np
import pyarrow as pa

from imuloop.core.errors import ImuloopError, RejectedLog
from imuloop.core.samples import CHANNELS, TEMPERATURE
from imuloop.ingest.columns import AXES, listed, resolve
from imuloop.ingest.hdf5 import check_hdf5
from imuloop.ingest.packed import check_unpacked
from imuloop.ingest.raw_log import STAMP, RawLog
from imuloop.ingest.stamps import MOST, YEARS, stamp_array

ENDINGS = (".nc", ".nc4", ".cdf", ".netcdf")

_SINCE = re.compile(r"\s*(\w+?)s?\s+since\s+(\d.*)", re.IGNORECASE)
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
# how the classic format begins; all else is looked through for HDF5
_CLASSIC = (b"CDF\1", b"CDF\2", b"CDF\5")
# more columns than a matrix of samples has
_WIDEST = 64
# types of the classic format, and the longest header, bytes
_CLASSIC_BYTES = {3: 2, 4: 4, 5: 4, 6: 8, 8: 2, 9: 4, 10: 8, 11: 8}
_MOST_HEADER = 1 << 24


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

    path = Path(paths["log"])
    try:
        if not _check_classic(path):
            check_hdf5(path)
        # a path that begins otherwise could be an address to it
        dataset = netCDF4.Dataset(os.path.abspath(path))
    except RejectedLog:
        raise
    except Exception as error:
        raise RejectedLog("the file is not a whole NetCDF file") from error
    dimension, series = _series(dataset, columns)
    names = list(series)
    left_out = _left_out(dataset, dimension, series)
    try:
        chosen = resolve(names, _expanded(columns, dataset, names))
    except ImuloopError as error:
        dataset.close()
        raise ImuloopError(f"{error}{left_out}") from error
    keys = [names[i] for i in chosen.positions()]
    used = [dataset[name] for name in {series[key][0] for key in keys}]
    # sizes that are announced, whatever is in the file
    check_unpacked(path.stat().st_size, sum(float(v.size) * v.dtype.itemsize for v in used))
    units = {quantity: chosen.units[quantity] for quantity in chosen.increments} | {
        quantity: unit
        for quantity, found in chosen.found(names).items()
        if quantity != "pps" and (unit := _attribute_unit(dataset, series, chosen, quantity, found))
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
                for name in chosen.others:
                    key = next(rest)
                    arrays[name] = _stamps(_column(held, series[key]), dataset[series[key][0]])
                yield pa.RecordBatch.from_pydict(arrays)

    return RawLog(
        batches=batches(),
        temperature=chosen.temperature is not None,
        found=chosen.found(names),
        units=units,
        columns=f"{listed(names)}{left_out}",
    )


def _check_classic(path):
    """Tell whether a file is of the classic format; reject one that announces more than it holds.

    The library takes memory for whatever number of dimensions, attributes or variables it reads.
    """
    size = path.stat().st_size
    with open(path, "rb") as file:
        head = file.read(_MOST_HEADER)
    if head[:4] not in _CLASSIC:
        return False
    width, at = (8 if head[3:4] == b"\5" else 4), 4

    def number():
        nonlocal at
        at += width
        value = int.from_bytes(head[at - width : at], "big")
        if value > size or at > len(head):
            raise RejectedLog("the file is not a whole NetCDF file: its header is damaged")
        return value

    def skip(count):
        nonlocal at
        at += count + -count % 4

    def entries():
        skip(4)
        for _ in range(number()):
            skip(number())
            yield

    def attributes():
        for _ in entries():
            kind = int.from_bytes(head[at : at + 4], "big")
            skip(4)
            skip(_CLASSIC_BYTES.get(kind, 1) * number())

    # of records, then of each dimension: lengths, which may be any
    skip(width)
    for _ in entries():
        skip(width)
    attributes()
    for _ in entries():
        skip(width * number())
        attributes()
        # type, size, where it begins
        skip(4 + width + (4 if head[3:4] == b"\1" else 8))
    return True


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
        elif variable.ndim == 2 and variable.dimensions.count(dimension) == 1:
            width = variable.shape[1 - variable.dimensions.index(dimension)]
            for axis in range(width if width <= _WIDEST else 0):
                label = AXES[axis] if width == len(AXES) else axis
                series[f"{variable.name}.{label}"] = (variable.name, axis)
    # the coordinate of the time dimension is the time, whatever its name
    if dimension in series and "time" not in (columns or {}):
        series = {("time" if k == dimension else k): v for k, v in series.items()}
    return dimension, series


def _left_out(dataset, dimension, series):
    """Return what a message says of the variables that are no series, and why."""
    used = {name for name, _ in series.values()}
    told = [
        f"{v.name} ({' x '.join(v.dimensions) or 'one value'}, {getattr(v.dtype, 'name', 'text')})"
        for v in dataset.variables.values()
        if v.name not in used
    ] + [f"group {name}" for name in dataset.groups]
    if not told:
        return ""
    return f"; no numbers over {dimension} alone or in up to {_WIDEST} columns: {listed(told)}"


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


def _attribute_unit(dataset, series, chosen, quantity, found):
    names = {series[each][0] for each in (found if isinstance(found, list) else [found])}
    texts = [_units(dataset[name]).strip() for name in sorted(names)]
    texts = [text for text in texts if text and not (quantity == "time" and _since(text))]
    stated = {chosen.stated(quantity, text) or text for text in texts}
    return " and ".join(sorted(stated))


def _units(variable):
    """Return what a variable says of its units; of those that cannot be read, nothing."""
    with suppress(Exception):
        return str(variable.units)
    return ""


def _since(text):
    """Return nanoseconds per unit and the date of `seconds since 2024-01-01`, or None."""
    match = _SINCE.fullmatch(text)
    step = match and _CF_NANOSECONDS.get(match[1].lower())
    return (step, match[2].replace("UTC", "").strip()) if step else None


def _values(variable, dimension, part):
    """Return rows `part` of a variable, time along the first axis; masked."""
    along = variable.dimensions[0] == dimension
    try:
        values = np.ma.asarray(variable[part] if along else variable[:, part])
    except Exception as error:
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
    data = np.ma.getdata(values)
    units = _since(_units(variable))
    if not units:
        return stamp_array(pa.array(data, mask=mask))
    step, date = units
    # takes longer to import than all the rest, and few logs need it
    import pandas as pd

    try:
        origin = pd.Timestamp(date)
        origin = (origin.tz_localize("UTC") if origin.tz is None else origin).as_unit("ns").value
    except (ValueError, OverflowError) as error:
        raise RejectedLog(
            f"the stamps count from '{date}', which is no date of the years {YEARS}"
        ) from error
    away = np.abs(data.astype(float) * step + origin)
    far = mask | ~(away < MOST)
    if far.all() and np.isfinite(away[~mask]).any():
        raise RejectedLog(f"the stamps, {_units(variable)}, lie outside of the years {YEARS}")
    data = np.where(far, 0, data)
    whole = np.floor(data)
    # counted modulo 2^64, so that only the sum has to fit
    since = whole.astype(np.int64) * step
    if data.dtype.kind == "f":
        since += np.rint((data - whole) * step).astype(np.int64)
    return pa.array(since + origin, pa.timestamp("ns"), mask=far)
