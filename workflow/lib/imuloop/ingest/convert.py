"""From the rows of a log to samples: SI units, time from zero, faulty rows dropped and counted."""

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import ACCELERATION, CHANNELS, LOGGED_TIME, OWN_TIME, TEMPERATURE, TIME
from imuloop.core.units import TEMPERATURE as DEGREES
from imuloop.core.units import TIME as TIME_SCALES
from imuloop.ingest import increments, misread
from imuloop.ingest.clocks import Clock
from imuloop.ingest.columns import HELD, STAMP
from imuloop.ingest.even_stamps import spread
from imuloop.ingest.spellings import is_iso, unknown_unit
from imuloop.ingest.stamps import (
    NANOSECONDS,
    absolute_nanoseconds,
    check_unit,
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

    `identical` are rows that repeat the one before in stamp and all values: nothing is lost.
    `like_gravity` and `in_two_units` are as in `misread`.
    `points` are number and time of each row, (n, 2); `outside_marks` samples before the first and
    after the last 1PPS mark; `start_ns` the moment of the first sample, ns since 1970, None without
    dates, `begin_s` how long it is after the log's first stamp, s.
    """

    read: int = 0
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
    points: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))

    def add(self, **rows):
        """Count rows, a mask each."""
        for name, mask in rows.items():
            setattr(self, name, getattr(self, name) + int(np.count_nonzero(mask)))


@dataclass(frozen=True)
class Rows:
    """All rows of a log.

    `channels` are numbers by name, as logged; `stamps` are columns of stamps by name, as of
    `stamp_values`; `x` are the stamps of the rows, or their numbers, of `scale` s each, `readable`
    which of them are, `dates` whether they are ns since 1970.
    """

    channels: dict
    stamps: dict
    x: np.ndarray
    readable: np.ndarray
    dates: bool
    scale: float


def all_rows(log, units, rate):
    """Return the `Rows` of a log; None of a log without any."""
    batch, channels, stamps = log.batch, {}, {}
    if not batch.num_rows:
        return None
    for name in batch.schema.names:
        if name in CHANNELS or name == TEMPERATURE:
            channels[name] = batch[name].to_numpy(zero_copy_only=False)
        else:
            stamps[name] = stamp_values(batch[name])
    if STAMP in stamps:
        x, readable, dates = stamps[STAMP]
        if not readable.any():
            raise no_stamps(batch[STAMP], log.found.get("time"))
        return Rows(channels, stamps, x, readable, dates, 1e-9 if dates else _scale(log, units))
    if not rate:
        raise ImuloopError(
            f"the log has no time column of a usual name ({log.columns}); "
            "name it in columns.time, or give rate in Hz"
        )
    x = np.arange(batch.num_rows, dtype=np.int64)
    return Rows(channels, stamps, x, np.ones(len(x), dtype=bool), False, 1 / rate)


def no_samples(log):
    """Return the columns of samples of a log, without any row."""
    names = [TIME, *CHANNELS, *[TEMPERATURE] * log.temperature]
    names += [OWN_TIME[log.slower]] if log.slower else []
    return {name: np.empty(0) for name in names}


def si_samples(
    rows,
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
    """Return the columns of the samples of a RawLog, `t` strictly increasing from 0.

    Of a sensor that the log lacks they are zero.
    `rows` are as in `all_rows`; `units` and `raw_units` are the unit of each quantity and the
    `RawUnit` of each sensor; `rate`, Hz, stamps rows of a log without stamps; `time_range` is a
    half-open crop, seconds from the log's first stamp or ISO 8601, None is open; `counts` are
    filled on the way. With `even` samples (`even_stamps.Even`) `t` is rebuilt from the row number
    and `t_logged` is as stamped; `usual` is the step of the stamps, s, that increments after a gap
    are of; with a `timeline`, of 1PPS, `t` is GNSS time; `packets` are as of
    `even_stamps.packet_step`.
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
    if rows is None:
        return no_samples(log)
    x, readable, scale, stamped = rows.x, rows.readable, rows.scale, STAMP in rows.stamps
    absent = dict.fromkeys({*CHANNELS} - {*rows.channels}, np.zeros(len(x)))
    raw = absent | rows.channels
    counts.read = len(x)
    same = _identical(x, readable, raw)
    counts.like_gravity = misread.like_gravity(raw)
    # numbers of samples, among which a row that is written twice is one
    number = np.arange(len(x)) - same.cumsum()
    if stamped:
        counts.in_two_units.update(misread.in_two_units(x, raw))
        tick = None if rows.dates else NANOSECONDS[units["time"]]
        if packets:
            x = spread(x, readable & ~same, packets[0] / scale, packets[1])
        x, readable = counts.clock.mended(x, readable, tick)
        if timeline:
            x, scale = np.where(readable, timeline.at(x), 0.0), 1.0
    if not readable.any():
        counts.non_finite = len(x)
        return no_samples(log)
    origin = x[readable.argmax()].item()
    if stamped and not rows.dates and not timeline:
        check_unit(origin, units["time"])
    counts.time_unit = _time_unit(stamped, rows.dates, units, rate, timeline)
    moment = _moment(origin, units, rows.dates, timeline) if stamped else None
    window = _window(time_range, moment)
    before = _newest_before(x, readable, origin)
    # a row without a stamp lies where the log has got to
    elapsed = (np.where(readable, x, before) - origin) * scale
    inside = (elapsed >= window[0]) & (elapsed < window[1]) & ~same
    starts = wide = np.zeros(len(x), dtype=bool)
    if summed:
        # where intervals are logged, steps are not needed
        constant = 1.0 if "interval" in units else step if stamped else scale
        steps, starts, wide = increments.steps(x, before, origin, scale, usual, constant)
        raw |= increments.rates(raw, rows.stamps, units, steps)
    values = {name: _si(name, raw[name], units, raw_units) for name in channels} | absent
    bad = ~readable
    for name in channels:
        missing = ~np.isfinite(raw[name])
        beyond = ~missing & (np.abs(values[name]) > BEYOND)
        counts.missing_values[name] = int((inside & missing).sum())
        counts.impossible_values[name] = int((inside & beyond).sum())
        if name == TEMPERATURE:
            values[name] = np.where(missing | beyond, np.nan, values[name])
        else:
            bad |= missing | beyond
    # a clock that is rebuilt takes the rows as they come, however late their stamps are, and
    # samples that came together
    early, repeated = (x < before) & (step is None), (x == before) & (step is None)
    good = inside & ~bad
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
    )
    if not keep.any():
        return no_samples(log)
    x, number = x[keep], number[keep]
    zero = x[0].item()
    counts.begin_s = float((zero - origin) * scale)
    if stamped:
        counts.start_ns = _moment(zero, units, rows.dates, timeline)
    t = (x - zero) * scale
    samples = {TIME: t} | {name: values[name][keep] for name in channels}
    if step is not None:
        number = even.number(number)
        samples |= {TIME: (number - number[0]) * step, LOGGED_TIME: t}
    elif timeline:
        counts.outside_marks = timeline.outside(x)
    elif stamped:
        counts.points = np.column_stack([number, t])
    if log.slower:
        own = (rows.stamps[HELD][0][keep] - zero) * scale
        samples[OWN_TIME[log.slower]] = _own_time(own, samples)
    return samples


def _own_time(stamped, samples):
    """Return the own time of the samples that rows hold, s; rebuilt with that of the rows."""
    if LOGGED_TIME not in samples:
        return stamped
    _, first, which = np.unique(stamped, return_index=True, return_inverse=True)
    return samples[TIME][first][which]


def _identical(x, readable, raw):
    """Return which rows repeat the one before in stamp and all values."""
    same = np.zeros(len(x), dtype=bool)
    at = np.flatnonzero((x[1:] == x[:-1]) & readable[1:]) + 1
    for values in raw.values():
        one, other = values[at], values[at - 1]
        at = at[(one == other) | (np.isnan(one) & np.isnan(other))]
    same[at] = True
    return same


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


def _newest_before(x, readable, origin):
    """Return the newest stamp before each row, one before `origin` where there is none."""
    seen = np.maximum.accumulate(np.where(readable, x, origin - 1))
    return np.concatenate(([origin - 1], seen[:-1])).astype(seen.dtype)


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
