r"""A local clock becomes GNSS time through marks of one pulse per second (1PPS).

The GNSS time of a sample between two marks is

.. math:: t_2 = t_1 + (C_2 - C_1)\,s + b_t \frac{C_2 - C_1}{C_3 - C_1}, \qquad
          b_t = (t_3 - t_1) - (C_3 - C_1)\,s

The index is 1 at the mark before, 2 at the sample, and 3 at the mark after. C is the local counter,
t is GNSS time, and s is the nominal time of a tick, 1e-6 s for microseconds. The error of the local
clock over the interval, b_t, is spread evenly over it.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from imuloop.core.errors import ImuloopError, RejectedLog
from imuloop.core.stretches import stretches_of
from imuloop.ingest.clocks import Clock
from imuloop.ingest.columns import position
from imuloop.ingest.delimited import text_columns
from imuloop.ingest.raw_log import RawLog
from imuloop.ingest.stamps import stamp_values
from imuloop.ingest.text_layout import find_layout

# largest error of the rate of a local clock, s/s; largest distance of a mark from the line through
# its neighbours, and of its GNSS time from a whole second, s
MOST_OFF = 500e-6
# a mark is compared with the median of this number of marks, itself among them
_NEIGHBOURS = 11
_WEEK = 604_800


@dataclass(frozen=True)
class Timeline:
    """GNSS time as a function of a local counter, known at marks and linear between them.

    A mark is a pulse of 1PPS, whose GNSS time and counter are both logged.
    """

    counters: np.ndarray  # (m,): the counter at each mark, increasing
    seconds: np.ndarray  # (m,): GNSS time since the first mark, s
    start_ns: int | None  # date of the first mark, ns since 1970; None if the marks have no date
    figures: dict  # the entry on marks in quality.json

    def at(self, x):
        """Return the GNSS time of n counters, s from the first mark, (n,).

        `x` are the counters, (n,).
        """
        i = np.clip(np.searchsorted(self.counters, x, side="right") - 1, 0, len(self.counters) - 2)
        # s + b/(C3 - C1) is the slope from mark to mark
        slope = np.diff(self.seconds) / np.diff(self.counters)
        return self.seconds[i] + (x - self.counters[i]) * slope[i]

    def moment(self, seconds):
        """Return a moment as ns since 1970; None if the marks have no date.

        `seconds` is the moment in GNSS time, s from the first mark.
        """
        return None if self.start_ns is None else self.start_ns + round(seconds * 1e9)

    def figures_beside(self, seconds):
        """Return the figures on the marks in quality.json, with the rows outside of them, a dict.

        The numbers of rows ``before`` the first mark and ``after`` the last one are added to the
        figures. `seconds` are the GNSS times of n rows, s from the first mark, (n,).
        """
        outside = {"before": seconds < 0, "after": seconds > self.seconds[-1]}
        return self.figures | {name: int(mask.sum()) for name, mask in outside.items()}


def find_timeline(rows, path=None):
    """Return the Timeline of a log, GNSS time over its local counter, from marks of 1PPS.

    The counter is the mended time stamps of the log's `rows`, a `Rows`. The marks are in the
    columns ``counter`` and ``time`` that the key ``pps`` of the config declares. These are columns
    of the log, or of the text table at `path`, by default its first two columns. Raises an
    ImuloopError if the log cannot have marks, and a RejectedLog if the marks do not fit the log.
    """
    columns = rows.declared.pps
    if not (path or rows.log.names.get("pps")):
        raise ImuloopError("pps: only tables hold columns of marks; name a file in pps.file")
    if not rows.stamped or rows.dates:
        why = "stamps are dates" if rows.dates else "log has no time column"
        raise ImuloopError(f"pps: the {why}, and a local counter is needed")
    if rows.clock.resets:
        raise RejectedLog("1PPS: the local counter starts again, so that its marks are lost")
    usable, stamps = rows.usable, [rows.stamps.get(f"pps.{key}") for key in ("counter", "time")]
    if path:
        layout, usable = find_layout(path, least=2), True
        names = {f"pps.{key}": columns.get(key, i) for i, key in enumerate(("counter", "time"))}
        where = [position(key, at, layout.names, layout.headed) for key, at in names.items()]
        stamps = map(stamp_values, text_columns(path, layout, where, RawLog(), 2))
    (counters, with_counter, _), (times, with_time, dated) = stamps
    usable = usable & with_counter & with_time
    counters, times = counters[usable], times[usable]
    if not len(counters):
        raise RejectedLog(f"1PPS: {path or 'the log'} holds no marks")
    # a log repeats the last mark in each row
    new = np.append(True, (np.diff(counters) != 0) | (np.diff(times) != 0))
    counters = _align(counters[new], rows)
    return _fit_timeline(counters, times[new], dated, rows)


def _align(counters, rows):
    """Return the counters of n marks without roll-overs, (n,), on the mended counter of a log.

    `counters` are the counters as logged, (n,). `rows` are the `Rows` of the log. The roll-overs of
    both are mended in the same way. Marks and log may begin in different spans of the counter, the
    time from one roll-over to the next. So that whole number of spans is added to the counters with
    which their middle is nearest to the middle of the log.
    """
    clock, x = Clock(), rows.x[rows.usable]
    counters, _ = clock.mended(counters, np.ones(len(counters), dtype=bool), rows.tick)
    width = rows.clock.span_in(rows.tick) or clock.span_in(rows.tick)
    # marks and log may have begun in different spans of the counter: they are whole spans apart
    middle = (x.min() + x.max() - counters[0] - counters[-1]).item() / 2
    return counters + round(middle / width) * width if width else counters


# marks of a broken log can be anywhere
@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def _fit_timeline(counters, times, dated, rows):
    """Return the Timeline through the usable ones of n marks: GNSS time over the local counter.

    A mark is rejected if its time is not a whole second, or if it is more than `MOST_OFF` s away
    from the line through its neighbours. The longest run of the remaining marks is used over which
    the rate of the local clock differs from its nominal rate by at most `MOST_OFF`, s per s.
    `counters` are the counters of the marks without roll-overs, (n,). `times` are their GNSS times,
    (n,), ns since 1970 if `dated`, else s. `rows` are the `Rows` of the log. Raises a RejectedLog
    if no two marks fit together, or if marks and log share no time.
    """
    count, seconds = len(counters), times * (1e-9 if dated else 1.0)
    whole = np.abs(seconds - np.rint(seconds)) <= MOST_OFF
    counters, t = counters[whole], np.rint(seconds[whole])
    if not dated:
        # the time of the week starts again after a week
        t = np.unwrap(t, period=_WEEK)
    local = (counters - counters[:1]) * rows.scale
    rate = np.diff(local) / np.diff(t)
    usual = np.median(rate[np.isfinite(rate)]) if np.isfinite(rate).any() else 1.0
    away = local - usual * t
    fits = np.abs(away - median_filter(away, _NEIGHBOURS, mode="mirror")) <= MOST_OFF
    counters, t, local = counters[fits], t[fits], local[fits]
    off = np.diff(local) / np.diff(t) - 1
    sound = stretches_of((np.diff(t) > 0) & (np.abs(off) <= MOST_OFF)).tolist()
    begin, end = max(sound, key=lambda stretch: stretch[1] - stretch[0], default=(0, 0))
    if begin == end:
        raise RejectedLog(f"1PPS: of {count} marks no two fit together; see units.time and pps")
    drift = (local[end] - local[begin]) / (t[end] - t[begin]) - 1
    counters, t, off = counters[begin : end + 1], t[begin : end + 1], off[begin:end] * 1e6
    if counters[0] >= rows.x[rows.usable].max() or counters[-1] <= rows.x[rows.usable].min():
        raise RejectedLog("1PPS: the marks and the log share no time")
    figures = {
        "marks": len(t),
        "rejected": count - len(t),
        "missed": int((np.diff(t) - 1).sum()),
        "longest_step_s": float(np.diff(t).max()),
        "drift_ppm": float(drift * 1e6),
        "drift_range_ppm": [float(off.min()), float(off.max())],
    }
    return Timeline(counters, t - t[0], int(t[0]) * 10**9 if dated else None, figures)


def warnings(figures):
    """Return the line for the user on a log whose time is GNSS time through 1PPS marks, in a list.

    `figures` is the result of `Timeline.figures_beside`; the list is empty if it is None.
    """
    if not figures:
        return []
    line = (
        "t is GNSS time through {marks} 1PPS marks ({missed} missed, {rejected} rejected): the "
        "local clock is {drift_ppm:+.3f} ppm off; {before} rows before the first mark and {after} "
        "after the last go by the rate of the nearest interval"
    )
    return [line.format(**figures)]
