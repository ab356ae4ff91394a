"""The clock of a log: time stamps that roll over, start again or stray are mended.

Missing samples are the subject of `core.gaps`.
"""

from dataclasses import dataclass

import numpy as np

from imuloop.core.errors import plural
from imuloop.core.gaps import gap_limit
from imuloop.ingest.stamps import MOST

# number of rows before and after a fall of the stamps that tell its cause
AHEAD = 100
# number of usual steps: a counter advances by at most this number as it rolls over; stamps that
# fall by fewer steps are late; and when a clock starts again, t goes on after this number of steps.
# Fewer falls may be accidents
FEW_STEPS = 10
# most rows next to falls that are looked at, so that no log takes hours
MOST_FALLS = 10_000
# without leading zeros, the stamp falls from 0.99 s, written for 99 ms, to 0.1 s, for 100 ms; least
# share of such falls among all falls, which accidents do not reach
_UNPADDED_SHARE = 0.45
# spans of counters, ns: 2^k ns, us, ms and s, 10^k ns, a minute, an hour, a day and a week
SPANS = sorted(
    {2**k * tick for k in range(8, 61) for tick in (1, 10**3, 10**6, 10**9)}
    | {10**k for k in range(5, 19)}
    | {s * 10**9 for s in (60, 3600, 86400, 604800)}
)


def span(last, first, step, tick=1):
    """Return the span of a counter that rolls over from the stamp `last` to the stamp `first`.

    A counter rolls over when it starts again at its least value after its span. The stamps, their
    usual step `step` and the result are in units of `tick` ns. The span, which has to be added to
    the stamps from `first` on, is one of `SPANS`. It is a whole number if the stamps are whole. The
    least value of the counter is assumed to be 0 or minus half of its span. The result is None if
    no span fits.
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
    """The faults of the time stamps of a log that were mended, and how often each occurred.

    `rollovers` is the number of times that the counter starts again after its span `span_s`, s,
    which is added at each. `resets` is the number of times that the clock starts again for another
    reason; the stamps then go on `FEW_STEPS` usual steps after the last one. `strays` is the number
    of stamps that are later than at least two of the next rows, while these go on from the rows
    before; they count as missing. `unpadded` is the number of times that the stamps fall because
    parts of a second lack their leading zeros; such stamps are not mended.
    """

    rollovers: int = 0
    span_s: float | None = None
    resets: int = 0
    strays: int = 0
    unpadded: int = 0

    # stamps of a broken log can be of any size
    @np.errstate(over="ignore", invalid="ignore")
    def mended(self, x, readable, tick=None):
        """Return the mended time stamps, (n,), and a mask of the usable ones, (n,) of bool.

        `x` are the stamps as logged, (n,), and `readable` is the mask of the readable ones, (n,).
        `tick` is the number of nanoseconds in the unit of the stamps; it is None for dates, which
        do not roll over. The counts of the Clock are increased. A late row is not mended: the rows
        after it go on from the rows before.
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
            back = (newest < ahead[1:]) & (ahead[1:] < ahead[0])
            if back[:1].any() and np.count_nonzero(back) >= 2:
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
        """Return the span of the counter in units of `tick` ns; None if it did not roll over.

        A counter rolls over when it starts again at its least value, after its span.
        """
        return self.span_s and round(self.span_s * 1e9) // tick

    def _fall(self, before, last, ahead, tick):
        """Return the shift that mends all stamps from a fall on, in their unit; 0 to leave them.

        A fall is a stamp that is smaller than the one before. The shift is added to this stamp and
        all later ones. It is 0 if only some rows are late, which were written after newer ones, or
        if the rows have no order at all. `before` and `ahead` are the stamps of up to `AHEAD` rows
        before the fall, and from the fall on. `last` is the newest stamp before the fall. `tick` is
        the number of ns in a unit, None for dates.
        """
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
        if len(ahead) < AHEAD or np.quantile(np.diff(ahead), 0.1) < 0:
            # more than one step in ten goes backward: the order is lost
            return 0
        self.resets += 1
        gap = FEW_STEPS * step
        return last - first + (max(round(gap), 1) if isinstance(first, int) else gap)

    def fault(self):
        """Return a line on why falling stamps cannot be mended, or a false value.

        They cannot if parts of a second were written without their leading zeros.
        """
        return self.unpadded and (
            f"the stamps fall {plural(self.unpadded, 'time')} within a second, each time to 0.1 s: "
            "parts of a second were joined without leading zeros (3 ms as .3); write all of their "
            "digits, or a column of their own, columns.time: [sec, nanosec]"
        )

    def warnings(self):
        """Return the line for the user on mended time stamps, in a list; empty without any."""
        rest = f", from which t goes on after {FEW_STEPS} usual steps, a gap of unknown length"
        faults = (
            (self.rollovers, "roll-over", f" of {self.span_s or 0:.10g} s"),
            (self.resets, "restart", rest),
            (self.strays, "stamp", " ahead of those that follow, taken as missing"),
        )
        words = [plural(count, noun) + more for count, noun, more in faults if count]
        return [f"time stamps mended: {'; '.join(words)}"] if words and not self.unpadded else []


def _count_unpadded(last, first, second):
    """Return the number of stamps that fall because leading zeros are missing.

    A stamp falls if it is smaller than the one before. The result is 0 if only a few stamps fall in
    this way, as they may by accident.

    With a part of a second that lacks its zeros, 0.99 s written for 99 ms is followed by 0.1 s for
    100 ms. `last` and `first` are the stamps before and after each of k falls, (k,). `second` is a
    second in the unit of the stamps.
    """
    same = (last // second == first // second) & (last - first > 0.1 * second)
    count = np.count_nonzero(same & (first % second < 0.2 * second))
    return count if count >= max(FEW_STEPS, _UNPADDED_SHARE * len(last)) else 0


def figures(counts, measured, rate=None):
    """Return the entry ``clock`` of quality.json, a dict: faults of the stamps, jitter and drift.

    `counts` are the `Counts` of the log, and `measured` its other quality figures. `rate` is the
    declared rate, Hz; it is None if no rate is declared or the log has no time stamps.
    """
    hertz, jitter = measured["rate_hz"], measured["jitter"]["std_s"]
    return {
        **{key: getattr(counts.clock, key) for key in ("rollovers", "span_s", "resets", "strays")},
        "rebuilt": counts.logged is not None,
        "logged": counts.logged,
        # jitter as parts per million of a step
        "jitter_ppm": None if hertz is None else jitter * hertz * 1e6,
        # excess of the stamps' rate over the declared rate
        "drift_ppm": None if None in (hertz, rate) else (hertz / rate - 1) * 1e6,
        "pps": counts.pps,
    }
