"""Stamps that come in bursts, or scatter: the sensor's own step, where a line shows it."""

import numpy as np

from imuloop.core.samples import ANGULAR_RATE, GAP_STEPS, TIME, Samples
from imuloop.core.stamps import Scatter

# stamps come in bursts where the median step is less than this share of the sensor's step
BURST = 0.5
# no transfer holds samples back longer, s: a longer pause is of the sensor
_LONGEST_PAUSE = 0.5
# stamps scatter where nine in ten of them take this share of a step, or more
_SCATTER = 0.12
# relative difference of the median step from the mean of stamps that scatter: more is a loss
_EVEN = 0.05
# a level of stamps that scatter is known to this share of a step, so that one lost sample shows
_KNOWN = 0.05
_FEWEST = 16
# rounds of least squares, and the percentiles of the lateness beyond which it is clipped
_ROUNDS, _USUAL = 3, (5, 95)
# samples came in packets that share a stamp where so large a share of the rows repeats one
_SHARED = 0.01
# points of a line, at most twice so many
POINTS = 1 << 17
# parts of a log whose stamps must lie on one line
_PARTS = 20
# a line whose rate differs more from the declared one is not the sensor's
_RATE_SHARE = 0.02
# stretches between bursts that are shorter on average hold no rest, s; of so many nothing is left,
# and what follows takes minutes to find that out
_LEAST_STRETCH, MOST_BURSTS = 1.0, 1000


def follows_stamps(path, step):
    """Tell whether samples (a file) were taken when they are stamped, not evenly every `step` s."""
    scatter = Scatter(step)
    for _, (t, *w) in Samples(path).pieces((TIME, *ANGULAR_RATE)):
        scatter.add(t, w)
    return scatter.followed


# times of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def line_step(counts, measured, rate=None, increments=False):
    """Return the seconds from row to row of stamps that come in bursts; None where they do not.

    A host stamps what it receives, and a transfer brings several samples: the steps are short
    within a transfer and long between. The sensor's own step is the slope of time over row
    number: by Theil's method, the median slope of pairs half a log apart, and then by least
    squares of what it leaves, outliers clipped. Stamps of transfers lie on a few lines, and a
    median slope leads from one of them to another. It is taken only where
    the medians of time about the line, of `_PARTS` parts of the log, lie within the scatter of
    one part: else rows are lost, or the sensor pauses. No line goes on over a reset.

    Stamps that come singly, but scatter by `_SCATTER` or more, are rebuilt where no sample is
    lost: the medians of parts so long that one is known to `_KNOWN` of a step all lie within half
    a step; not where rows hold `increments`, whose intervals may differ. Rows that share a stamp
    are samples of a packet, and rebuilt, where all rows lie on one line.

    `measured` are the figures of the samples as stamped, `rate` is the declared one, Hz.
    """
    points = counts.points.rows()
    if counts.clock.resets or len(points) < 10 * _PARTS:
        return None
    rows, t = points.T
    rows = rows - rows[0]
    half = len(rows) // 2
    step = np.median((t[half:] - t[:-half]) / (rows[half:] - rows[:-half])).item()
    for _ in range(_ROUNDS):
        away = t - step * rows
        step += np.polyfit(rows, np.clip(away, *np.percentile(away, _USUAL)), 1)[0].item()
    median = measured["gaps"]["longer_than_s"] / GAP_STEPS
    # not of the mean step, which a single pause can make long
    bursts = median < BURST * step
    if increments and not bursts:
        return None
    away = t - step * rows
    parts = np.array_split(away, _PARTS)
    scatter = np.median([np.subtract(*np.percentile(part, [95, 5])) for part in parts])
    limit = scatter
    if shared(counts):
        limit = max(scatter, step / 2)
    elif not bursts:
        if not scatter >= _SCATTER * step or abs(median / step - 1) > _EVEN:
            return None
        # the error of a median of n normal values is 1.25 of their deviation over the root of n
        needed = (1.25 * scatter / 3.29 / (_KNOWN * step)) ** 2
        if not needed < len(away):
            return None
        parts = np.array_split(away, int(len(away) / max(needed, _FEWEST)))
        limit = step / 2
    on_line = np.ptp([np.median(part) for part in parts]) <= limit and scatter <= _LONGEST_PAUSE
    if not on_line or (rate and abs(step * rate - 1) > _RATE_SHARE):
        return None
    return step


def shared(counts):
    """Tell whether samples share the stamp of their packet."""
    return counts.duplicates > _SHARED * counts.kept


def rebuilt(logged, step, counts):
    """Return the line on stamps rebuilt every `step` s, by figures and counts as logged."""
    median, mean = _steps(logged)
    if shared(counts):
        how = f"of {counts.duplicates} rows are those of others, as of packets of samples"
    elif median < BURST * step:
        how = f"come in bursts (median step {median * 1e3:.3g} ms, mean {mean * 1e3:.3g} ms)"
    else:
        how = (
            f"scatter about a regular clock ({logged['gaps']['count']} steps look like gaps, no "
            "sample is lost)"
        )
    return (
        f"the stamps {how}: t is rebuilt from the row number at {1 / step:.6g} Hz; where the "
        "sensor itself pauses, declare its rate"
    )


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
