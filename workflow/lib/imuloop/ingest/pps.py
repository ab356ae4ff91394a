r"""A local clock made GNSS time through marks, one pulse per second (1PPS).

Between the marks before and after a sample,

.. math:: t_2 = t_1 + (C_2 - C_1)\,s + b_t \frac{C_2 - C_1}{C_3 - C_1}, \qquad
          b_t = (t_3 - t_1) - (C_3 - C_1)\,s

with the local counter C of a nominal s seconds a tick, 1e-6 for microseconds, and t the GNSS time
of the marks: the local clock's error over the interval is spread evenly over it.
"""

from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from imuloop.core.errors import ImuloopError, RejectedLog
from imuloop.ingest.clocks import Clock
from imuloop.ingest.columns import position
from imuloop.ingest.convert import survey
from imuloop.ingest.delimited import text_batches
from imuloop.ingest.raw_log import RawLog
from imuloop.ingest.stamps import parse_stamps, stamp_values
from imuloop.ingest.text_layout import find_layout

# names of the marks in raw batches
COUNTER, TIME = "pps.counter", "pps.time"
# a local clock that is further off is none; a mark that is, against its neighbours, is no mark
MOST_OFF = 500e-6
# neighbours on each side
_NEIGHBOURS = 5
# GNSS time of a mark is a whole second, but for its rounding, s
_WHOLE = 1e-3
_WEEK = 604_800
_MARK_ROWS = 1 << 16


@dataclass(frozen=True)
class Timeline:
    """GNSS time over a local counter.

    Attributes
    ----------
    counters : ndarray, shape (n,)
        Local counter at each mark, rising.
    seconds : ndarray, shape (n,)
        GNSS time of each mark from the first, s.
    scale : float
        Nominal seconds per tick.
    start_ns : int or None
        Moment of the first mark, ns since 1970, where marks are dates.
    told : dict
        What quality.json says of the marks.
    """

    counters: np.ndarray
    seconds: np.ndarray
    scale: float
    start_ns: int | None
    told: dict

    def at(self, x):
        """Return GNSS time from the first mark, s, at counters of shape (n,)."""
        i = np.clip(np.searchsorted(self.counters, x, side="right") - 1, 0, len(self.counters) - 2)
        since = x - self.counters[i]
        whole = self.counters[i + 1] - self.counters[i]
        bias = (self.seconds[i + 1] - self.seconds[i]) - whole * self.scale
        return self.seconds[i] + since * self.scale + bias * since / whole

    def moment(self, seconds):
        """Return the moment of GNSS time from the first mark, ns since 1970; None without dates."""
        return None if self.start_ns is None else self.start_ns + round(seconds * 1e9)

    def outside(self, seconds):
        """Return how many of some GNSS times lie before the first mark, and after the last."""
        after = seconds > self.seconds[-1]
        return np.array([np.count_nonzero(seconds < 0), np.count_nonzero(after)])


def read_marks(path, columns):
    """Return local counters and GNSS times of a text table of marks, as pyarrow arrays.

    Parameters
    ----------
    path : path-like
        Table; its first two columns if they are not named.
    columns : dict
        Names or numbers of ``counter`` and ``time``.
    """
    layout = find_layout(path, least=2)
    where = [
        position(f"pps.{key}", columns.get(key, i), layout.names, layout.headed)
        for i, key in enumerate(("counter", "time"))
    ]
    log = RawLog(batches=iter(()), temperature=False, found={})
    parts = list(text_batches(path, layout, where, _MARK_ROWS, log))
    if not parts:
        raise RejectedLog(f"{path} holds no marks")
    table = pa.Table.from_batches(parts).combine_chunks()
    return tuple(parse_stamps(table.column(i).combine_chunks()) for i in (0, 1))


class LogMarks:
    """Marks that a log repeats in each row until the next one, gathered part by part."""

    def __init__(self):
        self._last, self._counters, self._times = None, [], []

    def add(self, batch, logged, mended, readable, width):
        """Take further rows.

        Parameters
        ----------
        batch : pyarrow.RecordBatch
            With `COUNTER` and `TIME`.
        logged, mended : ndarray, shape (n,)
            Counter of the rows as logged and without roll-over.
        readable : ndarray of bool, shape (n,)
        width : number or None
            Span of the counter, once it is known.
        """
        counter, fine, _ = stamp_values(batch.column(COUNTER))
        time, known, dated = stamp_values(batch.column(TIME))
        rows = np.flatnonzero(readable & fine & known)
        if not rows.size:
            return
        pairs = np.array([counter[rows], time[rows]])
        last = pairs[:, :1] + 1 if self._last is None else self._last
        new = (np.diff(np.concatenate((last, pairs), axis=1)) != 0).any(axis=0)
        self._last = pairs[:, -1:]
        rows = rows[new]
        since = logged[rows] - counter[rows]
        if width:
            since = (since + width // 2) % width - width // 2
        self._counters.append(mended[rows] - since)
        self._times.append(_seconds(time[rows], dated))

    def marks(self):
        """Return counters and GNSS times, and whether these are dates."""
        if not self._counters:
            raise RejectedLog("1PPS: the log holds no marks")
        times = [time for time, _ in self._times]
        return np.concatenate(self._counters), np.concatenate(times), self._times[0][1]


def _seconds(values, dated):
    """Return GNSS times as whole ns where they are dates, else as s."""
    return (values, True) if dated else (values.astype(float), False)


def find_timeline(log, units, columns, path=None):
    """Return GNSS time over the counter of a log, which is read to its end.

    Parameters
    ----------
    log : RawLog
        The log; its time column is the local counter.
    units : dict
        Unit of ``time``.
    columns : dict
        ``counter`` and ``time`` of the marks, columns of the log, or of the file.
    path : path-like, optional
        Text table of the marks.

    Raises
    ------
    ImuloopError
        If the log has no counter, or not the columns.
    RejectedLog
        If the marks do not fit the log.
    """
    if path is None:
        check(columns, log)
    marks = LogMarks() if path is None else read_marks(path, columns)
    width, span, tick = survey(log, units, marks if path is None else None)
    found = marks.marks() if path is None else file_marks(marks, width, span, tick)
    return timeline(*found, span, tick * 1e-9)


def file_marks(marks, width, span, tick):
    """Return counters in line with those of a log, GNSS times, and whether these are dates.

    Parameters
    ----------
    marks : tuple of pyarrow.Array
        From `read_marks`.
    width : number or None
        Span of the log's counter, if it rolled over.
    span : (number, number)
        Range of the log's counter.
    tick : int
        Nanoseconds per unit of the counter.
    """
    counter, fine, _ = stamp_values(marks[0])
    time, known, dated = stamp_values(marks[1])
    counter, time = counter[fine & known], time[fine & known]
    if width:
        counter = counter + width * np.cumsum(np.diff(counter, prepend=counter[:1]) < -width / 2)
    else:
        clock, every = Clock(), np.ones(len(counter), dtype=bool)
        counter, usable = clock.mended(counter, every, (counter[:0], every[:0]), tick)
        if clock.resets:
            raise RejectedLog("1PPS: the counter of the marks starts again")
        counter, time = counter[usable], time[usable]
        width = clock.span_s and round(clock.span_s * 1e9) // tick
    if width and len(counter):
        # one of the two may have begun before the counter rolled over
        middle = round((sum(span) - counter[0] - counter[-1]) / 2 / width)
        shifts = [(middle + k) * width for k in (0, -1, 1)]
        counter = counter + max(shifts, key=lambda s: _overlap(span, counter[[0, -1]] + s))
    return counter, *_seconds(time, dated)


def _overlap(a, b):
    return min(a[1], b[1]) - max(a[0], b[0])


# marks of a broken log can be anywhere
@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def timeline(counters, times, dated, span, scale):
    """Return GNSS time over the counter, through the marks that can be used.

    Rejected are marks that are no whole second, that are more than `MOST_OFF` of a second away
    from where their neighbours put them, and all but the longest run of marks between which the
    local clock is no further off than `MOST_OFF`.

    Parameters
    ----------
    counters, times : ndarray, shape (n,)
        Counter without roll-over, and GNSS time in s, or in ns where `dated`.
    dated : bool
        Whether times are dates.
    span : (number, number)
        Range of the log's counter.
    scale : float
        Seconds per tick.
    """
    given = len(counters)
    t = (times - times[:1]) * 1e-9 if dated else times - times[:1]
    whole = np.abs(t - np.rint(t)) <= _WHOLE
    if not dated:
        whole &= np.abs(times - np.rint(times)) <= _WHOLE
    counters, times, t = counters[whole], times[whole], np.rint(t[whole])
    if not dated:
        # time of week
        t = t + _WEEK * np.cumsum(np.diff(t, prepend=t[:1]) < -_WEEK / 2)
    local = (counters - counters[:1]) * scale
    rate = np.diff(local) / np.diff(t)
    usual = np.median(rate[np.isfinite(rate)]) if np.isfinite(rate).any() else 1.0
    fits = np.abs(_from_neighbours(local - usual * t)) <= MOST_OFF
    counters, times, t, local = counters[fits], times[fits], t[fits], local[fits]
    off = np.diff(local) / np.diff(t) - 1
    sound = (np.diff(t) > 0) & (np.abs(off) <= MOST_OFF)
    begin, end = _longest_run(sound)
    if end - begin < 1:
        raise RejectedLog(f"1PPS: of {given} marks no two fit together; see units.time and pps")
    counters, t = counters[begin : end + 1], t[begin : end + 1]
    if _overlap(span, (counters[0], counters[-1])) <= 0:
        raise RejectedLog("1PPS: the marks and the log share no time")
    steps, off = np.diff(t), off[begin:end] * 1e6
    told = {
        "marks": len(t),
        "rejected": given - len(t),
        "missed": int((steps - 1).sum()),
        "longest_step_s": float(steps.max()),
        "drift_ppm": float(((counters[-1] - counters[0]) * scale / (t[-1] - t[0]) - 1) * 1e6),
        "drift_range_ppm": [float(off.min()), float(off.max())],
    }
    start = int(times[begin]) if dated else None
    return Timeline(counters, t - t[0], scale, start, told)


def _from_neighbours(residuals):
    """Return how far each value is from the median of those around it."""
    sides = np.pad(residuals, _NEIGHBOURS, mode="reflect") if len(residuals) > _NEIGHBOURS else None
    if sides is None:
        return residuals - np.median(residuals) if len(residuals) else residuals
    windows = np.lib.stride_tricks.sliding_window_view(sides, 2 * _NEIGHBOURS + 1)
    return residuals - np.median(windows, axis=1)


def _longest_run(sound):
    """Return begin and end of the longest run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], sound, [False])).astype(int)))
    runs = edges.reshape(-1, 2)
    return runs[np.argmax(runs[:, 1] - runs[:, 0])] if len(runs) else (0, 0)


def warnings(told):
    """Return what was done by marks, a line each; `told` is None where there were none."""
    if not told:
        return []
    line = (
        f"t is GNSS time through {told['marks']} 1PPS marks: the local clock runs "
        f"{abs(told['drift_ppm']):.3f} ppm {'slow' if told['drift_ppm'] < 0 else 'fast'}"
    )
    if told["missed"]:
        line += f"; {told['missed']} marks missed, the longest way {told['longest_step_s']:g} s"
    if told["rejected"]:
        line += f"; {told['rejected']} marks rejected"
    if told["before"] or told["after"]:
        line += (
            f"; {told['before']} rows before the first mark and {told['after']} after the last go "
            "by the rate of the nearest interval"
        )
    return [line]


def check(pps, log):
    """Raise where columns of marks are declared that a log does not hold."""
    if pps and not log.found.get("pps"):
        raise ImuloopError("pps: only tables hold columns of marks; name a file in pps.file")
