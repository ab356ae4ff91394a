"""The rows of a log as arrays, and the one clock that says when each of them was sampled."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import ANGULAR_RATE, CHANNELS, TEMPERATURE
from imuloop.core.units import TIME as TIME_SCALES
from imuloop.ingest import increments, pps
from imuloop.ingest.clocks import Clock
from imuloop.ingest.columns import STAMP
from imuloop.ingest.even_stamps import Even, even_samples, packet_step, spread
from imuloop.ingest.spellings import is_iso, unknown_unit
from imuloop.ingest.stamps import (
    NANOSECONDS,
    absolute_nanoseconds,
    check_unit,
    iso_nanoseconds,
    no_stamps,
    stamp_values,
)


@dataclass(frozen=True)
class Rows:
    """All rows of a log, and when they were sampled; arrays are (n,).

    Attributes
    ----------
    values : dict of str to array
        The six axes and the temperature as logged; 0 for a sensor that the log lacks.
    stamps : dict of str to tuple
        Columns of time stamps as `stamp_values` gives them.
    same : array of bool
        Rows that repeat the one before in time stamp and all values.
    x, usable : array
        Time stamps as mended, or numbers of the rows, of `scale` s each, and which of them can be
        used.
    unit : str
        Unit of the time stamps.
    declared : Declared
        What the config says of the log.
    clock : Clock
        What was mended.
    timeline : Timeline or None
        GNSS time over the local counter; `x` is in s then.
    even, packets : Even and tuple or None
        How time stamps were rebuilt, as in `even_stamps`.
    logged : array or None
        Times as stamped, s, if they were rebuilt.
    repeats : int
        Number of rows with the time stamp of another one.
    usual : float or None
        Usual step of the time stamps, s, by which increments after gaps are divided.
    """

    values: dict
    stamps: dict
    same: np.ndarray
    x: np.ndarray
    usable: np.ndarray
    scale: float
    unit: str
    declared: object
    clock: Clock
    timeline: pps.Timeline | None = None
    even: Even | None = None
    packets: tuple | None = None
    logged: np.ndarray | None = None
    repeats: int = 0
    usual: float | None = None

    @property
    def stamped(self):
        """Whether the log holds time stamps."""
        return STAMP in self.stamps

    @property
    def dates(self):
        """Whether the time stamps are ns since 1970."""
        return self.stamped and self.stamps[STAMP][2]

    @property
    def tick(self):
        """Nanoseconds per unit of the time stamps as logged; None for dates."""
        return None if self.dates else NANOSECONDS.get(self.unit)

    @cached_property
    def number(self):
        """Number of the sample of each row; a row that is written twice is one."""
        return np.arange(len(self.x)) - self.same.cumsum()

    @cached_property
    def origin(self):
        """The first time stamp."""
        return self.x[self.usable.argmax()].item()

    @cached_property
    def before(self):
        """Newest time stamp before each row; one before `origin` if there is none."""
        seen = np.maximum.accumulate(np.where(self.usable, self.x, self.origin - 1))
        return np.concatenate(([self.origin - 1], seen[:-1])).astype(seen.dtype)

    @cached_property
    def inside(self):
        """Rows within the time range that do not repeat the one before."""
        start, end = _window(self.declared.time_range, self.moment(self.origin))
        # a row without a time stamp lies where the log has got to
        elapsed = (np.where(self.usable, self.x, self.before) - self.origin) * self.scale
        return (elapsed >= start) & (elapsed < end) & ~self.same

    def times(self, keep):
        """Return the time of some rows from the first of them on, s, as stamped."""
        x = self.x[keep]
        return (x - x[:1].sum()) * self.scale

    def moment(self, stamp):
        """Return a time stamp as ns since 1970; None if it is no date."""
        if self.timeline:
            return self.timeline.moment(stamp)
        return absolute_nanoseconds(stamp, self.unit, self.dates) if self.stamped else None

    @property
    def time_unit(self):
        """Unit of the time stamps, in words."""
        if not self.stamped:
            return f"1/({self.declared.rate:g} Hz)"
        if self.timeline:
            return f"{self.unit}, by 1PPS"
        return "ISO 8601" if self.dates else self.unit


# values and stamps of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def find_rows(log, units, declared, marks_file=None):
    """Return the `Rows` of a log, on one clock.

    Time stamps that roll over, start again or stray are mended. A counter is made GNSS time by
    1PPS marks. The time stamps of a sensor that samples evenly are made even. `units` are the
    names of units by quantity, `declared` is what the config says, and `marks_file` is a file of
    marks.
    """
    rows = _rows_as_logged(log, units, declared)
    if not len(rows.x):
        return rows
    if rows.stamped:
        x, usable = rows.clock.mended(rows.x, rows.usable, rows.tick)
        rows = replace(rows, x=x, usable=usable)
    if declared.pps or marks_file:
        timeline = pps.find_timeline(rows, log, declared.pps, marks_file)
        x = np.where(rows.usable, timeline.at(rows.x), 0.0)
        rows = replace(rows, x=x, scale=1.0, timeline=timeline)
    elif rows.stamped and not rows.dates:
        check_unit(rows.origin, rows.unit)
    if rows.stamped and not rows.timeline:
        rows = _made_even(rows, bool(increments.factors(units)), increments.by_stamps(log, units))
    if increments.by_stamps(log, units):
        t = rows.times(_in_order(rows, by_stamps=True))
        rows = replace(rows, usual=np.median(np.diff(t)).item() if len(t) > 1 else None)
    return rows


def _rows_as_logged(log, units, declared):
    """Return the `Rows` of a log with its time stamps as logged; arguments as in `find_rows`."""
    batch, count, unit = log.batch, log.batch.num_rows, units["time"]
    values, stamps = dict.fromkeys(CHANNELS, np.zeros(count)), {}
    for name in batch.schema.names:
        if name in (*CHANNELS, TEMPERATURE):
            values[name] = batch[name].to_numpy(zero_copy_only=False)
        else:
            stamps[name] = stamp_values(batch[name])
    x, usable, scale = np.arange(count), np.ones(count, dtype=bool), 1.0
    if count and STAMP in stamps:
        (x, usable, dates), name = stamps[STAMP], log.found.get("time")
        if not usable.any():
            raise no_stamps(batch[STAMP], name)
        if not dates and is_iso(unit):
            raise ImuloopError(
                f"units.time is ISO 8601, but column '{name}' holds numbers; use one of "
                f"{', '.join(TIME_SCALES)}"
            )
        if not dates and unit not in TIME_SCALES:
            raise unknown_unit("time", unit)
        scale = 1e-9 if dates else TIME_SCALES[unit]
    elif count and not declared.rate:
        raise ImuloopError(
            f"the log has no time column of a usual name ({log.columns}); "
            "name it in columns.time, or give rate in Hz"
        )
    elif count:
        scale = 1 / declared.rate
    same = np.zeros(count, dtype=bool)
    at = np.flatnonzero((x[1:] == x[:-1]) & usable[1:]) + 1
    for column in values.values():
        one, other = column[at], column[at - 1]
        at = at[(one == other) | (np.isnan(one) & np.isnan(other))]
    same[at] = True
    return Rows(
        values=values,
        stamps=stamps,
        same=same,
        x=x,
        usable=usable,
        scale=scale,
        unit=unit,
        declared=declared,
        clock=Clock(),
    )


def _in_order(rows, by_stamps, repeated=False):
    """Return the complete rows whose time stamps go forward, or are `repeated`, (n,) of bool.

    If increments are divided by the steps of the stamps (`by_stamps`), the first row has none.
    """
    chosen = rows.x == rows.before if repeated else rows.x > rows.before
    chosen &= rows.usable & rows.inside
    if by_stamps and not repeated:
        chosen &= rows.before >= rows.origin
    for name in CHANNELS:
        chosen &= np.isfinite(rows.values[name])
    return chosen


def _made_even(rows, increments_held, by_stamps):
    """Return the rows with even time stamps, if their sensor samples evenly.

    `increments_held` tells whether rows hold increments, `by_stamps` whether these are divided by
    the steps of the time stamps.
    """
    new = _in_order(rows, by_stamps)
    if not new.any():
        return rows
    number, t = rows.number[new], rows.times(new)
    repeats = np.count_nonzero(_in_order(rows, by_stamps, repeated=True))
    packets = packet_step(number, t, repeats)
    even = None
    if not rows.clock.resets:
        turn_rate = [rows.values[name][new] for name in ANGULAR_RATE]
        rate = rows.declared.rate
        even = even_samples(number, t, turn_rate, packets, rate, increments_held)
    if not (packets or even):
        return rows
    x = rows.x
    if packets and not even:
        step, is_last = packets
        x = spread(x, rows.usable & ~rows.same, step / rows.scale, is_last)
    return replace(rows, x=x, even=even, packets=packets, logged=t, repeats=repeats)


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
