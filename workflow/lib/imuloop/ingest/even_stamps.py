"""Stamps of a sensor that samples evenly, made even: of packets, in bursts, that scatter."""

import numpy as np

from imuloop.core.gaps import gap_limit
from imuloop.core.samples import ANGULAR_RATE, TIME, Samples
from imuloop.core.stamps import Scatter

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
# such levels, at least: of fewer rows that are lost at random may lie on a line
_LEAST_LEVELS = 5
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
    lost: the medians of parts so long that one is known to `_KNOWN` of a step, `_LEAST_LEVELS` or
    more, all lie within half a step, and the median step is the mean one but for what the grid of
    the stamps rounds. They stay where rows hold `increments`, whose intervals may differ, and where
    the angular rate goes with them.

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
        if increments or not even or not _LEAST_LEVELS * needed < len(away):
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
    packet = np.repeat(np.arange(len(starts)), size)[:n]
    number, before = np.arange(n) - starts[packet], stamps[0]
    if held and held[0] == stamps[0]:
        # the packet began in the rows of the last call
        number[packet == 0] += held[1]
        size[0] += held[1]
        before = held[2]
    elif held:
        before = held[0]
    away = np.diff(stamps, prepend=before) if last else np.diff(stamps, append=stamps[-1])
    width = np.where(away > 0, np.minimum(step, away / size), step)[packet]
    moved = x.copy()
    moved[readable] = own[:n] + ((number - (size[packet] - 1) * last) * width).astype(x.dtype)
    end = packet[-1]
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
    return f"the stamps {how}: {at}; where the sensor itself pauses, give rate in Hz"


def _steps(measured):
    """Return the median and the mean step, s."""
    median = measured["gaps"]["longer_than_s"] / gap_limit(1.0)
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
        "long. If the sensor itself samples evenly, take the row's number for the time: "
        f"columns.time: null, and about rate: {1 / mean:.4g}"
    )
