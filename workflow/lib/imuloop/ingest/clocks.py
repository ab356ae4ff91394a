"""A log's clock: stamps that roll over, start again or stray; jumps ahead: `core.segments`."""

from dataclasses import dataclass

import numpy as np

from imuloop.core.gaps import gap_limit

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
    _falls: int = 0

    def mended(self, x, readable, tick=None):
        """Return stamps as of a clock that never falls, and which of them can be used.

        Single late rows stay as they are: rows that follow leap back to where the stamps were.
        `x` and `readable` are stamps as logged, and which of them are readable; `tick` nanoseconds
        per unit, None for dates, which do not roll over.
        """
        own = np.flatnonzero(readable)
        values = x[own]
        falls = np.flatnonzero(np.diff(values) < 0)
        if tick is None or (tick == 10**9 and values.dtype.kind == "f"):
            second = 1 if tick else 10**9
            last, first = values[falls], values[falls + 1]
            fell = (last // second == first // second) & (last - first > 0.1 * second)
            self._unpadded = np.count_nonzero(fell & (first % second < 0.2 * second))

        mended, usable = x.copy(), readable.copy()
        # the newest stamp since the clock was mended, the last stamps, and what is added by now
        newest, recent, shift, begin = -np.inf, values[:0], 0, 0
        # the row before a fall, and the one after it
        judged = np.union1d(falls, falls + 1)[:MOST_FALLS]
        self._falls = len(judged)
        for i in judged:
            if begin < i:
                newest = max(newest, values[begin:i].max().item())
            recent = np.concatenate((recent, values[begin:i][-AHEAD:]))[-AHEAD:]
            begin, row = i, own[i]
            window = slice(row, row + AHEAD)
            stamps = x[window][readable[window]]
            if _strays(stamps, newest):
                usable[row] = False
                self.strays += 1
                begin = i + 1
            elif newest > values[i]:
                whole = len(x[window]) == AHEAD
                if added := self._judged(stamps, newest, recent, shift, whole, tick):
                    shift += added
                    newest = -np.inf
                    mended[row:] = x[row:] + shift
        return mended, usable

    def span_in(self, tick):
        """Return the span of the counter in units of `tick` ns; None where it did not roll over."""
        return self.span_s and round(self.span_s * 1e9) // tick

    # stamps of a broken log can be of any size
    @np.errstate(over="ignore", invalid="ignore")
    def _judged(self, stamps, last, recent, shift, whole_window, tick):
        """Return what is to be added from a fall of the stamps on; 0 for a late row."""
        first = stamps[0].item()
        steps = np.concatenate((np.diff(recent), np.diff(stamps)))
        largest = max(abs(first), abs(last), abs(shift))
        if not (steps > 0).any() or largest > _LARGEST or last - first > _LARGEST_FALL:
            return 0
        step = np.median(steps[steps > 0]).item()
        returned = np.flatnonzero(stamps > last)
        leaps = returned.size and stamps[returned[0]] - stamps[returned[0] - 1] > gap_limit(step)
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


def _strays(stamps, newest):
    """Tell whether the rows after the first go on as if it were not there."""
    first, rest = stamps[0], stamps[1:]
    if not (rest.size and newest < rest[0] < first):
        return False
    return np.count_nonzero((rest > newest) & (rest <= first)) >= 2


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
