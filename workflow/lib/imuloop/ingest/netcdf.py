"""NetCDF files: variables over time, a sensor's three axes as one variable or as three."""

import os
import re
from pathlib import Path

import numpy as np
import pyarrow as pa

from imuloop.core.errors import RejectedLog
from imuloop.ingest.columns import resolve
from imuloop.ingest.guarded import check_unpacked, guarded
from imuloop.ingest.hdf5 import check_hdf5
from imuloop.ingest.stamps import YEARS
from imuloop.ingest.tables import by_axis, column_names, table_log

ENDINGS = (".nc", ".nc4", ".cdf", ".netcdf")

_SINCE = re.compile(r"\s*(\w+?)s?\s+since\s+(\d.*)", re.IGNORECASE)
# units of CF times to those of pandas
_CF_UNITS = {"nanosecond": "ns", "microsecond": "us", "millisecond": "ms", "second": "s"}
_CF_UNITS |= {"sec": "s", "s": "s", "minute": "m", "hour": "h", "day": "D"}


@guarded
def read(paths, columns=None, batch_rows=1 << 16):
    """Read a NetCDF file, whose longest dimension is time.

    In `columns` a sensor is one variable of shape (time, 3), or three.
    """
    # takes long to import
    import netCDF4

    path = Path(paths["log"])
    check_hdf5(path)
    # a path that begins otherwise could be an address to the library
    dataset = netCDF4.Dataset(os.path.abspath(path))
    numeric = [v for v in dataset.variables.values() if getattr(v.dtype, "kind", "O") in "iuf"]
    lengths = {d: len(dataset.dimensions[d]) for v in numeric for d in v.dimensions}
    if not lengths:
        raise RejectedLog("the file has no variables of numbers")
    time = max(lengths, key=lengths.get)
    # name of a column to its variable and the place in it
    series = {}
    for variable in numeric:
        if variable.ndim < 3 and variable.dimensions.count(time) == 1:
            width = variable.size // lengths[time]
            for place, name in enumerate(column_names(variable.name, width)):
                series[name] = variable, place
    # the coordinate of the time dimension is the time, whatever its name
    if time in series and "time" not in (columns or {}):
        series = {("time" if name == time else name): each for name, each in series.items()}
    names = list(series)
    chosen = resolve(names, by_axis(columns))
    used = [series[names[i]] for i in chosen.raw().values()]
    # sizes that are announced, whatever is in the file
    held = {variable.name: variable for variable, _ in used}.values()
    check_unpacked(path.stat().st_size, sum(float(v.size) * v.dtype.itemsize for v in held))

    def batches():
        for begin in range(0, lengths[time], batch_rows):
            part = slice(begin, begin + batch_rows)
            rows = {variable.name: _rows(variable, time, part) for variable in held}
            yield [_column(rows[v.name][:, place], _units(v)) for v, place in used]

    units = {quantity: chosen.units[quantity] for quantity in chosen.increments}
    for quantity, found in chosen.found(names).items():
        variables = {series[name][0] for name in np.atleast_1d(found)}
        texts = sorted({_units(variable) for variable in variables} - {""})
        if quantity != "pps" and texts and not (quantity == "time" and _since(texts[0])):
            stated = {chosen.stated(quantity, text) or text for text in texts}
            units[quantity] = " and ".join(sorted(stated))
    return table_log(names, chosen, batches(), units=units)


def _units(variable):
    return str(getattr(variable, "units", "")).strip()


def _rows(variable, time, part):
    """Return rows `part` of a variable, time along the first axis; masked."""
    if variable.dimensions[0] != time:
        return np.ma.asarray(variable[:, part]).T
    rows = np.ma.asarray(variable[part])
    return rows[:, None] if rows.ndim == 1 else rows


def _since(text):
    """Return the unit of pandas and the date of `seconds since 2024-01-01`, or None."""
    match = _SINCE.fullmatch(text)
    unit = match and _CF_UNITS.get(match[1].lower())
    return (unit, match[2].replace("UTC", "").strip()) if unit else None


def _column(values, units):
    """Return a column: dates where its units are `seconds since ...`, else its numbers."""
    mask, data = np.ma.getmaskarray(values), np.ma.getdata(values)
    if not _since(units):
        return pa.array(data, mask=mask)
    import pandas as pd

    unit, date = _since(units)
    try:
        origin = pd.Timestamp(date)
        origin = (origin.tz_localize("UTC") if origin.tz is None else origin).as_unit("ns")
        dates = origin + pd.to_timedelta(data, unit=unit)
    except (ValueError, OverflowError) as error:
        raise RejectedLog(f"the stamps, {units}, are no dates of the years {YEARS}") from error
    return pa.array(dates.tz_convert(None), mask=mask)
