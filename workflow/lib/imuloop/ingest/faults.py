"""What is wrong in the samples themselves; nothing is changed.

Each sensor's channels are measured by themselves, axes and rests across both.
"""

from itertools import combinations

import numpy as np

from imuloop.core.samples import (
    ACCELERATION,
    ANGULAR_RATE,
    CHANNELS,
    ROWS,
    TEMPERATURE,
    TIME,
    Samples,
)
from imuloop.ingest.axes import AGREEMENT, Axes
from imuloop.ingest.constant_stretches import LENGTHS, ConstantStretches, rows_a_value
from imuloop.ingest.increments import SENSORS
from imuloop.ingest.spikes import isolated
from imuloop.ingest.stops import Stops

# Hz; no sensor is as fast
MOST_RATE = 1e9
# a spike lies so many times farther from the middle of its neighbours, REACH each side, than any
# of these does: a knock on the table comes to 17, a rare jump of a good sensor to 10
SPIKE_FACTOR, REACH = 20.0, 8
# rows at an extreme value to call it a limit. Of noise that spans several steps a level holds at
# least 0.3 n1/n2 of what the next one inside holds: n1^2/n2 = 60 leave e^-15 for none beyond;
# of coarser noise it holds so many times as many as each of the next levels
LEAST_CLIPPED, CUT_TAIL, STEEP, LEVELS = 20, 60, 4, 4
# equal values in a row that make a flat top, where both neighbours are more than `FAR_STEPS` away
FLAT_TOP = 3
# steps to the end of 16 bits: a sample there is clipped, one alone may have come there by itself
RAILS, LEAST_RAIL = (32767, 32768), 2
# an axis is a copy where this share of its changes is the other's, of at least so many
COPIED_SHARE, LEAST_CHANGES = 0.99, 50
# an integer that wraps around jumps by this share of the range at least, while neighbouring samples
# differ by less than that; how far its range may lie from zero, or its width from a power of two
WRAPPED, FLAT, UNEVEN = 0.9, 0.05, 0.1
# rows at an end of the range count as failed reads where both neighbours lie in the other half of a
# range of at least so many steps; and single rows of one value, so many steps from both neighbours,
# where they are more than this share: at random they are a seventh at most, p (1 - p)^2
READ_STEPS, FAR_STEPS, OFTEN = 1000, 8, 0.2
# blocks for variances: rows per block, blocks per piece, and those that are needed
BLOCK, BLOCKS, LEAST_BLOCKS = 128, 128, 8
# an axis is silent at rest where it never changes in this share of the quieter blocks
SILENT_SHARE = 0.8
# a gap that a device may be turned in is longer, s
TURN_GAP = 0.2


# a damaged file may hold 1e306, which a sum of squares does not
@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def measure(samples, raw_units, figures):
    """Return the faults of samples, empty of none, and row and channel of each spike, (2, k).

    `raw_units` are the `RawUnit` of each sensor; `figures` are quality figures with ``rate_hz``,
    ``gaps``, ``quantisation_step`` and ``range``; a spike is as in `isolated`.
    """
    rate, ranges, count = figures["rate_hz"], figures["range"], len(samples)
    # stamps of a damaged file may lie 1e-300 s apart: no block of a second holds the rows
    if not count or not 0 < (rate or 0) < MOST_RATE:
        return {}, np.empty((2, 0), dtype=int)
    names = [name for name in (*CHANNELS, TEMPERATURE) if name in samples]
    steps = {name: step or 0.0 for name, step in figures["quantisation_step"].items()}
    zeros = {
        name: -unit.offset * unit.scale for s, unit in raw_units.items() for name in SENSORS[s]
    }
    t, x = samples[TIME], samples.read(names, 0, count)
    long = np.diff(t)
    gaps = np.flatnonzero(long > max(figures["gaps"]["longer_than_s"] or 0.0, TURN_GAP))
    # where single rows are lost fewer come in a second than the usual step says
    rows_per_s = (count - 1 - len(gaps)) / (figures["duration_s"] - long[gaps].sum())
    single = np.nonzero(isolated(x[:6], np.array([steps[name] for name in CHANNELS])))[::-1]
    padding = _without_padding(x, np.array([[zeros[name]] for name in CHANNELS])).tolist()
    zero_rows, in_turn, zero_reads = (dict(zip(SENSORS, each, strict=True)) for each in padding)
    changed = x[:, 1:] != x[:, :-1]
    constant = {
        name: ConstantStretches(values, steps[name])
        for name, values in zip(CHANNELS, x, strict=False)
    }
    counts, variances, wraps = [], [], []
    for first in range(0, count, ROWS):
        # a few rows before those of the piece show what ends in them
        lead = min(first, 2 * REACH)
        known = dict(zip(names, x[:, first - lead : first + ROWS], strict=True))
        found = [_counts(known[name], lead, ranges[name], steps[name]) for name in CHANNELS]
        *numbers, rows = zip(*found, strict=True)
        if TEMPERATURE in known:
            warmth = known[TEMPERATURE]
            numbers[0] += (_spikes(warmth, np.abs(np.diff(warmth)), steps[TEMPERATURE]),)
        counts.append([*map(np.array, numbers)])
        wraps.append([first + at for at in rows])
        variances.append([_variances(known[name][lead:]) for name in CHANNELS])
    wraps = [np.concatenate(rows) for rows in zip(*wraps, strict=True)]
    # where an integer wraps around nothing is known of a turn
    for values, rows in zip(x, wraps, strict=False):
        values[rows] = values[rows + 1] = np.nan
    fit, rests = turns(dict(zip(names, x, strict=True)), rows_per_s, gaps)
    spikes, limits, failed, tops = map(sum, zip(*counts, strict=True))
    variances = dict(zip(CHANNELS, np.concatenate(variances, axis=1), strict=True))
    limits, tops = (dict(zip(CHANNELS, n, strict=True)) for n in (limits, tops))
    spikes = dict(zip(names, spikes, strict=True))
    stuck = {name: constant[name].stuck() for name in CHANNELS}
    force = sum(variances[name] for name in ACCELERATION)
    silent = [
        name
        for name in CHANNELS
        # once or twice is a fault of a moment
        if len(stuck[name]) not in (1, 2)
        and name not in figures["constant"]
        and _silent(variances[name], force)
    ]
    stuck |= {name: [] for name in silent}
    # all axes of a gyroscope stuck at zero is padding too
    zero = ({r[:2] for r in stuck[n] if r[2] == zeros[n]} for n in ANGULAR_RATE)
    padding = set.intersection(*zero)
    zero_rows["angular_rate"] += sum(length for length, _ in padding)
    clipped = {name: {"values": [], "rows": 0} for name in CHANNELS}
    for axes in SENSORS.values():
        for name, value, rows in _clipped(
            [
                (n, limits[n], constant[n], stuck[n], spikes[n], tops[n])
                for n in axes
                if n not in silent
            ],
            *(ranges, steps, rate),
        ):
            clipped[name]["values"].append(value)
            clipped[name]["rows"] += rows
    for name, found in stuck.items():
        values, padded = clipped[name]["values"], padding if name in ANGULAR_RATE else ()
        stuck[name] = [s for s in found if s[2] not in values and s[:2] not in padded]
    if rests:
        row, gap = rests.pop("jump_row"), rests.pop("gap_row")
        rests |= {"jump_s": t[row].item(), "gap_s": None if gap is None else t[gap].item()}
    failed = dict(zip(CHANNELS, failed.tolist(), strict=True))
    for sensor, rows in zero_reads.items():
        if rows > OFTEN * count:
            failed |= dict.fromkeys(SENSORS[sensor], rows)
    faults = {
        "zero_rows": zero_rows,
        "in_turn": in_turn,
        "failed_reads": failed,
        "stuck": {name: _stuck_figures(stuck[name], rate, t) for name in CHANNELS},
        "spikes": {name: int(n) for name, n in spikes.items()},
        "wraps": {name: len(rows) for name, rows in zip(CHANNELS, wraps, strict=True)},
        "clipped_at": clipped,
        "rows_a_value": {
            sensor: rows_a_value(each)
            for sensor, each in zip(SENSORS, (changed[:3], changed[3:6]), strict=True)
        },
        "copies": [
            [names[a], names[b]]
            for a, b in combinations(range(len(names)), 2)
            if _copied(x[[a, b]], changed[[a, b]])
        ],
        "silent_at_rest": silent,
        "axes": fit,
        "rests": rests,
    }
    return faults, np.array(single)


def turns(x, rate, gaps=()):
    """Return what channels, by name, at a rate show of turns and rests: `axes` and `rests`.

    `gaps` are the rows before a gap.
    """
    stops, way = Stops(rate, gaps), Axes(rate)
    for _, piece in Samples(x).pieces(CHANNELS):
        piece = dict(zip(CHANNELS, piece, strict=True))
        way.add(piece)
        stops.add(piece)
    axes = way.fit()
    return axes, stops.figures(axes["ratio"] if axes and axes["best"] > AGREEMENT else None)


def _without_padding(x, zeros):
    """Put not-a-number for the rows of padding; return counts of rows by sensor, (3, 2).

    Padding, all axes of this sensor alone at zero, and so in a single row.
    """
    zero = x[:6] == zeros
    alone = np.array([zero[:3].all(axis=0), zero[3:].all(axis=0)])
    # a gyroscope at rest may well show three zeros; an accelerometer never does
    padded = np.array([alone[0], alone.all(axis=0)])
    for axes, rows in zip((x[:3], x[3:6]), padded, strict=True):
        axes[:, rows] = np.nan
    single = alone[:, 1:-1] & ~alone[:, :-2] & ~alone[:, 2:]
    of_one = alone & ~alone[::-1]
    return np.array([each.sum(axis=1) for each in (padded, of_one, single)])


def _stuck_figures(found, rate, t):
    """Return how often, for how many rows, how long at most and when an axis was stuck."""
    spans = [[t[i].item(), t[i + n - 1].item()] for i, n in sorted((i, n) for n, i, _ in found)]
    return {
        "stretches": len(found),
        "rows": sum(stretch[0] for stretch in found),
        "longest_s": max((stretch[0] for stretch in found), default=0) / rate,
        "first_s": spans[0][0] if found else None,
        "spans_s": spans,
    }


def _copied(x, changed):
    """Tell whether of two channels, (2, n), one is a copy of the other."""
    same = x[0] == x[1]
    alike = np.count_nonzero(same[1:] & same[:-1] & changed[0])
    changes = max(map(np.count_nonzero, changed))
    return changes >= LEAST_CHANGES and alike >= COPIED_SHARE * changes


def _at_limits(x, limits, step):
    """Return rows at the lowest and the highest value, and at the next few levels of each."""
    found = np.zeros((2, LEVELS + 1), dtype=int)
    for i, inside in enumerate((x - limits[0], limits[1] - x)):
        near = inside[inside < max((LEVELS + 0.5) * step, np.finfo(float).tiny)]
        found[i, 0] = np.count_nonzero(near == 0)
        if step:
            near = near[near > 0.5 * step]
            found[i] += np.bincount(np.round(near / step).astype(int), minlength=LEVELS + 1)
    return found


def _flat_tops(x, low, high, step):
    """Return the numbers of flat tops of a channel: at its low end, at its high end, elsewhere.

    A smooth motion has none, and values that are held have them everywhere. Those elsewhere count
    only if there is one at an end.
    """
    found = np.zeros(3, dtype=int)
    if np.count_nonzero((x == low) | (x == high)) < FLAT_TOP:
        return found
    starts = np.flatnonzero(np.diff(x, prepend=np.nan))
    values, rows = x[starts], np.diff(starts)[1:]
    far = np.abs(np.diff(values)) > FAR_STEPS * step
    tops = values[1:-1][(rows >= FLAT_TOP) & far[:-1] & far[1:]]
    found[:2] = np.count_nonzero(tops == low), np.count_nonzero(tops == high)
    found[2] = len(tops) - found.sum() if found.any() else 0
    return found


def _clipped(axes, ranges, steps, rate):
    """Give (name, value, rows) of the ends of the range that axes of a sensor keep to.

    `axes` are name, rows at the ends and next to them, ConstantStretches, stuck stretches, spikes
    and flat tops of each. Ends of the same size, to a step, are one end: it may be reached on each
    axis for a few samples only.
    """
    ends = []
    for name, limits, constant, stuck, spikes, (*tops, elsewhere) in axes:
        for value, (at, *near), flat in zip(ranges[name], limits, tops, strict=True):
            here = [s[0] for s in stuck if s[2] == value]
            cut = at**2 >= CUT_TAIL * near[0] if constant.wide else at >= STEEP * max(near)
            cut &= at >= LEAST_CLIPPED and spikes < at / 2 and constant.fine
            raw = abs(value / steps[name]) if steps[name] else 0.0
            cut |= at >= LEAST_RAIL and any(abs(round(raw, 1) - rail) < 0.5 for rail in RAILS)
            cut |= flat > 0 and elsewhere == 0
            # one long stretch is a stuck value
            cut &= ranges[name][0] < ranges[name][1]
            cut &= not (len(here) == 1 and here[0] >= max(rate, 0.9 * at))
            ends.append((name, value, at, near[0], cut, constant.fine, 1.01 * (steps[name] or 0.0)))
    for name, value, at, _, cut, fine, within in ends:
        same = [e for e in ends if e[5] and abs(abs(e[1]) - abs(value)) <= within]
        total, next_to = sum(e[2] for e in same), sum(e[3] for e in same)
        several = sum(e[2] >= LEAST_RAIL for e in same) > 1
        together = several and total >= LEAST_CLIPPED and total**2 >= CUT_TAIL * next_to
        if cut or (fine and value != 0 and (together or any(e[4] for e in same))):
            yield name, value, int(at)


def _counts(x, lead, ends, step):
    """Return spikes, rows at the ends, failed reads, flat tops and rows before wraps of a channel.

    The first `lead` rows are before those of the piece; `ends` are those of its range.
    """
    size, first = np.abs(np.diff(x)), max(lead - 3, 0)
    wraps = _wraps(x[first:], size[first:], *ends) + first - lead
    own = x[lead:]
    failed = _failed_reads(own, size[lead:], *ends, step)
    limits = _at_limits(own, ends, step)
    return _spikes(x, size, step), limits, failed, _flat_tops(own, *ends, step), wraps


def _wraps(x, size, low, high):
    """Return the rows before a jump from one end of the range to the other that stays there.

    `size` are the sizes of the steps. A value that swings from end to end is not as flat before and
    after, one that is clipped is flatter: it does not change at all, or is held at an end. A rate
    that is switched on and off goes from zero to one end; an integer's range lies around zero, or
    has all values of its bits.
    """
    span = high - low
    at = np.flatnonzero(size[1:-1] >= WRAPPED * span) + 1
    all_bits = low >= 0 and span > 2**11 and span >= (1 - UNEVEN) * 2 ** np.ceil(np.log2(span))
    if not len(at) or not (abs(low + high) / 2 <= UNEVEN * span or all_bits):
        return at[:0]
    before, after, end = size[at - 1], size[at + 1], (x == low) | (x == high)
    held = ((before == 0) & end[at]) | ((after == 0) & end[at + 1])
    return at[(before < FLAT * span) & (after < FLAT * span) & (before + after > 0) & ~held]


def _failed_reads(x, size, low, high, step):
    """Return how many rows hold one value again and again, far from those before and after.

    `size` are the sizes of the steps from row to row.
    """
    if not step or len(x) < 3:
        return 0
    far, farther = FAR_STEPS * step, max((high - low) / 2, READ_STEPS * step / 2)
    single = (size[1:] > far) & (size[:-1] > far)
    values, counts = np.unique(x[1 + np.flatnonzero(single)[:LENGTHS]], return_counts=True)
    often = 0
    if len(values):
        often = np.count_nonzero(single & (x[1:-1] == values[counts.argmax()]))
    railed = 0
    if (size > farther).any():
        starts = np.flatnonzero(np.diff(x, prepend=np.nan))
        values, rows, jumps = x[starts][1:-1], np.diff(starts)[1:], np.abs(np.diff(x[starts]))
        at_end = (values == low) | (values == high)
        railed = int(rows[at_end & (np.minimum(jumps[:-1], jumps[1:]) > farther)].sum())
    return max(railed, often if often > OFTEN * len(x) else 0)


def _spikes(x, size, step):
    """Return how many single samples lie far outside all their neighbours.

    `size` are the sizes of the steps from row to row.
    """
    if len(x) <= 2 * REACH:
        return 0
    usual = max(step, np.median(size[:-1:16]))
    far = size > SPIKE_FACTOR * usual
    at = np.flatnonzero(far[1:] & far[:-1]) + 1
    at = at[(at >= REACH) & (at < len(x) - REACH)]
    at = at[(x[at] > x[at - 1]) != (x[at + 1] > x[at])]
    near = x[at[:, None] + np.r_[-REACH:0, 1 : REACH + 1]]
    middle = np.median(near, axis=1)
    spread = np.maximum(np.abs(near - middle[:, None]).max(axis=1), usual)
    return int((np.abs(x[at] - middle) > SPIKE_FACTOR * spread).sum())


def _variances(x):
    """Return the variance of a few blocks, evenly spread."""
    blocks = x[: len(x) // BLOCK * BLOCK].reshape(-1, BLOCK)
    blocks = blocks[:: max(-(-len(blocks) // BLOCKS), 1)]
    # beside its first value, so that a block that never changes has none
    return (blocks - blocks[:, :1]).var(axis=1)


def _silent(variance, spread):
    """Tell whether an axis hardly ever changes while the force does not move."""
    quiet = spread <= np.median(spread) if len(spread) >= LEAST_BLOCKS else spread < 0
    return bool((variance[quiet] == 0).sum() > SILENT_SHARE * quiet.sum())
