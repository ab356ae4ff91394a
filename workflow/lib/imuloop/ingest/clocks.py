"""A log's clock: stamps that roll over, start again, stray, scatter or come in bursts."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from imuloop.core.samples import ANGULAR_RATE, GAP_STEPS, TIME, Samples
from imuloop.core.stamps import Scatter

# rows after a fall of the stamps that show what it is
AHEAD = 100
# a counter's last stamp and its first after the roll-over lie at most so many steps apart
ROLL_STEPS = 10
# stamps that fall by fewer steps are late, not a clock that starts again
RESET_STEPS = 10
# of the steps after a reset, at least so many go forward
_FORWARD = 0.9
# a clock that falls more often is left as it is
MOST_FALLS = 10_000
# largest stamp that is mended, and largest fall: their sums fit 64 bits
_LARGEST, _LARGEST_FALL = 1 << 61, 1 << 60
# a part of a second without its leading zeros makes stamps fall within a second, from 0.9 and more
# to 0.1, as 100 ms do; seen so often, and in this share of all falls
_LEAST_UNPADDED, _UNPADDED_SHARE = 5, 0.45
# spans of counters, ns: 2^k of ns, us, ms and s, 10^k, a minute, an hour, a day and a week
SPANS = sorted(
    {2**k * tick for k in range(8, 61) for tick in (1, 10**3, 10**6, 10**9)}
    | {10**k for k in range(5, 19)}
    | {s * 10**9 for s in (60, 3600, 86400, 604800)}
)
# figures of the stamps as logged, kept where they are rebuilt
_LOGGED = ("duration_s", "rate_hz", "jitter", "gaps")
# stamps come in bursts where the median step is less than this share of the sensor's step
BURST = 0.5
# no transfer holds samples back longer, s: a longer pause is of the sensor
_LONGEST_PAUSE = 0.5
# stamps scatter where nine in ten of them take this share of a step, or more
_SCATTER = 0.12
# relative difference of the median step from the mean of stamps that scatter, beside what rounding
# makes: more is a loss
_EVEN = 0.05
# part of a grid's width by which steps on it may miss it
_OFF_GRID = 1e-3
# a level of stamps that scatter is known to this share of a step, so that one lost sample shows
_KNOWN, _FEWEST = 0.05, 16
# rounds of least squares, and the percentiles of the lateness beyond which it is clipped
_ROUNDS, _USUAL = 3, (5, 95)
# rows that share a stamp are a packet where half of such are as far from the next stamp, or the one
# before, as their number of steps, but for this part of one; fewer repeats are dropped
_PACKET, _LEAST_REPEATS = 0.5, 10
# points of a line, at most twice so many, and parts of a log whose stamps must lie on one
POINTS, _PARTS = 1 << 17, 20
# a line whose rate differs more from the declared one is not the sensor's
_RATE_SHARE = 0.02
# stretches between bursts that are shorter on average hold no rest, s; of so many nothing is left,
# and what follows takes minutes to find that out
_LEAST_STRETCH, MOST_BURSTS = 1.0, 1000


def with_lookahead(parts, rows=AHEAD):
    """Give each part with the stamps of at least the next `rows` rows, fewer at the end.

    Parts are tuples of stamps, which of them are readable, and anything else; what follows is
    (stamps, readable).
    """
    held = deque()
    for part in parts:
        held.append(part)
        while sum(len(x) for x, *_ in held) - len(held[0][0]) >= rows:
            yield held.popleft(), _joined(held, rows)
    while held:
        yield held.popleft(), _joined(held, rows)


def _joined(parts, rows):
    if not parts:
        return np.empty(0), np.empty(0, dtype=bool)
    return tuple(np.concatenate([part[i][:rows] for part in parts])[:rows] for i in (0, 1))


def span(last, first, step, tick=1):
    """Return the span of a counter that rolls over from `last` to `first`; None if none fits.

    The spans are `SPANS`, in units of `tick` ns; the counter starts at 0, or at minus half of its
    span; `step` is the usual step of the stamps. Whole stamps give a whole span.
    """
    whole, fits = isinstance(last, int) and isinstance(first, int), []
    for ns in SPANS:
        width = (ns + tick // 2) // tick if whole else ns / tick
        away, low = width - (last - first), 0 if first >= 0 else -width / 2
        near = 0 < away <= ROLL_STEPS * step and width >= AHEAD * step
        if near and low <= first and last <= low + width:
            fits.append((abs(away - step), width))
    return min(fits, default=(None, None))[1]


@dataclass
class Clock:
    """What is known of a clock after some rows, and what was mended in them.

    At each of `rollovers` the span of the counter, `span_s`, is added; after each of `resets` the
    stamps go on `RESET_STEPS` usual steps after the last; `strays` are stamps ahead of at least two
    rows that follow in their place, taken as missing.
    """

    rollovers: int = 0
    span_s: float | None = None
    resets: int = 0
    strays: int = 0
    _unpadded: int = 0
    _shift: float = 0
    _newest: float | None = None
    _recent: np.ndarray | None = None
    _last: float | None = None
    _falls: int = 0

    def mended(self, x, readable, after=None, tick=None):
        """Return stamps as of a clock that never falls, and which of them can be used.

        Single late rows stay as they are: rows that follow leap back to where the stamps were.
        `x` and `readable` are stamps as logged, of the rows after those of the last call, and which
        of them are readable; `after` the same of the next `AHEAD` rows, fewer only at the end of
        the log; `tick` nanoseconds per unit, None for dates, which do not roll over.
        """
        after = after or (x[:0], readable[:0])
        own = np.flatnonzero(readable)
        if not own.size:
            return x, readable
        values = x[own]
        following = after[0][after[1]][:1]
        around = np.concatenate(([values[0] if self._last is None else self._last], values))
        falls = np.append(around[1:] < around[:-1], following < values[-1])
        self._last = values[-1].item()
        if not falls.any():
            self._extend(values)
            return x + self._shift if self._shift else x, readable
        if tick is None or (tick == 10**9 and values.dtype.kind == "f"):
            second = 1 if tick else 10**9
            last, first = around[:-1][falls[: own.size]], values[falls[: own.size]]
            fell = (last // second == first // second) & (last - first > 0.1 * second)
            self._unpadded += np.count_nonzero(fell & (first % second < 0.2 * second))

        known, valid = x, readable
        if len(after[0]):
            known, valid = np.concatenate((x, after[0])), np.concatenate((readable, after[1]))
        readable, mended, begin = readable.copy(), x + self._shift, 0
        # the row after a fall, and the one before it
        for i in np.flatnonzero(falls[: own.size] | np.append(falls[1:], False)[: own.size]):
            if self._falls == MOST_FALLS:
                break
            self._falls += 1
            self._extend(values[begin:i])
            begin, row = i, own[i]
            window = slice(row, row + AHEAD)
            stamps = known[window][valid[window]]
            if self._strays(stamps):
                readable[row] = False
                self.strays += 1
                begin = i + 1
            elif self._newest is not None and values[i] < self._newest:
                shift = self._judged(stamps, len(known[window]) == AHEAD, tick)
                if shift:
                    self._shift += shift
                    self._newest = None
                    mended[row:] = x[row:] + self._shift
        self._extend(values[begin:])
        return mended, readable

    def span_in(self, tick):
        """Return the span of the counter in units of `tick` ns; None where it did not roll over."""
        return self.span_s and round(self.span_s * 1e9) // tick

    def _extend(self, values):
        """Take note of stamps as logged."""
        if values.size:
            newest = values.max().item()
            self._newest = newest if self._newest is None else max(self._newest, newest)
            recent = values[:0] if self._recent is None else self._recent
            self._recent = np.concatenate((recent, values[-AHEAD:]))[-AHEAD:]

    def _strays(self, stamps):
        """Tell whether the rows after the first go on as if it were not there."""
        low = -np.inf if self._newest is None else self._newest
        first, rest = stamps[0], stamps[1:]
        if not (rest.size and low < rest[0] < first):
            return False
        return np.count_nonzero((rest > low) & (rest <= first)) >= 2

    # stamps of a broken log can be of any size
    @np.errstate(over="ignore", invalid="ignore")
    def _judged(self, stamps, whole_window, tick):
        """Return what is to be added from a fall of the stamps on; 0 for a late row."""
        first, last = stamps[0].item(), self._newest
        steps = np.concatenate((np.diff(self._recent), np.diff(stamps)))
        largest = max(abs(first), abs(last), abs(self._shift))
        if not (steps > 0).any() or largest > _LARGEST or last - first > _LARGEST_FALL:
            return 0
        step = np.median(steps[steps > 0]).item()
        returned = np.flatnonzero(stamps > last)
        leaps = returned.size and stamps[returned[0]] - stamps[returned[0] - 1] > GAP_STEPS * step
        if last - first < RESET_STEPS * step or leaps:
            return 0
        if width := tick and span(last, first, step, tick):
            self.rollovers += 1
            self.span_s = width * tick * 1e-9
            return width
        forward = np.count_nonzero(np.diff(stamps) >= 0)
        if not whole_window or len(stamps) < AHEAD / 2 or forward < _FORWARD * (len(stamps) - 1):
            return 0
        self.resets += 1
        gap = RESET_STEPS * step
        return last - first + (max(round(gap), 1) if isinstance(first, int) else gap)

    def fault(self):
        """Return what makes the stamps fall where nothing mends them, or None."""
        # a row before a fall and one after are looked at for each
        if self._unpadded < max(_LEAST_UNPADDED, _UNPADDED_SHARE * self._falls / 2):
            return None
        return (
            f"the stamps fall within the same second, {_times(self._unpadded)}, each time to 0.1 "
            "s: parts of a second were joined without leading zeros (3 ms as .3); write all of "
            "their digits, or a column of their own, columns.time: [sec, nanosec], or take the "
            "rows as even: columns.time: null and rate in Hz"
        )

    def warnings(self):
        """Return what was mended, a line each; nothing of stamps that are no time."""
        found = (
            (
                self.rollovers,
                f"the stamps roll over after {self.span_s or 0:.10g} s, {_times(self.rollovers)}: "
                "the span is added",
            ),
            (
                self.resets,
                f"the stamps start again {_times(self.resets)}: t goes on after {RESET_STEPS} "
                "usual steps, a gap whose length is not known",
            ),
            (
                self.strays,
                f"{self.strays} stamps lie ahead of rows that follow in their place: "
                "taken as missing",
            ),
        )
        return [] if self.fault() else [line for count, line in found if count]


def _times(count):
    return "once" if count == 1 else f"{count} times"


def figures(clock, measured, rate=None, logged=None, pps=None):
    """Return what quality.json says of a log's clock.

    `measured` are the figures of the samples, `logged` those as stamped, where the stamps were
    rebuilt, `pps` those of 1PPS marks; `rate` is the declared one, Hz, of a log with stamps.
    """
    hertz, jitter = measured["rate_hz"], measured["jitter"]["std_s"]
    return {
        "rollovers": clock.rollovers,
        "span_s": clock.span_s,
        "resets": clock.resets,
        "strays": clock.strays,
        "rebuilt": logged is not None,
        "logged": logged and {key: logged[key] for key in _LOGGED},
        # of a step
        "jitter_ppm": None if hertz is None else jitter * hertz * 1e6,
        # of the stamps' rate from the declared one
        "drift_ppm": None if hertz is None or not rate else (hertz / rate - 1) * 1e6,
        "pps": pps,
    }


def _follows_stamps(path, step, grid):
    """Tell whether samples (a file) were taken when they are stamped, not evenly every `step` s."""
    scatter = Scatter(step, grid)
    for _, (t, *w) in Samples(path).pieces((TIME, *ANGULAR_RATE)):
        scatter.add(t, w)
    return scatter.followed


def line_step(path, counts, measured, rate=None, increments=False, packets=None):
    """Return the seconds from row to row of stamps that are to be rebuilt; None to keep them.

    A host stamps what it receives, and a transfer brings several samples: the steps are short
    within a transfer and long between, or rows of a packet share a stamp. The sensor's own step is
    the slope of time over row number. It is taken only where the medians of time about the line, of
    `_PARTS` parts of the log, lie within the scatter of one part: else rows are lost, or the sensor
    pauses. No line goes on over a reset.

    Stamps that come singly, but scatter by `_SCATTER` or more, are rebuilt where no sample is
    lost: the medians of parts so long that one is known to `_KNOWN` of a step all lie within half
    a step, and the median step is the mean one but for what the grid of the stamps rounds. They
    stay where rows hold `increments`, whose intervals may differ, and where the angular rate goes
    with them.

    `path` are the samples as stamped, `measured` their figures, `rate` is the declared one, Hz,
    `packets` as of `packet_step`.
    """
    step = _line_step(counts, measured, rate, increments, packets)
    kept = step and not packets and _follows_stamps(path, step, _grid(counts.points.rows()[:, 1]))
    return None if kept else step


# times of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def _line_step(counts, measured, rate, increments, packets):
    points = counts.points.rows()
    if counts.clock.resets or len(points) < 10 * _PARTS:
        return None
    step, away = _line(*points.T)
    median, _ = _steps(measured)
    # not of the mean step, which a single pause can make long
    bursts = median < BURST * step
    parts = np.array_split(away, _PARTS)
    scatter = np.median([np.subtract(*np.percentile(part, [95, 5])) for part in parts])
    limit = scatter
    if packets:
        limit = max(scatter, step / 2)
    elif not bursts:
        # the error of a median of n normal values is 1.25 of their deviation over the root of n
        needed = (1.25 * scatter / 3.29 / (_KNOWN * step)) ** 2
        away_from_mean = abs(median - step) - _grid(points[:, 1])
        even = scatter >= _SCATTER * step and away_from_mean <= _EVEN * step
        if increments or not even or not needed < len(away):
            return None
        parts = np.array_split(away, int(len(away) / max(needed, _FEWEST)))
        limit = step / 2
    on_line = np.ptp([np.median(part) for part in parts]) <= limit and scatter <= _LONGEST_PAUSE
    if not on_line or (rate and abs(step * rate - 1) > _RATE_SHARE):
        return None
    return step


def _grid(t):
    """Return what the steps of some rows' times are whole multiples of, s, 0 of nothing."""
    steps = np.unique(np.round(np.diff(t), 9))
    least = np.diff(steps, prepend=0.0).min()
    if not least > 0:
        return 0.0
    whole = np.abs(steps / least - np.round(steps / least)) < _OFF_GRID
    return least if whole.all() else 0.0


def _line(rows, t):
    """Return the slope of time over row number, and how far each time is from that line.

    By Theil's method, the median slope of pairs half a log apart; then, as stamps of transfers lie
    on a few lines and it leads from one to another, by least squares of what it leaves, outliers
    clipped.
    """
    rows, half = rows - rows[0], len(rows) // 2
    step = np.median((t[half:] - t[:-half]) / (rows[half:] - rows[:-half])).item()
    for _ in range(_ROUNDS):
        away = t - step * rows
        step += np.polyfit(rows, np.clip(away, *np.percentile(away, _USUAL)), 1)[0].item()
    return step, t - step * rows


# times of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def packet_step(counts, rate=None):
    """Return the step of rows that share the stamp of their packet, s, and if it is the last one's.

    None where such rows are no packet: then the stamps around them go on as always. The step is by
    the declared `rate`, Hz, else that from stamp to stamp over the number of rows.
    """
    points = counts.points.rows()
    if counts.duplicates < _LEAST_REPEATS or len(points) < 3:
        return None
    rows, t = points.T
    # of each stamp the number of rows, and the steps to the stamp before and to the next
    size, steps, found = np.diff(rows)[1:], np.diff(t), []
    for last, away in ((True, steps[:-1]), (False, steps[1:])):
        step = 1 / rate if rate else np.median(away / size).item()
        several = size > 1
        fits = away[several] / step > size[several] - _PACKET
        found.append((fits.mean() if several.any() else 0.0, last, step))
    share, last, step = max(found)
    return (step, last) if share >= _PACKET else None


def spread(x, readable, after, held, step, last):
    """Return stamps in which rows that share one are a `step` apart, in units of the stamps.

    Theirs is of the `last` row, else of the first; `after` is as of `with_lookahead`, `held` what
    the last call gave, None at first: the last stamp, its rows, and the stamp before. No row comes
    before the stamp before, nor after the next one.
    """
    own, n = np.concatenate((x[readable], after[0][after[1]])), np.count_nonzero(readable)
    if not n:
        return x, held
    starts = np.flatnonzero(np.append(True, own[1:] != own[:-1]))
    stamps, size = own[starts], np.diff(starts, append=len(own))
    run = np.repeat(np.arange(len(starts)), size)[:n]
    number, before = np.arange(n) - starts[run], stamps[0]
    if held and held[0] == stamps[0]:
        # the packet began in the rows of the last call
        number[run == 0] += held[1]
        size[0] += held[1]
        before = held[2]
    elif held:
        before = held[0]
    away = np.diff(stamps, prepend=before) if last else np.diff(stamps, append=stamps[-1])
    width = np.where(away > 0, np.minimum(step, away / size), step)[run]
    moved = x.copy()
    moved[readable] = own[:n] + ((number - (size[run] - 1) * last) * width).astype(x.dtype)
    end = run[-1]
    return moved, (stamps[end], number[-1] + 1, stamps[end - 1] if end else before)


def rebuilt(logged, step, counts, packets=None):
    """Return the line on stamps rebuilt every `step` s, by figures and counts as logged."""
    median, mean = _steps(logged)
    at = step and f"t is rebuilt from the row number at {1 / step:.6g} Hz"
    if packets:
        how = f"of {counts.duplicates} rows are those of others, as of packets of samples"
    elif median < BURST * step:
        how = f"come in bursts (median step {median * 1e3:.3g} ms, mean {mean * 1e3:.3g} ms)"
    else:
        gaps = logged["gaps"]["count"]
        seen = f", though {gaps} of the steps look like gaps" if gaps else ""
        return f"the stamps scatter about a regular clock, no sample is lost{seen}: {at}"
    if not step:
        return f"the stamps {how}: they are put {packets[0]:.6g} s apart within each packet"
    return f"the stamps {how}: {at}; where the sensor itself pauses, declare its rate"


def _steps(measured):
    """Return the median and the mean step, s."""
    median = measured["gaps"]["longer_than_s"] / GAP_STEPS
    return median, measured["duration_s"] / (measured["rows"] - 1)


def broken(measured, rate=None):
    """Return what is wrong with stamps in bursts that no line could rebuild; None if they are none.

    A sensor that pauses by itself pauses for long, goes on for a second or more, or has the
    declared rate in between. Parameters are as of `line_step`.
    """
    gaps = measured["gaps"]
    if measured["rows"] < 2 or not gaps["longer_than_s"]:
        return None
    median, mean = _steps(measured)
    stretch = (measured["duration_s"] - gaps["total_s"]) / (gaps["count"] + 1)
    itself = (rate and abs(median * rate - 1) < _RATE_SHARE) or stretch >= _LEAST_STRETCH
    pause = gaps["total_s"] / max(gaps["count"], 1)
    if itself or median >= BURST * mean or pause > _LONGEST_PAUSE:
        return None
    return (
        f"the stamps come in bursts (median step {median * 1e3:.3g} ms, mean {mean * 1e3:.3g} ms) "
        f"with {gaps['count']} gaps between, and lie on no line: rows are lost, or held back for "
        "long. If the sensor itself samples evenly, take the row's number for the time: columns: "
        f"{{time: null}} and its rate, about rate: {1 / mean:.4g}"
    )
