"""The rows of a log as arrays, and the one clock that says when each of them was sampled."""

import numpy as np

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import ANGULAR_RATE, CHANNELS, TEMPERATURE
from imuloop.core.units import TIME as TIME_SCALES
from imuloop.ingest import increments, pps
from imuloop.ingest.clocks import Clock
from imuloop.ingest.columns import STAMP
from imuloop.ingest.even_stamps import even_samples, packet_step, spread
from imuloop.ingest.stamps import (
    NANOSECONDS,
    absolute_nanoseconds,
    check_unit,
    iso_nanoseconds,
    no_stamps,
    stamp_values,
)


class Rows:
    """All rows of a log, and when they were sampled; arrays are (n,).

    Attributes
    ----------
    log, units, declared : RawLog, dict, Declared
        The log as it was read, its units by quantity, and the keys of the config about it.
    values : dict of str to array
        The six axes and the temperature as logged; zeros for a sensor that the log lacks.
    stamps : dict of str to tuple
        For each column of time stamps: its numbers, the mask of the readable ones, and whether
        they are dates.
    stamped, dates : bool
        Whether the log holds time stamps, and whether these are ns since 1970.
    tick : int or None
        Nanoseconds per unit of time stamps that may roll over; None for dates.
    same : array of bool
        Rows that repeat the one before in time stamp and all values.
    x, usable, before : array
        `x` are the mended time stamps, or the numbers of the rows, in units of `scale` s. `usable`
        is the mask of the usable ones. `before` has the newest usable one of all rows before each
        row; for the first row, it is `origin` - 1.
    clock : Clock
        The faults of the time stamps that were mended.
    timeline : Timeline or None
        GNSS time over the local counter; if it is given, `x` is in s.
    even, packets : Even and tuple, or None
        The even samples, if time stamps were rebuilt; and the result of `packet_step`, if rows
        share a time stamp.
    logged : array or None
        Times by the original stamps, s, if the stamps were rebuilt.
    repeats : int
        Number of rows with the time stamp of another one.
    """

    timeline = even = packets = logged = None
    repeats = 0

    def __init__(self, log, units, declared):
        self.log, self.units, self.declared, self.clock = log, units, declared, Clock()
        count, unit = log.batch.num_rows, units["time"]
        self.values, self.stamps = dict.fromkeys(CHANNELS, np.zeros(count)), {}
        for name in log.batch.schema.names:
            if name in (*CHANNELS, TEMPERATURE):
                self.values[name] = log.batch[name].to_numpy(zero_copy_only=False)
            else:
                self.stamps[name] = stamp_values(log.batch[name])
        self.stamped = STAMP in self.stamps
        if self.stamped:
            self.x, self.usable, self.dates = self.stamps[STAMP]
            self.tick = None if self.dates else NANOSECONDS.get(unit)
            self.scale = 1e-9 if self.dates else TIME_SCALES.get(unit)
            if count and not self.usable.any():
                raise no_stamps(log.batch[STAMP], log.names["time"])
            if self.scale is None:
                raise ImuloopError(
                    f"units.time is '{unit}', but column '{log.names['time']}' holds numbers; "
                    f"declare one of {', '.join(TIME_SCALES)}"
                )
        else:
            self.x, self.usable, self.dates = np.arange(count), np.ones(count, dtype=bool), False
            self.scale = 1 / (declared.rate or 1.0)
            if count and not declared.rate:
                raise ImuloopError(
                    f"the log has no time column of a usual name ({log.columns}); "
                    "name it in columns.time, or give rate in Hz"
                )
        repeats = np.flatnonzero((self.x[1:] == self.x[:-1]) & self.usable[1:]) + 1
        for column in self.values.values():
            one, other = column[repeats], column[repeats - 1]
            repeats = repeats[(one == other) | (np.isnan(one) & np.isnan(other))]
        self.same = np.zeros(count, dtype=bool)
        self.same[repeats] = True

    @property
    def number(self):
        """Number of the sample in each row, (n,), from 0.

        A row that is written twice is one sample.
        """
        return np.arange(len(self.x)) - self.same.cumsum()

    @property
    def origin(self):
        """The first usable time stamp, in units of `scale` s."""
        return self.x[self.usable.argmax()].item()

    @property
    def inside(self):
        """Mask of the rows in the time range that do not repeat the row before, (n,) of bool.

        A row without a usable time stamp counts as sampled at the newest one before it.
        """
        if not self.declared.time_range:
            return ~self.same
        start, end = _window(self.declared.time_range, self.moment(self.origin))
        # a row without a time stamp gets the newest one before it
        elapsed = (np.where(self.usable, self.x, self.before) - self.origin) * self.scale
        return (elapsed >= start) & (elapsed < end) & ~self.same

    @property
    def time_unit(self):
        """Unit of the time stamps, text; without time stamps it is the declared step."""
        if not self.stamped:
            return f"1/({self.declared.rate:g} Hz)"
        unit = "ISO 8601" if self.dates else self.units["time"]
        return f"{unit}, by 1PPS" if self.timeline else unit

    def times(self, keep):
        """Return the times of k of the rows, counted from the first of these, s, (k,).

        `keep` tells which rows: a mask, (n,) of bool, or a slice.
        """
        x = self.x[keep]
        return (x - x[0]) * self.scale

    def moment(self, stamp):
        """Return a time as ns since 1970; None if the time stamps of the log are not dates.

        `stamp` is the time in the unit of the time stamps; with 1PPS marks, GNSS time in s from the
        first mark.
        """
        if self.timeline:
            return self.timeline.moment(stamp)
        unit = self.units["time"]
        return absolute_nanoseconds(stamp, unit, self.dates) if self.stamped else None

    # values and stamps of a broken log can be of any size
    @np.errstate(over="ignore", invalid="ignore")
    def find_clock(self, marks_file=None):
        """Set the time stamps `x` of the rows to the time at which they were sampled, in place.

        Time stamps that roll over, start again or stray are mended. If there are 1PPS marks, in the
        log or in the file `marks_file`, the time stamps become GNSS time. Otherwise they are made
        even if the sensor samples evenly but its host stamps unevenly.
        """
        x = self.x
        if self.stamped:
            x, self.usable = self.clock.mended(x, self.usable, self.tick)
        self._put_on(x)
        if self.declared.pps or marks_file:
            self.timeline = pps.find_timeline(self, marks_file)
            self.scale = 1.0
            self._put_on(np.where(self.usable, self.timeline.at(x), 0.0))
        elif self.stamped:
            if not self.dates:
                check_unit(self.origin, self.units["time"])
            self._make_even()

    def _put_on(self, x):
        """Set `x` to the time stamps of the n rows, (n,), in place.

        Also set `before`, which holds the newest usable time stamp of all rows before each row.
        """
        self.x = x
        self.before = np.where(self.usable, x, self.origin - 1)
        self.before[1:] = np.maximum.accumulate(self.before)[:-1]
        self.before[0] = self.origin - 1

    def _make_even(self):
        """Make the time stamps even, or spread them within packets, if the log needs it; in place.

        They are made even if the sensor samples evenly but a host stamps its samples unevenly.
        Otherwise they are spread if rows come in packets, that is, if several rows share a time
        stamp. In all other cases they stay.
        """
        whole = self.usable & self.inside
        for name in CHANNELS:
            whole &= np.isfinite(self.values[name])
        new = whole & (self.x > self.before)
        if not new.any():
            return
        repeats = np.count_nonzero(whole & (self.x == self.before))
        # whole columns need no copy
        new = slice(None) if new.all() else new
        number, t = self.number[new], self.times(new)
        packets, even = packet_step(number, t, repeats), None
        if not self.clock.resets:
            turn_rate = [self.values[name][new] for name in ANGULAR_RATE]
            summed = bool(increments.factors(self.units))
            even = even_samples(number, t, turn_rate, packets, self.declared.rate, summed)
        if packets and not even:
            step, is_last = packets
            self._put_on(spread(self.x, self.usable & ~self.same, step / self.scale, is_last))
        if packets or even:
            self.even, self.packets, self.logged, self.repeats = even, packets, t, repeats


def _window(time_range, first):
    """Return the start and the end of a time range in seconds from the log's first stamp, a list.

    `time_range` has a start and an end. Each is a number of seconds, a date, or None if the side is
    open; then the result is infinite there. `first` is the first stamp, ns since 1970, or None if
    it is not a date. Raises an ImuloopError for a date in a log without dates, and if the start is
    not before the end.
    """
    limits = [-np.inf, np.inf]
    for i, value in enumerate(time_range):
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
