"""What is wrong in the samples themselves: found by measure and counted, nothing is changed.

Padding with zeros, values that stick, spikes, clipping at a repeated extreme, samples held over
several rows, an axis that is a copy of another, a stream filtered or resampled before it was
logged, a temperature that is none, and units that motion and rest deny.
"""

from itertools import combinations

import numpy as np

from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, CHANNELS, TEMPERATURE, TIME
from imuloop.ingest.axes import AGREEMENT, Axes
from imuloop.ingest.increments import SENSORS
from imuloop.ingest.ordered_map import ordered_map
from imuloop.ingest.rest_means import RestMeans
from imuloop.ingest.runs import Runs, held_lengths, rows_a_value
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
# an axis is a copy where this share of its changes is the other's, of at least so many
COPIED_SHARE, LEAST_CHANGES = 0.99, 50
# a sample at the end of 16 bits is clipped, one alone may have come there by itself
RAILS, LEAST_RAIL = (32767, 32768), 2
# an integer that wraps around jumps by this share of the range at least, while neighbouring samples
# differ by less than that
WRAPPED, FLAT = 0.9, 0.05
# of its span, how far the range of an integer may lie from zero, or its width from a power of two
UNEVEN = 0.1
# rows at an end of the range count as failed reads where both neighbours lie in the other half of a
# range of at least so many steps
READ_STEPS = 1000
# blocks for spectra: rows per block, blocks per row group, and those at rest that are needed
BLOCK, BLOCKS, LEAST_BLOCKS = 128, 128, 8
# share of Nyquist of the bands compared: drift and motion, noise, noise near Nyquist
LOW, MIDDLE, HIGH = (1 / 64, 1 / 16), (1 / 16, 1 / 4), (3 / 4, 1)
# the noise near Nyquist is lacking below this share; a block with more drift on any axis is moving.
# The ratio of two powers over n blocks is F-distributed: of white noise over LEAST_BLOCKS, some 100
# degrees of freedom each, none is below a third once in a million times
LACKING_SHARE, MOST_DRIFT = 0.05, 10.0
# noise is that of a log that rests for as much of its time
QUIET_SHARE = 0.25
# an axis is silent at rest where it never changes in this share of the quieter blocks
SILENT_SHARE = 0.8


# a damaged file may hold 1e306, which a sum of squares does not
@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def measure(samples, metadata, figures, threads=1):
    """Return the faults of samples, piece by piece; empty of none.

    `figures` are quality figures with ``rate_hz``, ``quantisation_step`` and ``range`` of every
    channel.
    """
    rate, steps = figures["rate_hz"], figures["quantisation_step"]
    # stamps of a damaged file may lie 1e-300 s apart: no block of a second holds the rows
    if not len(samples) or not 0 < (rate or 0) < MOST_RATE:
        return {}
    names = [name for name in samples.names if name in (*CHANNELS, TEMPERATURE)]
    pairs = list(combinations(names, 2))
    units = metadata.get("raw_units", {})
    units = {name: units[s] for s, axes in SENSORS.items() if s in units for name in axes}
    zeros = {
        n: (0.0 - units[n]["offset"]) * units[n]["scale"] if n in units else 0 for n in CHANNELS
    }
    runs = {name: Runs(steps[name]) for name in CHANNELS}
    zero_rows, in_turn = dict.fromkeys(SENSORS, 0), dict.fromkeys(SENSORS, 0)
    gaps = np.flatnonzero(np.diff(samples[TIME]) > figures["gaps"]["longer_than_s"])
    means, still, way = RestMeans(rate), Stops(rate, gaps), Axes(rate)

    def groups():
        """Give the rows of each piece, less padding, and the last ones before them."""
        before = {name: np.empty(0) for name in names}
        for row, columns in samples.pieces(names):
            x = dict(zip(names, columns, strict=True))
            padded = {s: np.all([x[n] == zeros[n] for n in SENSORS[s]], axis=0) for s in SENSORS}
            for sensor, other in (SENSORS, [*SENSORS][::-1]):
                in_turn[sensor] += int((padded[sensor] & ~padded[other]).sum())
            # a gyroscope at rest may well show three zeros; an accelerometer never does
            padded["angular_rate"] &= padded["acceleration"]
            for sensor, axes in SENSORS.items():
                zero_rows[sensor] += int(padded[sensor].sum())
                if padded[sensor].any():
                    x |= {name: np.where(padded[sensor], np.nan, x[name]) for name in axes}
            means.add(x)
            # where an integer wraps around nothing is known of a turn
            turns = {n: _without_wraps(x[n], *figures["range"][n]) for n in CHANNELS}
            way.add(turns)
            still.add(turns)
            for name in CHANNELS:
                runs[name].add(x[name], row)
            yield x, before
            before = {n: np.concatenate((before[n], x[n][-2 * REACH :]))[-2 * REACH :] for n in x}

    @np.errstate(over="ignore", invalid="ignore", divide="ignore")
    def counted(part):
        """Return counts, spectra and the quiet of the rows of a group."""
        x, before = part
        changes = {name: np.flatnonzero(x[name][1:] != x[name][:-1]) for name in names}
        counts = [
            np.array([_common_changes(x[a], x[b], changes[a], changes[b]) for a, b in pairs]),
            np.array([held_lengths([changes[n] for n in axes], len(x["ax"]))
                      for axes in SENSORS.values()]),
            np.array([_at_limits(x[n], figures["range"][n], steps[n]) for n in CHANNELS]),
            np.array([_spikes(np.concatenate((before[n], x[n])), steps[n] or 0.0) for n in names]),
            # the last three rows before make windows of four that end in these rows
            np.array([_wraps(np.concatenate((before[n][-3:], x[n])), *figures["range"][n]).sum()
                      for n in CHANNELS]),
            np.array([_failed_reads(x[n], *figures["range"][n], steps[n]) for n in CHANNELS]),
        ]  # fmt: skip
        blocks = {name: _blocks(x[name]) for name in CHANNELS}
        quiet = sum(blocks[name].var(axis=1) for name in ACCELERATION)
        return counts, np.array([_bands(blocks[name]) for name in CHANNELS]), quiet

    counts, spectra, quiet = zip(*ordered_map(counted, groups(), threads), strict=True)
    common, lengths, limits, spikes, wraps, failed = (
        sum(each) for each in zip(*counts, strict=True)
    )
    quiet, spectra = np.concatenate(quiet), np.concatenate(spectra, axis=2)
    spectra = dict(zip(CHANNELS, spectra, strict=True))
    spikes = dict(zip(names, spikes.tolist(), strict=True))
    stuck = {name: runs[name].stuck() for name in CHANNELS}
    silent = [
        name
        for name in CHANNELS
        # once or twice is a fault of a moment
        if len(stuck[name]) not in (1, 2)
        and name not in figures["constant"]
        and _silent(spectra[name][0], quiet)
    ]
    stuck |= {name: [] for name in silent}
    # all axes of a gyroscope stuck at zero is padding too
    padding = set.intersection(
        *({run[:2] for run in stuck[name] if run[2] == zeros[name]} for name in ANGULAR_RATE)
    )
    zero_rows["angular_rate"] += sum(length for length, _ in padding)
    clipped = {}
    for name, counts in zip(CHANNELS, limits, strict=True):
        ends, unit = figures["range"][name], units.get(name)
        railed = [_at_rail(value, unit, steps[name]) for value in ends]
        values, rows = _clipped(
            counts, ends, railed, stuck[name], spikes[name], runs[name], rate
        ) if name not in silent else ([], 0)  # fmt: skip
        clipped[name] = {"values": values, "rows": rows}
        if name in ANGULAR_RATE:
            stuck[name] = [run for run in stuck[name] if run[:2] not in padding]
    ends = dict(zip(CHANNELS, limits, strict=True))
    for sensor in SENSORS.values():
        lively = [name for name in sensor if name not in silent and runs[name].fine]
        _share_ends({name: ends[name] for name in lively}, figures["range"], steps, clipped)
    for name in CHANNELS:
        stuck[name] = [run for run in stuck[name] if run[2] not in clipped[name]["values"]]
    axes = way.fit()
    rests = still.figures(axes["ratio"] if axes and axes["best"] > AGREEMENT else None)
    share, mean_at_rest = rests["share"] if rests else 0.0, None
    if share >= QUIET_SHARE:
        mean_at_rest = means.figures([steps[name] for name in ANGULAR_RATE])
    if rests:
        rests["jump_s"] = float(samples[TIME][rests.pop("jump_row")])
        row = rests.pop("gap_row")
        rests["gap_s"] = None if row is None else float(samples[TIME][row])
    still = _at_rest([spectra[name] for name in CHANNELS if name not in silent])
    return {
        "zero_rows": zero_rows,
        "in_turn": in_turn,
        "failed_reads": dict(zip(CHANNELS, failed.tolist(), strict=True)),
        "stuck": {name: _stuck_figures(stuck[name], rate, samples) for name in CHANNELS},
        "spikes": spikes,
        "wraps": dict(zip(CHANNELS, wraps.tolist(), strict=True)),
        "clipped_at": clipped,
        "rows_a_value": {s: rows_a_value(each) for s, each in zip(SENSORS, lengths, strict=True)},
        "copies": [
            list(pair)
            for pair, (changed, alike) in zip(pairs, common, strict=True)
            if changed >= LEAST_CHANGES and alike >= COPIED_SHARE * changed
        ],
        "silent_at_rest": silent,
        "noise_near_nyquist": {
            name: _lacking(spectra[name][:, still])
            if name not in silent and share >= QUIET_SHARE
            else None
            for name in CHANNELS
        },
        "mean_at_rest": mean_at_rest,
        "axes": axes,
        "rests": rests,
    }


def _stuck_figures(found, rate, samples):
    """Return how often, for how many rows, how long at most and when an axis was stuck."""
    t = samples[TIME]
    spans = sorted([float(t[i]), float(t[i + n - 1])] for n, i, _ in found)
    return {
        "stretches": len(found),
        "rows": sum(run[0] for run in found),
        "longest_s": max((run[0] for run in found), default=0) / rate,
        "first_s": spans[0][0] if found else None,
        "spans_s": spans,
    }


def _common_changes(x, y, at_x, at_y):
    """Return how often the one changes, more or less than the other, and how often both alike."""
    if not len(at_x) or not len(at_y):
        return max(len(at_x), len(at_y)), 0
    both = at_x[x[at_x] == y[at_x]]
    return max(len(at_x), len(at_y)), int((x[both + 1] == y[both + 1]).sum())


def _at_limits(x, limits, step):
    """Return rows at the lowest and the highest value, and at the next few levels of each."""
    found = np.zeros((2, LEVELS + 1), dtype=int)
    for i, (limit, inside) in enumerate(zip(limits, (x - limits[0], limits[1] - x), strict=True)):
        found[i, 0] = (x == limit).sum()
        if step:
            near = inside[(inside > 0.5 * step) & (inside < (LEVELS + 0.5) * step)]
            levels = np.round(near / step).astype(int)
            found[i] += np.bincount(levels, minlength=LEVELS + 1)
    return found


def _at_rail(value, unit, step):
    """Tell whether a value is the end of an integer of 16 bits, signed or from the offset on."""
    raw = [value / step] if step else []
    if unit and unit["name"] == "count":
        from_end = value / unit["scale"] + unit["offset"]
        raw = [from_end, from_end - RAILS[1]] if unit["offset"] else [from_end]
    return any(abs(round(abs(each), 1) - rail) < 0.5 for each in raw for rail in RAILS)


def _wraps(x, low, high):
    """Tell where a value jumps from one end of its range to the other and stays there, (n - 3,).

    A value that swings from end to end is not as flat before and after, one that is clipped is
    flatter: it does not change at all, or is held at an end. A rate that is switched on and off
    goes from zero to one end; an integer's range lies around zero, or has all values of its bits.
    """
    step = np.abs(np.diff(x))
    span = high - low
    all_bits = low >= 0 and span > 2**11 and span >= (1 - UNEVEN) * 2 ** np.ceil(np.log2(span))
    if not (abs(low + high) / 2 <= UNEVEN * span or all_bits):
        return np.zeros(max(len(step) - 2, 0), dtype=bool)
    before, jump, after = step[:-2], step[1:-1], step[2:]
    found = (jump >= WRAPPED * span) & (before < FLAT * span) & (after < FLAT * span)
    end = (x == low) | (x == high)
    held = ((before == 0) & end[1:-2]) | ((after == 0) & end[2:-1])
    return found & (before + after > 0) & ~held


def _without_wraps(x, low, high):
    """Return values with not-a-number where they wrap around."""
    at = np.flatnonzero(_wraps(x, low, high))
    if not len(at):
        return x
    x = x.copy()
    x[at + 1] = x[at + 2] = np.nan
    return x


def _failed_reads(x, low, high, step):
    """Return how many rows at an end of the range come between values of the other half."""
    if not step or high - low < READ_STEPS * step:
        return 0
    starts = np.flatnonzero(np.diff(x, prepend=np.nan))
    values, rows = x[starts], np.diff(starts)
    far = np.abs(np.diff(values)) > (high - low) / 2
    found = far[:-1] & far[1:] & ((values[1:-1] == low) | (values[1:-1] == high))
    return int(rows[1:][found].sum())


def _clipped(counts, limits, railed, stuck, spikes, runs, rate):
    """Return the extreme values that an axis keeps to, and for how many rows in all."""
    values, rows = [], 0
    for (at, *near), value, rail in zip(counts, limits, railed, strict=True):
        here = [run[0] for run in stuck if run[2] == value]
        # one long stretch is a stuck value
        if len(here) == 1 and here[0] >= max(rate, 0.9 * at):
            continue
        wide = runs.wide >= 0.5 * runs.varied
        cut = at**2 >= CUT_TAIL * near[0] if wide else at >= STEEP * max(near)
        enough = at >= LEAST_CLIPPED and spikes < at / 2
        cut = enough and cut and runs.fine
        if limits[0] < limits[1] and (cut or (rail and at >= LEAST_RAIL)):
            values.append(value)
            rows += int(at)
    return values, rows


def _share_ends(ends, ranges, steps, clipped):
    """Add what axes of a sensor keep to together: each may be there for a few samples only.

    Ends of the same size, to a step, are one end of the range where one was found, or where rows
    at all of them are as many as at one that is found.
    """
    each = [
        (name, value, counts, 1.01 * (steps[name] or 0.0))
        for name, both in ends.items()
        for value, counts in zip(ranges[name], both, strict=True)
    ]
    same = [
        [e for e in each if abs(abs(e[1]) - abs(value)) <= within] for _, value, _, within in each
    ]
    known = {name: tuple(clipped[name]["values"]) for name in ends}
    for (name, value, counts, _), alike in zip(each, same, strict=True):
        total, next_to = sum(c[0] for *_, c, _ in alike), sum(c[1] for *_, c, _ in alike)
        several = sum(c[0] >= LEAST_RAIL for *_, c, _ in alike) > 1
        cut = several and total >= LEAST_CLIPPED and total**2 >= CUT_TAIL * next_to
        of_one = any(v in known[n] for n, v, *_ in alike)
        if value not in known[name] and value != 0 and (of_one or cut):
            clipped[name]["values"].append(value)
            clipped[name]["rows"] += int(counts[0])


def _spikes(x, step):
    """Return how many single samples lie far outside all their neighbours."""
    if len(x) <= 2 * REACH:
        return 0
    before, after = np.diff(x)[:-1], np.diff(x)[1:]
    usual = np.median(np.abs(before[::16])) if len(before) else 0.0
    height = np.minimum(np.abs(before), np.abs(after))
    height[(before > 0) == (after > 0)] = 0.0
    at = np.flatnonzero(height > SPIKE_FACTOR * max(step, usual)) + 1
    at = at[(at >= REACH) & (at < len(x) - REACH)]
    near = x[at[:, None] + np.r_[-REACH:0, 1 : REACH + 1]]
    middle = np.median(near, axis=1)
    spread = np.maximum(np.abs(near - middle[:, None]).max(axis=1), max(step, usual))
    return int((np.abs(x[at] - middle) > SPIKE_FACTOR * spread).sum())


def _blocks(x):
    """Return a few whole blocks of rows, evenly spread, shape (n, BLOCK)."""
    found = x[: len(x) // BLOCK * BLOCK].reshape(-1, BLOCK)
    return found[:: max(-(-len(found) // BLOCKS), 1)]


def _bands(blocks):
    """Return variance and the mean power in the bands of each block, shape (4, n)."""
    away = blocks - blocks.mean(axis=1, keepdims=True)
    power = np.abs(np.fft.rfft(away * np.hanning(BLOCK), axis=1)) ** 2
    top = BLOCK // 2
    bands = [power[:, int(a * top) : int(b * top)].mean(axis=1) for a, b in (LOW, MIDDLE, HIGH)]
    return np.array([away.var(axis=1), *bands])


def _at_rest(spectra):
    """Return which blocks hold noise alone: on no axis is there much more at low frequencies."""
    rest = [np.isfinite(each).all(axis=0) & (each[1] <= MOST_DRIFT * each[2]) for each in spectra]
    return np.all(rest, axis=0) if rest else []


def _lacking(resting):
    """Return the noise near Nyquist as a share of that below; None of too few blocks at rest."""
    _, _, middle, high = resting[:, resting[0] > 0]
    if len(middle) < LEAST_BLOCKS:
        return None
    quiet = np.argsort(middle)[: max(len(middle) // 2, LEAST_BLOCKS)]
    return float(high[quiet].sum() / middle[quiet].sum()) if middle[quiet].sum() else None


def _silent(variance, spread):
    """Tell whether an axis hardly ever changes while the force does not move."""
    quiet = spread <= np.median(spread) if len(spread) >= LEAST_BLOCKS else spread < 0
    return bool((variance[quiet] == 0).sum() > SILENT_SHARE * quiet.sum())
