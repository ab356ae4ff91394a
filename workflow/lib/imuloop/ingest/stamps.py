"""Time stamps: whole numbers, decimal numbers or ISO 8601, kept as exact as they were written."""

from contextlib import suppress
from datetime import datetime

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from imuloop.core.errors import ImuloopError, RejectedLog
from imuloop.core.units import TIME

# whole nanoseconds per unit, so that absolute stamps stay exact
NANOSECONDS = {name: round(scale * 1e9) for name, scale in TIME.items()}
# upper limit of stamps, so that their differences fit 64 bits; and the years whose ns are below it
MOST = 1 << 62
YEARS = "1824 to 2115"
# slowest and fastest rate at which IMUs log, Hz
PLAUSIBLE_RATE = (0.05, 1e5)
# formats of dates other than ISO 8601; dates in American order have AM or PM
_DATES = ("%d-%b-%Y %H:%M:%S.%f", "%d-%b-%Y %H:%M:%S")
_DATES += ("%m/%d/%Y %I:%M:%S.%f %p", "%m/%d/%Y %I:%M:%S %p")
_OF_DAY = r"\d{1,2}:\d\d:\d\d(\.\d+)?"
# numbers that are between the years 2000 and 2100 as Unix time count as such, ns
_UNIX = (946_684_800 * 10**9, 4_102_444_800 * 10**9)


def parse_stamps(text):
    """Return the time stamps in a column of text as numbers or dates, an Arrow array.

    `text` is an Arrow array. The type of the result is int64, float64 or timestamp[ns] (UTC), the
    first that fits. Unreadable stamps become null. Stamps without a zone count as UTC. A time of
    the day, 23:59:59.25 or 23:59:59:250, and minutes and seconds, 59:59.25, become seconds.
    """
    for kind in (pa.int64(), pa.float64()):
        with suppress(pa.ArrowInvalid):
            return text.cast(kind)
    series = pc.utf8_trim_whitespace(text).to_pandas()
    # whole numbers keep all their digits if a few others are unreadable
    number = pd.to_numeric(series, errors="coerce", dtype_backend="numpy_nullable")
    if number.notna().any():
        return pa.array(number)
    # put zero hours before minutes and seconds, and a point before milliseconds after a colon
    clock = series.str.replace(r"^(\d\d:\d\d\.\d+)$", r"00:\1", regex=True)
    clock = clock.str.replace(r"^(.*:\d\d:\d\d):(\d{3})$", r"\1.\2", regex=True)
    clock = clock.where(clock.str.fullmatch(_OF_DAY).fillna(False).astype(bool))
    if clock.notna().any():
        return pa.array(pd.to_timedelta(clock).dt.total_seconds(), from_pandas=True)
    for form in ("ISO8601", *_DATES):
        moment = pd.to_datetime(series, format=form, utc=True, errors="coerce")
        if moment.notna().any():
            break
    return stamp_array(pa.array(moment, from_pandas=True))


def stamp_array(column):
    """Return a column of time stamps of any type as int64, float64 or timestamp[ns].

    `column` is an Arrow array. A date outside of `YEARS` becomes null; if all dates are outside,
    they keep their unit. Raises a RejectedLog for stamps of 2^63 and more.
    """
    kind = column.type
    if pa.types.is_dictionary(kind):
        return stamp_array(column.dictionary_decode())
    if pa.types.is_timestamp(kind):
        most, ticks = MOST // NANOSECONDS[kind.unit], column.cast(pa.int64())
        within = pc.and_(pc.less_equal(ticks, most), pc.greater_equal(ticks, -most))
        if not pc.any(within).as_py():
            return column
        column = pc.if_else(within, column, pa.scalar(None, kind))
        return column.cast(pa.timestamp("ns", kind.tz)).cast(pa.timestamp("ns"))
    if pa.types.is_string(kind) or pa.types.is_large_string(kind):
        return parse_stamps(column)
    try:
        return column.cast(pa.int64() if pa.types.is_integer(kind) else pa.float64())
    except pa.ArrowInvalid as error:
        raise RejectedLog("stamps of 2^63 and more are not read") from error


def joined_stamps(seconds, parts, part_ns):
    """Return the time stamps in two columns, whole seconds and parts of a second, as ns, int64.

    `seconds` and `parts` are Arrow arrays, the latter in units of `part_ns` ns. A stamp is null if
    one of its numbers cannot be read, or if the part is a second or more.
    """
    (whole, readable, dates), (part, sound, _) = map(stamp_values, (seconds, parts))
    sound = sound & readable & (part >= 0) & (part * part_ns < 10**9) & (not dates)
    # larger stamps do not fit 64 bits in ns
    sound &= np.abs(whole) < MOST // 10**9
    whole, part = (np.where(sound, x, 0).round().astype(np.int64) for x in (whole, part))
    return pa.array(whole * 10**9 + part * part_ns, mask=~sound)


def stamp_values(column):
    """Return time stamps as numbers, (n,), the mask of readable ones, (n,), and if they are dates.

    `column` is an Arrow array of n stamps, as `stamp_array` returns it. The numbers are int64, ns
    since 1970 for dates, or float64. A stamp that is not readable is 0.
    """
    dates = pa.types.is_timestamp(column.type)
    if dates and column.type.unit != "ns":
        # all of them are outside of `YEARS`
        column = pa.nulls(len(column), pa.int64())
    readable = column.is_valid().to_numpy(zero_copy_only=False)
    column = column.cast(pa.int64()) if dates else column
    values = column.fill_null(0).to_numpy(zero_copy_only=False)
    if values.dtype.kind == "f":
        readable = readable & np.isfinite(values)
    else:
        readable = readable & (values > -MOST) & (values < MOST)
    return np.where(readable, values, values.dtype.type(0)), readable, dates


def no_stamps(column, name, texts=()):
    """Return the error of a time column without a readable stamp.

    `column` is the Arrow array, and `name` its name, or a list of two names. `texts` are the first
    stamps as written, if they are text. The error is a RejectedLog for numbers that are too large
    and dates outside of `YEARS`, else an ImuloopError on the declaration.
    """
    listed = " and ".join(name) if isinstance(name, list) else name
    stamps = column.to_pandas().dropna()
    if len(stamps):
        why = f"its stamps, {stamps.iloc[0]} the first, are too large, or not of the years {YEARS}"
        return RejectedLog(f"time column '{listed}': {why}")
    quote = f" ('{texts[0][:80]}' the first)" if texts else ""
    return ImuloopError(
        f"time column '{listed}' holds neither numbers nor ISO 8601 stamps, nor whole seconds and "
        f"a part of a second{quote}; name the right one in columns.time, or give columns.time: "
        "null and rate in Hz"
    )


def iso_nanoseconds(value):
    """Return a declared ISO 8601 time as nanoseconds since 1970, UTC.

    `value` is a text or a date. Raises an ImuloopError for another text.
    """
    try:
        moment = pd.Timestamp(datetime.fromisoformat(str(value)))
    except ValueError as error:
        raise ImuloopError(f"time_range: '{value}' is no ISO 8601 stamp") from error
    return (moment if moment.tzinfo else moment.tz_localize("UTC")).as_unit("ns").value


def absolute_nanoseconds(stamp, unit, absolute):
    """Return a time stamp as nanoseconds since 1970, or None if it is not a date.

    If `absolute`, `stamp` is already nanoseconds since 1970. Otherwise it is a number in the unit
    `unit`, and is a date if, as Unix time, it lies between the years 2000 and 2100.
    """
    if absolute:
        return int(stamp)
    nanoseconds = stamp * NANOSECONDS[unit]
    return round(nanoseconds) if _UNIX[0] <= nanoseconds < _UNIX[1] else None


def check_unit(stamp, unit):
    """Raise a RejectedLog if the time stamps of a log are dates in a finer unit than declared.

    `stamp` is the first time stamp, a number, and `unit` its unit. The log is rejected if the stamp
    lies after the year 2100 in this unit, but between 2000 and 2100 in a finer unit.
    """
    finer = [name for name in NANOSECONDS if absolute_nanoseconds(stamp, name, False) is not None]
    if finer and stamp * NANOSECONDS[unit] >= _UNIX[1]:
        date = iso_text(absolute_nanoseconds(stamp, finer[0], False))
        why = f"the stamps, {stamp} the first, are no {unit}: in {finer[0]} it is {date}"
        raise RejectedLog(f"{why}; declare units.time: {finer[0]}")


def iso_text(nanoseconds):
    """Return a time, `nanoseconds` since 1970, as an ISO 8601 text, UTC."""
    return pd.Timestamp(nanoseconds, unit="ns").isoformat() + "Z"
