"""What is wrong in the samples themselves: found by measure and counted, nothing is changed.

Padding with zeros, values that stick, spikes, clipping at a repeated extreme, samples held over
several rows, an axis that is a copy of another, a stream filtered or resampled before it was
logged, a temperature that is none, and units that motion and rest deny.
"""

import json
from itertools import combinations

import numpy as np

from imuloop.core.samples import (
    ACCELERATION,
    ANGULAR_RATE,
    CHANNELS,
    METADATA_KEY,
    TIME,
)
from imuloop.core.units import ANGULAR_RATE as ANGULAR_RATE_UNITS
from imuloop.ingest.runs import LENGTHS, Runs, held_lengths, rows_a_value
from imuloop.ingest.turns import PLAUSIBLE_RATIO, Turns

SENSORS = {"acceleration": ACCELERATION, "angular_rate": ANGULAR_RATE}

# a spike lies so many times farther from the middle of its neighbours, REACH each side, than any
# of these does: a knock on the table comes to 17, a rare jump of a good sensor to 10
SPIKE_FACTOR, REACH = 20.0, 8
# rows at an extreme value to call it a limit. Of noise that spans several steps a level holds at
# least 0.3 n1/n2 of what the next one inside holds: n1^2/n2 = 60 leave e^-15 for none beyond;
# of coarser noise it holds so many times as many as each of the next levels
LEAST_CLIPPED, CUT_TAIL, STEEP, LEVELS = 20, 60, 4, 4
# an axis is a copy where this share of its changes is the other's, of at least so many
COPIED_SHARE, LEAST_CHANGES = 0.99, 50
# blocks for spectra: rows a block, blocks a row group, blocks needed
BLOCK, BLOCKS, LEAST_BLOCKS = 256, 64, 4
# share of Nyquist of the bands compared: drift and motion, noise, noise near Nyquist
LOW, MIDDLE, HIGH = (1 / 64, 1 / 16), (1 / 16, 1 / 4), (3 / 4, 1)
# the noise near Nyquist is lacking below this share; a log with more drift is moving
LACKING_SHARE, MOST_DRIFT = 0.05, 10.0
# an axis is silent at rest where it never changes in this share of the quieter blocks
SILENT_SHARE = 0.8
# what a thermometer beside an IMU can show, degC
PLAUSIBLE_TEMPERATURE = (-60.0, 150.0)
# a temperature may well stay the same for so long, s
CONSTANT_TEMPERATURE = 60.0
# no sensor at rest shows more; no hand turns faster than this on average, rad/s
PLAUSIBLE_REST, PLAUSIBLE_TURN = 1.0, 10.0
# rates that an IMU's log has, Hz; others are read but told
USUAL_RATE = (0.5, 4e4)


# a damaged file may hold 1e306, which a sum of squares does not
@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def measure(file, figures):
    """Return the faults of a samples file, read row group by row group.

    Parameters
    ----------
    file : pyarrow.parquet.ParquetFile
        Samples as in `imuloop.core.samples`.
    figures : dict
        Quality figures with ``rate_hz``, ``quantisation_step`` and ``range`` of every channel.

    Returns
    -------
    dict
        As `faults` in quality.json; empty for an empty file.
    """
    if not file.metadata.num_rows or not figures["rate_hz"]:
        return {}
    names = [name for name in file.schema_arrow.names if name != TIME]
    steps = figures["quantisation_step"]
    zeros = _zeros(file)
    runs = {name: Runs(steps[name]) for name in CHANNELS}
    held = {sensor: np.zeros(LENGTHS + 1, dtype=int) for sensor in SENSORS}
    zero_rows = dict.fromkeys(SENSORS, 0)
    spikes = dict.fromkeys(names, 0)
    limits = {name: np.zeros((2, LEVELS + 1), dtype=int) for name in CHANNELS}
    pairs = {pair: np.zeros(2, dtype=int) for pair in combinations(names, 2)}
    spectra = {name: [] for name in CHANNELS}
    rests, turns = [], Turns(figures["rate_hz"])
    tail, row = None, 0
    for group in range(file.num_row_groups):
        table = file.read_row_group(group, columns=names)
        x = {name: table[name].to_numpy() for name in names}
        turns.add(x)
        padded = {sensor: _all_at(x, SENSORS[sensor], zeros[sensor]) for sensor in SENSORS}
        # a gyroscope at rest may well show three zeros; an accelerometer never does
        padded["angular_rate"] &= padded["acceleration"]
        for sensor, axes in SENSORS.items():
            zero_rows[sensor] += int(padded[sensor].sum())
            if padded[sensor].any():
                x |= {name: np.where(padded[sensor], np.nan, x[name]) for name in axes}
        changes = {name: np.flatnonzero(x[name][1:] != x[name][:-1]) for name in names}
        for pair, count in pairs.items():
            count += _common_changes(*(x[name] for name in pair), *(changes[n] for n in pair))
        for sensor, axes in SENSORS.items():
            held[sensor] += held_lengths([changes[name] for name in axes], len(x[axes[0]]))
        for name in CHANNELS:
            runs[name].add(x[name], row)
            limits[name] += _at_limits(x[name], figures["range"][name], steps[name])
        whole = x if tail is None else {n: np.concatenate((tail[n], x[n])) for n in names}
        for name in names:
            spikes[name] += _spikes(whole[name], steps[name] or 0.0)
        tail = {name: column[-2 * REACH :] for name, column in whole.items()}
        blocks = {name: _blocks(x[name]) for name in CHANNELS}
        for name in CHANNELS:
            spectra[name].append(_bands(blocks[name]))
        means = np.array([blocks[name].mean(axis=1) for name in ANGULAR_RATE])
        spread = sum(blocks[name].var(axis=1) for name in ACCELERATION)
        rests.append(np.array([spread, np.sqrt((means**2).sum(axis=0))]))
        row += table.num_rows
    stuck = {name: runs[name].stuck() for name in CHANNELS}
    rests, spectra = np.hstack(rests), {name: np.hstack(spectra[name]) for name in CHANNELS}
    silent = [
        name
        for name in CHANNELS
        # once or twice is a fault of a moment
        if len(stuck[name]) not in (1, 2)
        and name not in figures["constant"]
        and _silent(spectra[name][0], rests[0])
    ]
    stuck |= {name: [] for name in silent}
    # all axes of a gyroscope stuck at zero is padding too
    zeroed = [{(n, at) for n, at, value in stuck[name] if value == zeros["angular_rate"][i]}
              for i, name in enumerate(ANGULAR_RATE)]  # fmt: skip
    rate, clipped = figures["rate_hz"], {}
    for name in CHANNELS:
        clipped[name] = _clipped(
            limits[name], figures["range"][name], stuck[name], spikes[name], runs[name], rate
        )
        if name in silent:
            clipped[name] = {"values": [], "rows": 0}
        stuck[name] = [run for run in stuck[name] if run[2] not in clipped[name]["values"]]
    for length, start in set.intersection(*zeroed):
        zero_rows["angular_rate"] += length
        for name in ANGULAR_RATE:
            stuck[name] = [run for run in stuck[name] if run[:2] != (length, start)]
    held = {sensor: rows_a_value(lengths) for sensor, lengths in held.items()}
    return {
        "zero_rows": zero_rows,
        "stuck": {name: _stuck_figures(stuck[name], rate, file) for name in CHANNELS},
        "spikes": spikes,
        "clipped_at": clipped,
        "rows_a_value": held,
        "copies": [
            list(pair)
            for pair, (changed, common) in pairs.items()
            if changed >= LEAST_CHANGES and common >= COPIED_SHARE * changed
        ],
        "silent_at_rest": silent,
        "noise_near_nyquist": {
            name: None if name in silent else _lacking(spectra[name]) for name in CHANNELS
        },
        "rate_at_rest": _rate_at_rest(rests),
        "turn_ratio": turns.ratio(),
    }


def _zeros(file):
    """Return what a logged zero is in SI, a value an axis."""
    metadata = json.loads((file.schema_arrow.metadata or {}).get(METADATA_KEY, b"{}"))
    units = metadata.get("raw_units", {})
    return {
        sensor: [(0.0 - units[sensor]["offset"]) * units[sensor]["scale"] if sensor in units else 0]
        * 3
        for sensor in SENSORS
    }


def _all_at(x, axes, values):
    """Return the rows in which all axes have the values given."""
    return np.all([x[name] == value for name, value in zip(axes, values, strict=True)], axis=0)


def _stuck_figures(found, rate, file):
    """Return how often, for how many rows, how long at most and from when an axis was stuck."""
    return {
        "stretches": len(found),
        "rows": sum(run[0] for run in found),
        "longest_s": max((run[0] for run in found), default=0) / rate,
        "first_s": _time_of(file, min(run[1] for run in found)) if found else None,
    }


def _time_of(file, row):
    """Return the time of a row, s."""
    for group in range(file.num_row_groups):
        rows = file.metadata.row_group(group).num_rows
        if row < rows:
            return file.read_row_group(group, columns=[TIME])[TIME][row].as_py()
        row -= rows
    return None


def _common_changes(x, y, at_x, at_y):
    """Return how often the one changes, more or less than the other, and how often both alike."""
    if not len(at_x) or not len(at_y):
        return max(len(at_x), len(at_y)), 0
    # a glance at a few rows settles most pairs
    few = at_x[:: max(len(at_x) // 64, 1)] + 1
    if (x[few] == y[few]).mean() < 0.5:
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


def _clipped(counts, limits, stuck, spikes, runs, rate):
    """Return the extreme values that an axis keeps to, and for how many rows in all."""
    values, rows = [], 0
    for (at, *near), value in zip(counts, limits, strict=True):
        here = [run[0] for run in stuck if run[2] == value]
        # one long stretch is a stuck value
        if len(here) == 1 and here[0] >= max(rate, 0.9 * at):
            continue
        wide = runs.wide >= 0.5 * runs.varied
        cut = at**2 >= CUT_TAIL * near[0] if wide else at >= STEEP * max(near)
        enough = at >= LEAST_CLIPPED and spikes < at / 2
        if limits[0] < limits[1] and enough and cut and runs.fine:
            values.append(value)
            rows += int(at)
    return {"values": values, "rows": rows}


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
    around = np.r_[-REACH:0, 1 : REACH + 1]
    count = 0
    for part in np.array_split(at, max(len(at) // 4096, 1)):
        near = x[part[:, None] + around]
        middle = np.median(near, axis=1)
        spread = np.maximum(np.abs(near - middle[:, None]).max(axis=1), max(step, usual))
        count += int((np.abs(x[part] - middle) > SPIKE_FACTOR * spread).sum())
    return count


def _blocks(x):
    """Return a few whole blocks of rows, evenly spread, shape (n, BLOCK)."""
    blocks = x[: len(x) // BLOCK * BLOCK].reshape(-1, BLOCK)
    return blocks[:: max(-(-len(blocks) // BLOCKS), 1)]


def _bands(blocks):
    """Return variance and the mean power in the bands of each block, shape (4, n)."""
    away = blocks - blocks.mean(axis=1, keepdims=True)
    power = np.abs(np.fft.rfft(away * np.hanning(BLOCK), axis=1)) ** 2
    top = BLOCK // 2
    bands = [power[:, int(a * top) : int(b * top)].mean(axis=1) for a, b in (LOW, MIDDLE, HIGH)]
    return np.array([away.var(axis=1), *bands])


def _lacking(found):
    """Return the noise near Nyquist as a share of that below; None where nothing rests."""
    variance, low, middle, high = found[:, np.isfinite(found).all(axis=0) & (found[0] > 0)]
    if len(variance) < LEAST_BLOCKS:
        return None
    quiet = np.argsort(variance)[: max(len(variance) // 4, LEAST_BLOCKS)]
    if not middle[quiet].sum() or low[quiet].sum() > MOST_DRIFT * middle[quiet].sum():
        return None
    return float(high[quiet].sum() / middle[quiet].sum())


def _silent(variance, spread):
    """Tell whether an axis hardly ever changes while the force does not move."""
    quiet = spread <= np.median(spread) if len(spread) >= LEAST_BLOCKS else spread < 0
    return bool((variance[quiet] == 0).sum() > SILENT_SHARE * quiet.sum())


def _rate_at_rest(found):
    """Return the mean angular rate of the quietest blocks, rad/s."""
    spread, rate = found[:, np.isfinite(found).all(axis=0)]
    if len(spread) < LEAST_BLOCKS:
        return None
    quiet = np.argsort(spread)[: max(len(spread) // 4, LEAST_BLOCKS)]
    return float(np.median(rate[quiet]))


def warnings(figures, units):
    """Return one line for each kind of fault found: where, how much, and what to do.

    Parameters
    ----------
    figures : dict
        Quality figures, `faults` among them.
    units : dict
        Raw unit of each sensor, `RawUnit`.
    """
    found, rate = figures["faults"], figures["rate_hz"]
    if not found:
        return []
    lines = []
    zero = {sensor: n for sensor, n in found["zero_rows"].items() if n}
    if zero:
        listed = ", ".join(f"{sensor} in {n} rows" for sensor, n in zero.items())
        lines.append(
            f"exactly zero on all axes: {listed}; padding or failed reads, no motion: crop them "
            "with time_range or take them out of the log"
        )
    stuck = {name: f for name, f in found["stuck"].items() if f["stretches"]}
    if stuck:
        listed = ", ".join(
            f"{name} {f['rows']} samples, {f['stretches']} times, first at {f['first_s']:.6g} s"
            for name, f in stuck.items()
        )
        lines.append(f"stuck at one value: {listed}; crop them with time_range")
    if found["silent_at_rest"]:
        lines.append(
            f"no noise at rest: {', '.join(found['silent_at_rest'])}; a step too coarse, or "
            "firmware that holds the value: noise and bias cannot be told from this log"
        )
    spikes = {name: n for name, n in found["spikes"].items() if n}
    if spikes:
        listed = ", ".join(f"{name} {n}" for name, n in spikes.items())
        lines.append(f"spikes of a single sample: {listed}; check the wiring and the logger")
    full = figures["clipped"]
    clipped = {n: f for n, f in found["clipped_at"].items() if f["values"] and not full.get(n)}
    if clipped:
        listed = ", ".join(
            f"{name} {f['rows']} samples at {' and '.join(f'{v:.6g}' for v in f['values'])}"
            for name, f in clipped.items()
        )
        lines.append(
            f"clipped at a repeated extreme value: {listed}; choose a wider range or move more "
            "gently, and declare full_scale"
        )
    held = {sensor: n for sensor, n in found["rows_a_value"].items() if n > 1}
    if held:
        listed = ", ".join(
            f"{sensor} for {n:.3g} rows ({rate / n:.4g} Hz of new values in {rate:.4g} Hz)"
            for sensor, n in held.items()
        )
        lines.append(
            f"a value is held: {listed}; log each new value once, else noise comes out wrong"
        )
    for one, other in found["copies"]:
        lines.append(f"{other} is a copy of {one}: see columns")
    lacking = {
        name: share
        for name, share in found["noise_near_nyquist"].items()
        if share is not None
        and share < LACKING_SHARE
        # what is held, or a copy, is told above
        and not (set(held) & {s for s, axes in SENSORS.items() if name in axes})
    }
    if lacking:
        listed = ", ".join(f"{name} {share:.2%}" for name, share in lacking.items())
        lines.append(
            f"power is lacking above {HIGH[0] * rate / 2:.3g} Hz (a filter, or a log that was "
            f"resampled): {listed} of the noise below; log the sensor's own output"
        )
    return lines + _temperature(figures) + _units(figures, found, units)


def _temperature(figures):
    """Tell a temperature that is none."""
    limits = figures["temperature_range"]
    if not limits or not np.isfinite(limits).all():
        return []
    low, high = limits
    least, most = PLAUSIBLE_TEMPERATURE
    if not least <= low <= high <= most:
        hint = "counts, or failed reads"
        if least <= low - 273.15 <= high - 273.15 <= most:
            hint = "it looks like K"
        elif least <= low + 273.15 <= high + 273.15 <= most:
            hint = "it looks like degC taken as K"
        return [f"temperature from {low:.5g} to {high:.5g} degC: {hint}, see units.temperature"]
    if low == high and figures["duration_s"] >= CONSTANT_TEMPERATURE:
        return [
            f"temperature is {low:.5g} degC throughout: not read, or too coarse; it can show no "
            "effect of temperature"
        ]
    return []


def _units(figures, found, units):
    """Tell units of angular rate and time that rest, motion and rate deny."""
    lines, rate, unit = [], figures["rate_hz"], units["angular_rate"]
    if not USUAL_RATE[0] <= rate <= USUAL_RATE[1]:
        lines.append(f"{rate:.3g} Hz is unusual for an IMU: see units.time")
    rest, ratio = found["rate_at_rest"], found["turn_ratio"]
    turn = figures["mean_angular_rate"]
    # what is stuck or padded turns nothing, whatever its unit
    live = not found["zero_rows"]["angular_rate"] and not any(
        found["stuck"][name]["stretches"] or name in figures["constant"] for name in ANGULAR_RATE
    )
    if turn > PLAUSIBLE_TURN:
        lines.append(
            f"the mean angular rate is {turn:.4g} rad/s, too much for a turn by hand: "
            "see units.angular_rate"
        )
    elif live and ratio and not PLAUSIBLE_RATIO[0] <= ratio <= PLAUSIBLE_RATIO[1]:
        hint = "see units.angular_rate, nominal.angular_rate and units.time"
        fits = [
            name
            for name, scale in ANGULAR_RATE_UNITS.items()
            if unit.name != "count" and 0.5 <= ratio * scale / unit.scale <= 5
        ]
        if fits:
            hint = f"taken as {unit.name}, it looks like {fits[0]}; or see units.time"
        lines.append(
            f"the angular rate turns the device {ratio:.3g} times as far as gravity turns in its "
            f"axes: {hint}"
        )
    elif rest and rest > PLAUSIBLE_REST:
        lines.append(
            f"the angular rate is {rest:.4g} rad/s in the quietest stretches, too much for a bias: "
            "see units.angular_rate and nominal.angular_rate"
        )
    return lines
