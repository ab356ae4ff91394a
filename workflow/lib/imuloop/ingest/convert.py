"""From raw batches to samples: SI units, time from zero, faulty rows dropped and counted."""

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
import pyarrow as pa

from imuloop.core.errors import ImuloopError, RejectedLog
from imuloop.core.samples import ACCELERATION, CHANNELS, LOGGED_TIME, OWN_TIME, TEMPERATURE, TIME
from imuloop.core.units import TEMPERATURE as DEGREES
from imuloop.core.units import TIME as TIME_SCALES
from imuloop.ingest import increments, misread
from imuloop.ingest.clocks import Clock, with_lookahead
from imuloop.ingest.columns import HELD, STAMP
from imuloop.ingest.even_stamps import POINTS, spread
from imuloop.ingest.spellings import unknown_unit
from imuloop.ingest.stamps import (
    NANOSECONDS,
    absolute_nanoseconds,
    check_unit,
    is_iso,
    iso_nanoseconds,
    no_stamps,
    stamp_values,
)
from imuloop.ingest.thinning import EvenSubsample

# what no sensor gives, whatever it is logged in: counts of 32 bits, taken for SI, end at 4.3e9; the
# widest accelerometers at 2e6 m/s^2
BEYOND = 1e10


@dataclass
class Counts:
    """What became of the rows of a log; each row is counted once.

    `identical` are rows that repeat the one before in stamp and all values: nothing is lost.
    `like_gravity` and `in_two_units` are as of `misread`.
    `points` are number and time of some rows; `outside_marks` samples before the first and after
    the last 1PPS mark; `start_ns` the moment of the first sample, ns since 1970, None without
    dates, `begin_s` how long it is after the log's first stamp, s.
    """

    read: int = 0
    kept: int = 0
    outside: int = 0
    non_finite: int = 0
    duplicates: int = 0
    identical: int = 0
    out_of_order: int = 0
    without_interval: int = 0
    by_usual_step: int = 0
    missing_values: dict = field(default_factory=lambda: dict.fromkeys(CHANNELS, 0))
    impossible_values: dict = field(default_factory=lambda: dict.fromkeys(CHANNELS, 0))
    spiked: int = 0
    spike_values: dict = field(default_factory=lambda: dict.fromkeys(CHANNELS, 0))
    start_ns: int | None = None
    begin_s: float = 0.0
    time_unit: str | None = None
    clock: Clock = field(default_factory=Clock)
    like_gravity: np.ndarray = field(default_factory=lambda: np.zeros(2, dtype=int))
    in_two_units: Counter = field(default_factory=Counter)
    outside_marks: np.ndarray = field(default_factory=lambda: np.zeros(2, dtype=int))
    points: EvenSubsample = field(default_factory=lambda: EvenSubsample(POINTS))

    def add(self, **rows):
        """Count rows, a mask each."""
        for name, mask in rows.items():
            setattr(self, name, getattr(self, name) + int(np.count_nonzero(mask)))


def si_batches(
    log,
    *,
    units,
    raw_units,
    rate,
    time_range,
    counts,
    even=None,
    usual=None,
    timeline=None,
    packets=None,
):
    """Give the samples of a RawLog, batch by batch, `t` strictly increasing from 0.

    Of a sensor that the log lacks they are zero.
    `units` and `raw_units` are the unit of each quantity and the `RawUnit` of each sensor; `rate`,
    Hz, stamps rows of a log without stamps; `time_range` is a half-open crop, seconds from the
    log's first stamp or ISO 8601, None is open; `counts` are filled on the way. With `even` samples
    (`even_stamps.Even`) `t` is rebuilt from the row number and `t_logged` is as stamped; `usual` is
    the step of the stamps, s, that increments after a gap are of; with a `timeline`, of 1PPS, `t`
    is GNSS time; `packets` are as of `even_stamps.packet_step`.
    """
    step = even and even.step
    channels = (*CHANNELS, TEMPERATURE) if log.temperature else CHANNELS
    for kind in (counts.missing_values, counts.impossible_values):
        kind.update(dict.fromkeys(channels, 0))
    summed = increments.factors(units)
    if log.slower and summed:
        raise ImuloopError(
            f"units of {' and '.join(summed)}: increments of two sensors have to be on one clock"
        )
    origin = zero = last = held = None
    for (x, readable, absolute, scale, batch), after in with_lookahead(_clocked(log, units, rate)):
        absent = dict.fromkeys({*CHANNELS} - {*batch.schema.names}, np.zeros(batch.num_rows))
        logged = (name for name in channels if name not in absent)
        raw = absent | {name: batch.column(name).to_numpy(zero_copy_only=False) for name in logged}
        counts.read += batch.num_rows
        stamped = STAMP in batch.schema.names
        same, last = _identical(x, readable, raw, last)
        counts.like_gravity += misread.like_gravity(raw)
        if stamped:
            counts.in_two_units.update(misread.in_two_units(x, raw))
        # numbers of samples, among which a row that is written twice is one
        rows = counts.read - batch.num_rows - counts.identical + np.arange(len(x)) - same.cumsum()
        if not readable.any() and origin is None:
            if batch.num_rows:
                raise no_stamps(batch.column(STAMP), log.found.get("time"))
            continue
        if stamped:
            tick = None if absolute else NANOSECONDS[units["time"]]
            if packets:
                x, held = spread(x, readable & ~same, after, held, packets[0] / scale, packets[1])
            x, readable = counts.clock.mended(x, readable, after, tick)
            if timeline:
                x, scale = np.where(readable, timeline.at(x), 0.0), 1.0
        if origin is None:
            if not readable.any():
                counts.non_finite += batch.num_rows
                continue
            origin, dated = x[readable.argmax()].item(), absolute
            if stamped and not absolute and not timeline:
                check_unit(origin, units["time"])
            counts.time_unit = _time_unit(stamped, absolute, units, rate, timeline)
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
        if summed:
            # where intervals are logged, steps are not needed
            constant = 1.0 if "interval" in units else step if stamped else scale
            steps, starts, wide = increments.steps(x, before, origin, scale, usual, constant)
            raw |= increments.rates(raw, batch, units, steps)
        values = {name: _si(name, raw[name], units, raw_units) for name in channels} | absent
        missing, beyond, bad = {}, {}, ~readable
        for name in channels:
            # one comparison where, as nearly always, all can be used
            if np.abs(values[name]).max(initial=0.0) <= BEYOND:
                continue
            missing[name] = ~np.isfinite(raw[name])
            beyond[name] = ~missing[name] & (np.abs(values[name]) > BEYOND)
            if name != TEMPERATURE:
                bad |= missing[name] | beyond[name]
        # a clock that is rebuilt takes the rows as they come, however late their stamps are
        early = (x < before) & (step is None)
        inside &= ~same
        good = inside & ~bad
        # and samples that came together
        repeated = (x == before) & (step is None)
        fits = good & ~repeated & ~early
        keep = fits & ~starts
        counts.add(
            identical=same,
            outside=~inside & ~same,
            non_finite=inside & bad,
            duplicates=good & repeated,
            out_of_order=good & early,
            without_interval=fits & starts,
            by_usual_step=keep & wide,
            kept=keep,
        )
        for name in missing:
            counts.missing_values[name] += int((inside & missing[name]).sum())
            counts.impossible_values[name] += int((inside & beyond[name]).sum())
        if not keep.any():
            continue
        # no copies where, as nearly always, all are kept
        keep = slice(None) if keep.all() else keep
        if zero is None:
            zero, first = x[keep][0].item(), rows[keep][0].item()
            counts.begin_s = float((zero - origin) * scale)
            if stamped:
                counts.start_ns = _moment(zero, units, absolute, timeline)
        samples = {TIME: (x[keep] - zero) * scale}
        if step is not None:
            number = even.number(rows[keep]) - even.number(first)
            samples = {TIME: number * step, LOGGED_TIME: samples[TIME]}
        elif timeline:
            counts.outside_marks += timeline.outside(x[keep])
        elif stamped:
            counts.points.add(np.column_stack([rows[keep], samples[TIME]]))
        if TEMPERATURE in missing:
            values[TEMPERATURE][missing[TEMPERATURE] | beyond[TEMPERATURE]] = np.nan
        samples |= {name: values[name][keep] for name in channels}
        if log.slower:
            held = batch.column(HELD).to_numpy()[keep]
            samples[OWN_TIME[log.slower]] = _own_time((held - zero) * scale, samples)
        yield pa.RecordBatch.from_pydict(samples)


def _own_time(stamped, samples):
    """Return the own time of the samples that rows hold, s; rebuilt with that of the rows."""
    if LOGGED_TIME not in samples:
        return stamped
    _, first, which = np.unique(stamped, return_index=True, return_inverse=True)
    return samples[TIME][first][which]


def _identical(x, readable, raw, last):
    """Return which rows repeat the one before in stamp and all values, and the last row.

    `last` is that of the batch before, None of the first.
    """
    same = np.zeros(len(x), dtype=bool)
    if not len(x):
        return same, last
    at = np.flatnonzero((x[1:] == x[:-1]) & readable[1:]) + 1
    for values in raw.values():
        one, other = values[at], values[at - 1]
        at = at[(one == other) | (np.isnan(one) & np.isnan(other))]
    same[at] = True
    first, end = ([x[i], *(values[i] for values in raw.values())] for i in (0, -1))
    same[0] = last is not None and np.array_equal(first, last, equal_nan=True)
    return same, end


# a count of 1e306 has no value in SI
@np.errstate(over="ignore")
def _si(name, raw, units, raw_units):
    """Return values of a channel in SI."""
    if name == TEMPERATURE:
        scale, zero = DEGREES[units["temperature"]]
        return (raw - zero) * scale
    return raw_units["acceleration" if name in ACCELERATION else "angular_rate"].to_si(raw)


def _moment(stamp, units, absolute, timeline):
    """Return a stamp as ns since 1970, or None where it is no date."""
    if timeline:
        return timeline.moment(stamp)
    return absolute_nanoseconds(stamp, units["time"], absolute)


def _time_unit(stamped, absolute, units, rate, timeline):
    """Return the unit of the stamps, in words."""
    if timeline:
        return f"{units['time']}, by 1PPS"
    if stamped:
        return "ISO 8601" if absolute else units["time"]
    return f"1/({rate:g} Hz)"


def counter_batches(log, units, clock):
    """Give the counter of a log, mended, which can be used, and the raw batch."""
    if "time" not in log.found:
        raise ImuloopError("pps: the log has no time column, which is to be the local counter")
    for (x, readable, absolute, _, batch), after in with_lookahead(_clocked(log, units, None)):
        if absolute:
            raise ImuloopError("pps: the log's stamps are dates, not a local counter")
        yield *clock.mended(x, readable, after, NANOSECONDS[units["time"]]), batch


def _clocked(log, units, rate):
    """Give stamps, which are readable, whether they are dates, seconds per unit, and the batch."""
    row = 0
    for batch in log.batches:
        if STAMP in batch.schema.names:
            x, readable, absolute = stamp_values(batch.column(STAMP))
            yield x, readable, absolute, 1e-9 if absolute else _scale(log, units), batch
        elif rate:
            rows = np.arange(row, row + batch.num_rows, dtype=np.int64)
            yield rows, np.ones(len(rows), dtype=bool), False, 1 / rate, batch
        else:
            raise ImuloopError(
                f"the log has no time column of a usual name ({log.columns}); "
                "name it in columns.time, or give rate in Hz"
            )
        row += batch.num_rows


def _scale(log, units):
    """Return seconds per unit of stamps that are numbers."""
    if is_iso(units["time"]):
        raise ImuloopError(
            f"units.time is ISO 8601, but column '{log.found.get('time')}' holds numbers; "
            f"use one of {', '.join(TIME_SCALES)}"
        )
    if units["time"] not in TIME_SCALES:
        raise unknown_unit("time", units["time"])
    return TIME_SCALES[units["time"]]


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
