"""How good a log is: steps of time, gaps, faults, plausibility, and whether it can be used."""

import numpy as np
import pyarrow.parquet as pq

from imuloop.core.samples import (
    ACCELERATION,
    ANGULAR_RATE,
    CHANNELS,
    GAP_STEPS,
    LOGGED_TIME,
    TEMPERATURE,
    TIME,
)
from imuloop.ingest import fault_lines, faults
from imuloop.ingest.convert import BEYOND
from imuloop.ingest.in_order import in_order

# at most so many gaps are listed; all are counted
LISTED_GAPS = 50
# output at or beyond this share of the full scale counts as clipped
CLIPPED_SHARE = 0.98
# a log with fewer samples, or shorter, holds no rest worth a mean
LEAST_ROWS = 100
LEAST_DURATION = 2.0
# a channel that changes by less in a whole log is none: a thousandth of the best sensors' noise, SI
LEAST_CHANGE = dict.fromkeys(ACCELERATION, 1e-9) | dict.fromkeys(ANGULAR_RATE, 1e-12)
# a log that loses a larger share of its rows to faults is not to be trusted
MOST_DROPPED = 0.05
# rates at which IMUs log, Hz
PLAUSIBLE_RATE = (0.05, 1e5)

TREATMENT = (
    "Rows whose stamp or one of the six axes is missing, not finite or beyond what any sensor "
    f"gives (± {BEYOND:g} in SI), rows whose stamp repeats or lies before an earlier one, and "
    "lines that are no row are dropped and counted; nothing is filled or clipped, and nothing "
    "interpolated but sensors with clocks of their own, which is told. A temperature that is "
    "missing, or beyond the same, stays missing. A step longer than "
    f"{GAP_STEPS} median steps is a gap; rate and jitter are of the other steps. More than "
    f"{MOST_DROPPED:.0%} dropped, fewer than {LEAST_ROWS} rows or less than {LEAST_DURATION:g} s: "
    "rejected. Zeros on all axes, stuck, clipped, held or copied values and spikes are counted and "
    "named; they stay in the samples."
)


def measure(path, full_scale=None, threads=1, progress=None):
    """Return the quality figures of a samples file, read row group by row group.

    Parameters
    ----------
    path : path-like
        Samples as in `imuloop.core.samples`, `t` strictly increasing.
    full_scale : dict, optional
        ``acceleration`` (m/s^2) and ``angular_rate`` (rad/s); for clipping.
    threads : int
        How many may work at once.
    progress : callable, optional
        Called often with the share that is done.

    Returns
    -------
    dict
        As in quality.json; figures that the rows cannot give are None.
    """
    with pq.ParquetFile(path) as file:
        groups = range(file.num_row_groups)

        def tables():
            for group in groups:
                yield file.read_row_group(group)
                if progress:
                    progress(0.5 * (group + 1) / len(groups))

        figures = _time_figures(file, threads)
        figures |= _channel_figures(file, tables(), full_scale or {}, threads)
        told = progress and (lambda share: progress(0.5 + 0.5 * share))
        return {**figures, "faults": faults.measure(file, figures, threads, told)}


def _steps(file):
    """Give (first stamp, steps) of each row group, the step to the next group's first included."""
    last = None
    for group in range(file.num_row_groups):
        t = file.read_row_group(group, columns=[TIME])[TIME].to_numpy()
        if last is not None:
            t = np.concatenate(([last], t))
        if len(t):
            last = t[-1]
            yield t[:-1], np.diff(t)


def _time_figures(file, threads):
    figures = {
        "rows": file.metadata.num_rows,
        "duration_s": 0.0,
        "rate_hz": None,
        "jitter": {"std_s": None, "max_s": None},
        "gaps": {"count": 0, "total_s": 0.0, "longer_than_s": None, "list": []},
    }
    found = in_order(_median, _steps(file), threads)
    medians = [(float(median), n) for median, n in found if n]
    if not medians:
        return figures
    # median of the row groups' medians: bounded memory, and exact for one group
    values, weights = np.array(sorted(medians)).T
    median = values[np.searchsorted(np.cumsum(weights), weights.sum() / 2)]
    limit = GAP_STEPS * median
    regular = total = squares = largest = 0.0
    gaps = figures["gaps"]
    gaps["longer_than_s"] = limit
    for starts, steps in _steps(file):
        figures["duration_s"] += float(steps.sum())
        wide = steps > limit
        gaps["count"] += int(wide.sum())
        gaps["total_s"] += float(steps[wide].sum())
        room = LISTED_GAPS - len(gaps["list"])
        gaps["list"] += [
            {"start_s": float(start), "duration_s": float(step)}
            for start, step in zip(starts[wide][:room], steps[wide][:room], strict=True)
        ]
        away = steps[~wide] - median
        regular += away.size
        total += away.sum()
        squares += (away**2).sum()
        largest = max(largest, np.abs(away).max(initial=0.0))
    mean = total / regular
    # infinite where the steps of a damaged file are 1e-318 s
    with np.errstate(over="ignore", divide="ignore"):
        figures["rate_hz"] = float(np.divide(1, median + mean))
    figures["jitter"] = {
        "std_s": float(np.sqrt(max(squares / regular - mean**2, 0.0))),
        "max_s": float(largest),
    }
    return figures


def _median(part):
    _, steps = part
    return np.median(steps) if len(steps) else None, len(steps)


def _channel_figures(file, tables, full_scale, threads):
    names = [name for name in file.schema_arrow.names if name not in (TIME, LOGGED_TIME)]
    low, high = dict.fromkeys(names, np.inf), dict.fromkeys(names, -np.inf)
    step = dict.fromkeys(names, np.inf)
    sensors = {"acceleration": ACCELERATION, "angular_rate": ANGULAR_RATE}
    limits = {name: full_scale.get(sensor) for sensor, axes in sensors.items() for name in axes}
    clipped = {name: None if limit is None else 0 for name, limit in limits.items()}
    magnitude = dict.fromkeys(sensors, 0.0)
    # rows, mean and sum of squares about it of the force's magnitude, so far
    force = (0, 0.0, 0.0)

    # a damaged file may hold 1e306
    @np.errstate(over="ignore", invalid="ignore")
    def figures(table):
        x = {name: table[name].to_numpy() for name in names}
        finite = {name: np.sort(x[name][np.isfinite(x[name])]) for name in names}
        ends = {name: (each[0], each[-1]) for name, each in finite.items() if each.size}
        steps = {name: _smallest_step(finite[name]) for name in ends}
        at_limit = {
            name: int((np.abs(finite[name]) >= CLIPPED_SHARE * limit).sum())
            for name, limit in limits.items()
            if limit is not None
        }
        sizes = {
            sensor: np.sqrt(sum(x[name] ** 2 for name in axes)) for sensor, axes in sensors.items()
        }
        size = sizes["acceleration"]
        varied = len(size), size.mean(), size.var() * len(size)
        return (
            ends,
            steps,
            at_limit,
            {sensor: float(s.sum()) for sensor, s in sizes.items()},
            varied,
        )

    for ends, steps, at_limit, sizes, varied in in_order(figures, tables, threads):
        for name, (least, most) in ends.items():
            low[name], high[name] = min(low[name], least), max(high[name], most)
            step[name] = min(step[name], steps[name])
        clipped |= {name: clipped[name] + n for name, n in at_limit.items()}
        magnitude |= {sensor: magnitude[sensor] + size for sensor, size in sizes.items()}
        force = _pooled(force, varied)
    rows = file.metadata.num_rows
    # without a value there is none
    ranges = {
        name: [float(low[name]), float(high[name])] if low[name] <= high[name] else None
        for name in names
    }
    return {
        "clipped": clipped,
        "constant": [name for name in names if low[name] == high[name]],
        "range": ranges,
        "quantisation_step": {name: step[name] if step[name] < np.inf else None for name in names},
        "mean_specific_force": magnitude["acceleration"] / rows if rows else None,
        "specific_force_std": float(np.sqrt(force[2] / rows))
        if rows and np.isfinite(force[2])
        else None,
        "mean_angular_rate": magnitude["angular_rate"] / rows if rows else None,
        "temperature_range": ranges.get(TEMPERATURE),
    }


@np.errstate(over="ignore", invalid="ignore")
def _pooled(one, other):
    """Return number, mean and sum of squares about it of two parts together (Chan's update)."""
    n = one[0] + other[0]
    away = other[1] - one[1]
    return n, one[1] + away * other[0] / n, one[2] + other[2] + away**2 * one[0] * other[0] / n


def _smallest_step(x):
    """Return the smallest step of sorted values, infinite where most are distinct."""
    steps = np.diff(x)
    distinct = np.count_nonzero(steps) + 1
    if distinct < 2 or distinct > x.size / 2:
        return np.inf
    # closer than rounding of the conversion to SI is the same value
    return float(steps[steps > 1e-12 * np.abs(x[[0, -1]]).max()].min(initial=np.inf))


def reasons(figures, counts, bad_lines, lost_share=0.0):
    """Return why a log cannot be used, one text a reason; empty if it can.

    Parameters
    ----------
    figures : dict
        From `measure`.
    counts : Counts
        What became of the rows.
    bad_lines : int
        Lines that are no row.
    lost_share : float
        Share of a text's bytes that is in such lines: one can hold half of a log.
    """
    found = []
    lost = counts.non_finite + counts.duplicates + counts.out_of_order + bad_lines
    inside = counts.read - counts.outside + bad_lines
    if inside == 0 and counts.read:
        return [f"none of the log's {counts.read} rows lies in the time range"]
    if inside == 0:
        return ["the log has no rows"]
    if lost > MOST_DROPPED * inside:
        parts = (
            (counts.non_finite, "with missing or non-finite values" + _impossible(counts)),
            (counts.duplicates, "with a repeated stamp"),
            (counts.out_of_order, "with a stamp before an earlier one"),
            (bad_lines, "lines that are no row"),
        )
        listed = ", ".join(f"{count} {what}" for count, what in parts if count)
        found.append(
            f"{lost} of {inside} rows ({lost / inside:.1%}) cannot be used: {listed}; "
            f"at most {MOST_DROPPED:.0%} may be lost"
        )
    elif lost_share > MOST_DROPPED:
        found.append(
            f"{lost_share:.1%} of the log's bytes are in {bad_lines} lines that are no row; "
            f"at most {MOST_DROPPED:.0%} may be lost"
        )
    rate = figures["rate_hz"]
    if figures["rows"] < LEAST_ROWS:
        found.append(f"{figures['rows']} usable rows, at least {LEAST_ROWS} needed")
    elif rate and not PLAUSIBLE_RATE[0] <= rate <= PLAUSIBLE_RATE[1]:
        found.append(f"{rate:.3g} Hz is no rate of an IMU{_time_hint(rate)}")
    elif figures["duration_s"] < LEAST_DURATION:
        found.append(
            f"the log lasts {figures['duration_s']:.3g} s, at least {LEAST_DURATION:g} s needed"
            + (_time_hint(rate) if rate > 1e4 else "")
        )
    if figures["rows"] and set(ACCELERATION) <= set(figures["constant"]):
        found.append("the acceleration never changes: the sensor was not read")
    for name, least in LEAST_CHANGE.items():
        low, high = figures["range"][name] or (0.0, 0.0)
        if 0 < high - low < least:
            quantity = "acceleration" if name in ACCELERATION else "angular_rate"
            found.append(
                f"{name} changes by {high - low:.3g} in the whole log, which no sensor resolves: "
                f"see units.{quantity} and nominal.{quantity}"
            )
    return found


def _impossible(counts):
    """Name the channels with values that no sensor gives, and how many; empty without."""
    found = [f"{name} {count}" for name, count in counts.impossible_values.items() if count]
    beyond = f"beyond ± {BEYOND:g} in SI, which no sensor gives: {', '.join(found)}"
    return f" ({beyond}; see units and nominal)" if found else ""


def _time_hint(rate):
    """Name the time units, relative to the declared one, that would make a rate plausible."""
    factors = {"1000 times smaller": 1e3, "a million times smaller": 1e6, "1e9 times smaller": 1e9}
    factors |= {"1000 times larger": 1e-3, "a million times larger": 1e-6}
    fits = [text for text, factor in factors.items() if 1 <= rate * factor <= 1e4]
    return f"; a unit of time {' or '.join(fits)} would fit, see units.time" if fits else ""


def warnings(figures, counts, log, *, rate):
    """Return what a user should look at, though the log can be used.

    Parameters
    ----------
    figures : dict
        From `measure`.
    counts : Counts
        What became of the rows.
    log : RawLog
        The log, read to its end.
    rate : float or None
        Declared rate, Hz.
    """
    found = list(log.notes)
    if not figures["rows"]:
        return found
    dead = [name for name in figures["constant"] if name in CHANNELS]
    if dead:
        found.append(f"never changing: {', '.join(dead)}")
    at_limit = {name: n for name, n in figures["clipped"].items() if n}
    if at_limit:
        listed = ", ".join(f"{name} {n}" for name, n in at_limit.items())
        found.append(f"samples at the end of the full scale: {listed}")
    if figures["gaps"]["count"]:
        gaps = figures["gaps"]
        found.append(f"{gaps['count']} gaps, {gaps['total_s']:.4g} s together")
    if rate and figures["rate_hz"] and abs(figures["rate_hz"] / rate - 1) > 0.02:
        found.append(
            f"the stamps give {figures['rate_hz']:.4g} Hz, declared are {rate:g} Hz; stamps used"
        )
    if log.bad_lines and "time" not in log.found:
        found.append("lines that are no row shorten a log without stamps by one step each")
    if impossible := _impossible(counts):
        found.append(f"counted as missing{impossible}")
    missing = counts.missing_values.get(TEMPERATURE)
    if missing:
        found.append(f"{missing} temperatures are missing")
    return found + fault_lines.warnings(figures)
