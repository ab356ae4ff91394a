"""A log's clock: time stamps that roll over, start again or stray are mended.

Steps in which samples are missing are in `core.gaps`.
"""

from dataclasses import dataclass

import numpy as np

from imuloop.core.gaps import gap_limit
from imuloop.ingest.stamps import MOST

# number of rows before and after a fall of the stamps that tell its cause
AHEAD = 100
# largest number of steps from a counter's last stamp to the first after its roll-over; stamps that
# fall by fewer steps are late; after a clock that starts again, t goes on this number of steps
# later
FEW_STEPS = 10
# share of the steps after a clock starts again that go forward
_FORWARD = 0.9
# a clock that falls more often is left as it is, so that no log takes hours
MOST_FALLS = 10_000
# parts of a second without leading zeros make stamps fall from 0.9 s to 0.1 s, as 100 ms are
# written; no accident is so frequent, and such a share of all falls
_LEAST_UNPADDED, _UNPADDED_SHARE = 5, 0.45
# spans of counters, ns: 2^k of ns, us, ms and s, 10^k, a minute, an hour, a day and a week
SPANS = sorted(
    {2**k * tick for k in range(8, 61) for tick in (1, 10**3, 10**6, 10**9)}
    | {10**k for k in range(5, 19)}
    | {s * 10**9 for s in (60, 3600, 86400, 604800)}
)


def span(last, first, step, tick=1):
    """Return the span of a counter that rolls over from `last` to `first`; None if none fits.

    The spans are `SPANS`, in units of `tick` ns. The counter starts at 0, or at minus half of its
    span. `step` is the usual step of the stamps. Whole stamps give a whole span.
    """
    whole, fits = isinstance(last, int) and isinstance(first, int), []
    for ns in SPANS:
        width = (ns + tick // 2) // tick if whole else ns / tick
        away, low = width - (last - first), 0 if first >= 0 else -width / 2
        near = 0 < away <= FEW_STEPS * step and width >= AHEAD * step
        if near and low <= first and last <= low + width:
            fits.append((abs(away - step), width))
    return min(fits, default=(None, None))[1]


@dataclass
class Clock:
    """What was mended in the stamps of a log.

    At each of `rollovers` the span of the counter, `span_s`, is added. After each of `resets` the
    stamps go on `FEW_STEPS` usual steps after the last. `strays` are stamps ahead of at least two
    rows that follow in their place; they are taken as missing. `unpadded` is how often the stamps
    fall because parts of a second lack their leading zeros.
    """

    rollovers: int = 0
    span_s: float | None = None
    resets: int = 0
    strays: int = 0
    unpadded: int = 0

    # stamps of a broken log can be of any size
    @np.errstate(over="ignore", invalid="ignore")
    def mended(self, x, readable, tick=None):
        """Return stamps of a clock that never falls, (n,), and a mask of those that can be used.

        Single late rows stay as they are: rows that follow leap back to where the stamps were.
        `x` and `readable`, (n,), are stamps as logged, and which of them are readable; `tick` is
        nanoseconds per unit, None for dates, which do not roll over.
        """
        values = x if readable.all() else x[readable]
        falls = np.flatnonzero(values[1:] < values[:-1])
        if not len(falls):
            return x, readable
        if tick is None or (tick == 10**9 and values.dtype.kind == "f"):
            self.unpadded = _count_unpadded(values[falls], values[falls + 1], 1 if tick else 10**9)
        rows, added, usable = np.flatnonzero(readable), np.zeros_like(x), readable.copy()
        # the newest stamp since row `begin`, where the clock was mended last, and the sum of shifts
        newest, begin, shift = -np.inf, 0, 0
        # the row before a fall may stray, the one after it may be late or of a clock that fell
        for i in np.union1d(falls, falls + 1)[:MOST_FALLS]:
            if begin < i:
                newest = max(newest, values[begin:i].max().item())
            begin, ahead = i, values[i : i + AHEAD]
            back = (newest < ahead[1:]) & (ahead[1:] <= ahead[0])
            if np.count_nonzero(back) >= 2 and back[0] and ahead[1] < ahead[0]:
                # the rows after this one go on as if it were not there
                usable[rows[i]], begin = False, i + 1
                self.strays += 1
            elif newest > ahead[0]:
                more = self._fall(values[max(0, i - AHEAD) : i], newest, ahead, tick)
                # sums of stamps and shifts fit 64 bits
                if more and shift + more <= MOST // 2:
                    shift, added[rows[i]], newest = shift + more, more, -np.inf
        return x + np.cumsum(added), usable

    def span_in(self, tick):
        """Return the span of the counter in units of `tick` ns; None where it did not roll over."""
        return self.span_s and round(self.span_s * 1e9) // tick

    def _fall(self, before, last, ahead, tick):
        """Return the shift of the stamps from a fall on, in their unit; 0 for a late row."""
        steps = np.concatenate((np.diff(before), np.diff(ahead)))
        if not (steps > 0).any():
            return 0
        first, step = ahead[0].item(), np.median(steps[steps > 0]).item()
        back = (ahead > last).argmax()
        leaps = back and ahead[back] - ahead[back - 1] > gap_limit(step)
        if last - first < FEW_STEPS * step or leaps:
            return 0
        if width := tick and span(last, first, step, tick):
            self.rollovers += 1
            self.span_s = width * tick * 1e-9
            return width
        if len(ahead) < AHEAD or np.mean(np.diff(ahead) >= 0) < _FORWARD:
            return 0
        self.resets += 1
        gap = FEW_STEPS * step
        return last - first + (max(round(gap), 1) if isinstance(first, int) else gap)

    def fault(self):
        """Return the cause of falling stamps that cannot be mended, a line, or a false value."""
        return self.unpadded and (
            f"the stamps fall within the same second, {_times(self.unpadded)}, each time to 0.1 s: "
            "parts of a second were joined without leading zeros (3 ms as .3); write all of their "
            "digits, or a column of their own, columns.time: [sec, nanosec]"
        )

    def warnings(self):
        """Return a line for each thing that was mended; none if the stamps cannot be mended."""
        rolls = f"the stamps roll over after {self.span_s or 0:.10g} s, {_times(self.rollovers)}"
        resets = f"the stamps start again {_times(self.resets)}: t goes on after {FEW_STEPS} usual"
        strays = f"{self.strays} stamps lie ahead of rows that follow in their place"
        lines = [f"{rolls}: the span is added"] * bool(self.rollovers)
        lines += [f"{resets} steps, a gap whose length is not known"] * bool(self.resets)
        lines += [f"{strays}: taken as missing"] * bool(self.strays)
        return [] if self.unpadded else lines


def _count_unpadded(last, first, second):
    """Return the number of falls within a `second` by missing leading zeros, 0 if accidental."""
    same = (last // second == first // second) & (last - first > 0.1 * second)
    count = np.count_nonzero(same & (first % second < 0.2 * second))
    return count if count >= max(_LEAST_UNPADDED, _UNPADDED_SHARE * len(last)) else 0


def _times(count):
    return "once" if count == 1 else f"{count} times"


def figures(counts, measured, rate=None):
    """Return the entry ``clock`` of quality.json, from the `Counts` and quality figures of a log.

    `rate` is the declared one, Hz, of a log with time stamps.
    """
    hertz, jitter = measured["rate_hz"], measured["jitter"]["std_s"]
    return {
        **{key: getattr(counts.clock, key) for key in ("rollovers", "span_s", "resets", "strays")},
        "rebuilt": counts.logged is not None,
        "logged": counts.logged,
        # of a step
        "jitter_ppm": None if hertz is None else jitter * hertz * 1e6,
        # of the stamps' rate from the declared one
        "drift_ppm": None if None in (hertz, rate) else (hertz / rate - 1) * 1e6,
        "pps": counts.pps,
    }
