"""The one clock of a log, found by its time stamps alone: when each of its rows was sampled."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import ANGULAR_RATE, CHANNELS
from imuloop.ingest import increments, pps
from imuloop.ingest.clocks import Clock
from imuloop.ingest.even_stamps import Even, even_samples, packet_step, spread
from imuloop.ingest.raw_log import Rows
from imuloop.ingest.stamps import NANOSECONDS, absolute_nanoseconds, check_unit, iso_nanoseconds


@dataclass(frozen=True)
class Timing:
    """When the rows of a log were sampled; arrays are (n,).

    Attributes
    ----------
    rows : Rows
        Rows of the log.
    x, usable : array
        Time stamps as mended, of `scale` s each, and which of them can be used.
    clock : Clock
        What was mended.
    unit : str
        Unit of the time stamps.
    declared : Declared
        What the config says.
    timeline : Timeline or None
        GNSS time over the counter, of which `x` are then s.
    even, packets : Even and tuple or None
        How time stamps were rebuilt, as of `even_stamps`.
    logged : array or None
        Times as stamped, s, where they were rebuilt.
    repeats : int
        Number of rows with the time stamp of another one.
    usual : float or None
        Usual step of the time stamps, s, by which increments are divided.
    """

    rows: Rows
    x: np.ndarray
    usable: np.ndarray
    scale: float
    clock: Clock
    unit: str
    declared: object
    timeline: pps.Timeline | None = None
    even: Even | None = None
    packets: tuple | None = None
    logged: np.ndarray | None = None
    repeats: int = 0
    usual: float | None = None

    @cached_property
    def number(self):
        """Number of the sample of each row; a row that is written twice is one."""
        return np.arange(len(self.x)) - self.rows.same.cumsum()

    @cached_property
    def origin(self):
        """The first time stamp."""
        return self.x[self.usable.argmax()].item()

    @cached_property
    def before(self):
        """Newest time stamp before each row, one before `origin` where there is none."""
        seen = np.maximum.accumulate(np.where(self.usable, self.x, self.origin - 1))
        return np.concatenate(([self.origin - 1], seen[:-1])).astype(seen.dtype)

    @cached_property
    def inside(self):
        """Rows within the time range that do not repeat the one before."""
        # a row without a time stamp lies where the log has got to
        elapsed = (np.where(self.usable, self.x, self.before) - self.origin) * self.scale
        start, end = _window(self.declared.time_range, self.moment(self.origin))
        return (elapsed >= start) & (elapsed < end) & ~self.rows.same

    def times(self, keep):
        """Return the time of some rows from the first of them on, s, as stamped."""
        x = self.x[keep]
        return (x - x[:1].sum()) * self.scale

    def moment(self, stamp):
        """Return a time stamp as ns since 1970, None where it is no date."""
        if self.timeline:
            return self.timeline.moment(stamp)
        stamped = self.rows.stamped
        return absolute_nanoseconds(stamp, self.unit, self.rows.dates) if stamped else None

    @property
    def time_unit(self):
        """Unit of the time stamps, in words."""
        if not self.rows.stamped:
            return f"1/({self.declared.rate:g} Hz)"
        if self.timeline:
            return f"{self.unit}, by 1PPS"
        return "ISO 8601" if self.rows.dates else self.unit


# values and stamps of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def find_timing(rows, log, units, declared, marks_file=None):
    """Return the `Timing` of the rows of a log.

    Time stamps that roll over, start again or stray are mended, a counter is made GNSS time by
    1PPS marks, and the time stamps of a sensor that samples evenly are made even. Of the values,
    only missing ones and the angular rate, a witness of when it was sampled, are looked at.
    `declared` is what the config says; `marks_file` a file of marks.
    """
    x, usable, clock = rows.x, rows.readable, Clock()
    tick = None if rows.dates else NANOSECONDS.get(units["time"])
    if rows.stamped:
        x, usable = clock.mended(x, usable, tick)
    timing = Timing(rows, x, usable, rows.scale, clock, units["time"], declared)
    if declared.pps or marks_file:
        timeline = pps.find_timeline(timing, log, tick, declared.pps, marks_file)
        x = np.where(usable, timeline.at(x), 0.0)
        timing = replace(timing, x=x, scale=1.0, timeline=timeline)
    elif rows.stamped and not rows.dates:
        check_unit(timing.origin, units["time"])
    whole = usable & np.all([np.isfinite(rows.values[name]) for name in CHANNELS], axis=0)
    by_stamps = increments.by_stamps(log, units)

    def in_order(timing):
        """Return the rows that go forward; the interval of a first increment is not known."""
        known = (timing.before >= timing.origin) | (not by_stamps)
        return whole & timing.inside & (timing.x > timing.before) & known

    new = in_order(timing)
    if rows.stamped and not timing.timeline and new.any():
        at, t, rate = timing.number[new], timing.times(new), declared.rate
        repeats = np.count_nonzero(whole & timing.inside & (timing.x == timing.before))
        packets = packet_step(at, t, repeats, rate) or packet_step(at, t, repeats)
        turn_rate = [rows.values[name][new] for name in ANGULAR_RATE]
        how = turn_rate, packets, rate, bool(increments.factors(units))
        even = None if clock.resets else even_samples(at, t, *how)
        if packets and not even:
            x = spread(x, usable & ~rows.same, packets[0] / rows.scale, packets[1])
        if packets or even:
            how = {"even": even, "packets": packets, "logged": t, "repeats": repeats}
            timing = replace(timing, x=x, **how)
    if by_stamps:
        t = timing.times(in_order(timing))
        timing = replace(timing, usual=np.median(np.diff(t)).item() if len(t) > 1 else None)
    return timing


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
