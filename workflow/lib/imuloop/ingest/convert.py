"""From raw batches to samples: SI units, time from zero, faulty rows dropped and counted."""

from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa

from imuloop.core.errors import ImuloopError, RejectedLog
from imuloop.core.samples import ACCELERATION, CHANNELS, LOGGED_TIME, TEMPERATURE, TIME
from imuloop.core.units import TEMPERATURE as ZERO_OFFSETS
from imuloop.core.units import TIME as TIME_SCALES
from imuloop.ingest import increments
from imuloop.ingest.bursts import Points
from imuloop.ingest.clocks import Clock, ahead
from imuloop.ingest.columns import unknown_unit
from imuloop.ingest.raw_log import STAMP
from imuloop.ingest.stamps import (
    NANOSECONDS,
    absolute_nanoseconds,
    is_iso,
    iso_nanoseconds,
    no_stamps,
    stamp_values,
)

# what no sensor gives, whatever it is logged in: counts of 32 bits, taken for SI, end at 4.3e9; the
# widest accelerometers at 2e6 m/s^2
BEYOND = 1e10


@dataclass
class Counts:
    """What became of the rows of a log; each row is counted once.

    Attributes
    ----------
    read : int
        Rows of the log.
    outside : int
        Rows outside of the time range.
    non_finite : int
        Rows dropped because the stamp or one of the six axes is missing, no finite number or
        `BEYOND` every sensor.
    duplicates : int
        Rows dropped because their stamp repeats the one before.
    out_of_order : int
        Rows dropped because their stamp lies before an earlier row's.
    without_interval : int
        Rows dropped because they hold increments and none comes before them.
    by_usual_step : int
        Rows of increments after a gap, which were divided by the usual step.
    intervals_ns : int
        Sum of the intervals of the samples' increments, ns.
    kept : int
        Rows that became samples.
    missing_values : dict
        Channel to number of values missing or not finite.
    impossible_values : dict
        Channel to number of values `BEYOND` every sensor, which count as missing.
    start_ns : int or None
        Moment of the first sample, ns since 1970; None where the stamps are no dates.
    time_unit : str or None
        Unit of the stamps, as found; None before the first row.
    clock : Clock
        What was mended in the stamps.
    outside_marks : ndarray, shape (2,)
        Samples before the first and after the last 1PPS mark.
    points : Points
        Row number and time as stamped, of some of the samples.
    """

    read: int = 0
    outside: int = 0
    non_finite: int = 0
    duplicates: int = 0
    out_of_order: int = 0
    without_interval: int = 0
    by_usual_step: int = 0
    intervals_ns: int = 0
    kept: int = 0
    missing_values: dict = field(default_factory=lambda: dict.fromkeys(CHANNELS, 0))
    impossible_values: dict = field(default_factory=lambda: dict.fromkeys(CHANNELS, 0))
    start_ns: int | None = None
    time_unit: str | None = None
    clock: Clock = field(default_factory=Clock)
    outside_marks: np.ndarray = field(default_factory=lambda: np.zeros(2, dtype=int))
    points: Points = field(default_factory=Points)


def si_batches(
    log, *, units, raw_units, rate, time_range, counts, step=None, usual=None, timeline=None
):
    """Give the samples of a log, batch by batch.

    Parameters
    ----------
    log : RawLog
        Log being read.
    units : dict
        Unit of ``time``, ``temperature`` and ``interval``, and of the sensors, whose increments
        become rates.
    raw_units : dict
        ``acceleration`` and ``angular_rate`` to `RawUnit`.
    rate : float or None
        Hz; stamps rows by their number where the log has no stamps.
    time_range : (start, end) or None
        Half-open crop: seconds from the log's first stamp, or ISO 8601 stamps; None is open.
    counts : Counts
        Filled on the way.
    step : float, optional
        Seconds from row to row; `t` is then rebuilt from the row number, `t_logged` as stamped.
    usual : float, optional
        Usual step of the stamps, s; that of increments after a gap.
    timeline : imuloop.ingest.pps.Timeline, optional
        GNSS time over the stamps; `t` is then in it.

    Yields
    ------
    pyarrow.RecordBatch
        Columns as in `imuloop.core.samples`, `t` strictly increasing from 0.

    Raises
    ------
    ImuloopError
        If there are neither stamps nor a rate, or the stamps do not fit what is declared.
    """
    channels = (*CHANNELS, TEMPERATURE) if log.temperature else CHANNELS
    counts.missing_values.update(dict.fromkeys(channels, 0))
    counts.impossible_values.update(dict.fromkeys(channels, 0))
    factors = increments.factors(units)
    for quantity in factors.keys() & log.interpolated:
        raise ImuloopError(
            f"units.{quantity}: {units[quantity]} is a unit of increments, which are not "
            "interpolated onto the clock of another sensor"
        )
    origin = newest = zero = first = window = dated = stamped = None
    for (x, readable, absolute, scale, batch), after in ahead(_clocked(log, units, rate)):
        raw = {name: batch.column(name).to_numpy(zero_copy_only=False) for name in channels}
        rows = np.arange(counts.read, counts.read + batch.num_rows)
        counts.read += batch.num_rows
        if not readable.any() and origin is None:
            if batch.num_rows and STAMP in batch.schema.names:
                raise no_stamps(batch.column(STAMP), log.found.get("time"))
            if batch.num_rows:
                raise RejectedLog("the log has no time column, and no interval that is a number")
            continue
        if STAMP in batch.schema.names:
            tick = None if absolute else NANOSECONDS[units["time"]]
            x, readable = counts.clock.mended(x, readable, after, tick)
            if timeline:
                x, scale = np.where(readable, timeline.at(x), 0.0), 1.0
        if not readable.any() and origin is None:
            counts.non_finite += batch.num_rows
            continue
        if origin is None:
            origin, dated = x[readable.argmax()].item(), absolute
            stamped = STAMP in batch.schema.names
            counts.time_unit = units["time"] if stamped else _unstamped(rate, units)
            if absolute:
                counts.time_unit = "ISO 8601"
            if timeline:
                counts.time_unit = f"{units['time']}, by 1PPS"
            # before all stamps, so that the first one counts as later
            newest = origin - 1
            moment = _moment(origin, units, absolute, timeline) if stamped else None
            window = _window(time_range, moment)
        if absolute != dated and readable.any():
            raise RejectedLog(f"the stamps change their kind before row {counts.read}")

        before = _newest_before(x, readable, newest)
        newest = max(newest, x[readable].max().item()) if readable.any() else newest
        # a row without a stamp lies where the log has got to
        elapsed = (np.where(readable, x, before) - origin) * scale
        inside = (elapsed >= window[0]) & (elapsed < window[1])
        starts = wide = np.zeros(len(x), dtype=bool)
        if factors:
            # where intervals are logged, steps are not needed
            constant = 1.0 if "interval" in units else step if stamped else scale
            steps, starts, wide = increments.steps(x, before, origin, scale, usual, constant)
            intervals = increments.intervals(batch, units, steps)
            raw |= increments.rates(raw, units, intervals)
        values = {name: _si(name, raw[name], units, raw_units) for name in channels}
        beyond = {name: np.abs(values[name]) > BEYOND for name in channels}
        usable = {name: np.isfinite(raw[name]) & ~beyond[name] for name in channels}
        finite = readable & np.all([usable[name] for name in CHANNELS], axis=0)
        # a clock that is rebuilt takes the rows as they come, however late their stamps are
        early = (x < before) & (step is None)
        fits = inside & finite & (x != before) & ~early
        keep = fits & ~starts
        counts.without_interval += int((fits & starts).sum())
        counts.by_usual_step += int((keep & wide).sum())
        if factors:
            counts.intervals_ns += increments.nanoseconds(intervals, keep)
        counts.outside += int((~inside).sum())
        counts.non_finite += int((inside & ~finite).sum())
        counts.duplicates += int((inside & finite & (x == before)).sum())
        counts.out_of_order += int((inside & finite & early).sum())
        counts.kept += int(keep.sum())
        for name in channels:
            missing = ~np.isfinite(raw[name])
            counts.missing_values[name] += int((inside & missing).sum())
            counts.impossible_values[name] += int((inside & beyond[name] & ~missing).sum())
        if not keep.any():
            continue
        if zero is None:
            zero, first = x[keep][0].item(), rows[keep][0].item()
            if stamped:
                counts.start_ns = _moment(zero, units, absolute, timeline)
        samples = {TIME: (x[keep] - zero) * scale}
        if step is not None:
            samples = {TIME: (rows[keep] - first) * step, LOGGED_TIME: samples[TIME]}
        elif timeline:
            counts.outside_marks += timeline.outside(x[keep])
        elif stamped:
            counts.points.add(rows[keep], samples[TIME])
        samples |= {name: values[name][keep] for name in CHANNELS}
        if log.temperature:
            samples[TEMPERATURE] = np.where(usable[TEMPERATURE], values[TEMPERATURE], np.nan)[keep]
        yield pa.RecordBatch.from_pydict(samples)


# a count of 1e306 has no value in SI
@np.errstate(over="ignore")
def _si(name, raw, units, raw_units):
    """Return values of a channel in SI."""
    if name == TEMPERATURE:
        return raw - ZERO_OFFSETS[units["temperature"]]
    return raw_units["acceleration" if name in ACCELERATION else "angular_rate"].to_si(raw)


def _moment(stamp, units, absolute, timeline):
    """Return a stamp as ns since 1970, or None where it is no date."""
    if timeline:
        return timeline.moment(stamp)
    return absolute_nanoseconds(stamp, units["time"], absolute)


def survey(log, units, log_marks=None):
    """Return the span of a log's counter, if it rolls over, its range, and seconds per unit.

    Parameters
    ----------
    log : RawLog
        Log being read.
    units : dict
        Unit of ``time``.
    log_marks : imuloop.ingest.pps.LogMarks, optional
        Takes the marks in the log.
    """
    if "time" not in log.found:
        raise ImuloopError("pps: the log has no time column, which is to be the local counter")
    clock, low, high, width = Clock(), np.inf, -np.inf, None
    for (x, readable, absolute, _, batch), after in ahead(_clocked(log, units, None)):
        if absolute:
            raise ImuloopError("pps: the log's stamps are dates, not a local counter")
        tick = NANOSECONDS[units["time"]]
        mended, usable = clock.mended(x, readable, after, tick)
        width = clock.span_s and round(clock.span_s * 1e9) // tick
        if usable.any():
            low = min(low, mended[usable].min().item())
            high = max(high, mended[usable].max().item())
        if log_marks is not None:
            log_marks.add(batch, x, mended, usable, width)
    if clock.resets:
        raise RejectedLog("1PPS: the local counter starts again, so that its marks are lost")
    return width, (low, high), tick


def _unstamped(rate, units):
    return f"1/({rate:g} Hz)" if rate else f"sum of intervals, {units['interval']}"


def _clocked(log, units, rate):
    """Give stamps, which are readable, whether they are dates, seconds per unit, and the batch."""
    row, past = 0, (0, 0)
    for batch in log.batches:
        if STAMP not in batch.schema.names and not rate and "interval" in units:
            x, readable, past = increments.summed_intervals(batch, past)
            yield x, readable, False, TIME_SCALES[units["interval"]], batch
        else:
            yield *_clock(batch, log, units, rate, row), batch
        row += batch.num_rows


def _clock(batch, log, units, rate, row):
    """Return stamps, which are readable, whether they are dates, and seconds per unit."""
    if STAMP not in batch.schema.names:
        if not rate:
            raise ImuloopError(
                f"the log has no time column that can be told by its name ({log.columns}); "
                "name it in columns.time, or give rate in Hz"
            )
        stamps = np.arange(row, row + batch.num_rows, dtype=np.int64)
        return stamps, np.ones(batch.num_rows, dtype=bool), False, 1 / rate
    x, readable, absolute = stamp_values(batch.column(STAMP))
    if absolute:
        return x, readable, True, 1e-9
    if is_iso(units["time"]):
        raise ImuloopError(
            f"units.time is ISO 8601, but column '{log.found.get('time')}' holds numbers; "
            f"use one of {', '.join(TIME_SCALES)}"
        )
    if units["time"] not in TIME_SCALES:
        raise unknown_unit("time", units["time"])
    return x, readable, False, TIME_SCALES[units["time"]]


def _newest_before(x, readable, newest):
    """Return the newest stamp before each row."""
    lowest = np.iinfo(np.int64).min if x.dtype.kind == "i" else -np.inf
    seen = np.maximum.accumulate(np.where(readable, x, lowest))
    return np.maximum(np.concatenate(([newest], seen[:-1])).astype(seen.dtype), newest)


def _window(time_range, first):
    """Return the crop in seconds from the log's first stamp, which is `first` ns since 1970."""
    limits = [-np.inf, np.inf]
    for i, value in enumerate(time_range or ()):
        if isinstance(value, (int, float)):
            limits[i] = float(value)
        elif value is not None and first is None:
            raise ImuloopError(
                f"time_range: '{value}' is a date, but the log's stamps are not; give seconds"
            )
        elif value is not None:
            limits[i] = (iso_nanoseconds(value) - first) * 1e-9
    if not limits[0] < limits[1]:
        raise ImuloopError(f"time_range: the start {limits[0]:g} s is not before the end")
    return limits
