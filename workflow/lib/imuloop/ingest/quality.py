"""How good a log is: steps of time, gaps, faults, plausibility, and whether it can be used."""

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from imuloop.core.errors import plural
from imuloop.core.gaps import gap_limit
from imuloop.core.samples import (
    ACCELERATION,
    ANGULAR_RATE,
    CHANNELS,
    TEMPERATURE,
    TIME,
    Samples,
)
from imuloop.core.units import TIME as TIME_SCALES
from imuloop.ingest import fault_lines, faults, misread
from imuloop.ingest.convert import BEYOND
from imuloop.ingest.increments import SENSORS
from imuloop.ingest.stamps import declare

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
# rows in which one sensor alone is zero are those of two sensors in turn if there are so many
IN_TURN = 0.9
# rates at which IMUs log, Hz
PLAUSIBLE_RATE = (0.05, 1e5)


def measure(columns, raw_units, full_scale=None):
    """Return the quality figures of samples, columns by name, as in quality.json.

    `raw_units` are the `RawUnit` of each sensor; `full_scale` holds ``acceleration`` (m/s^2) and
    ``angular_rate`` (rad/s), for clipping. What the rows cannot give is None. Under ``isolated``
    are row and channel of each spike to be dropped.
    """
    samples = Samples(columns)
    names = [name for name in (*CHANNELS, TEMPERATURE) if name in samples]
    figures = time_figures(samples[TIME]) | _channel_figures(samples, names, _scales(full_scale))
    found, isolated = faults.measure(samples, raw_units, figures)
    return {**figures, "faults": found, "isolated": isolated}


def time_figures(t):
    """Return the figures of the steps of time."""
    gaps = {"count": 0, "total_s": 0.0, "longer_than_s": None, "list": []}
    figures = {
        "rows": len(t),
        "duration_s": 0.0,
        "rate_hz": None,
        "jitter": {"std_s": None, "max_s": None},
        "gaps": gaps,
    }
    if len(t) < 2:
        return figures
    steps = np.diff(t)
    figures["duration_s"] = float(steps.sum())
    median = float(np.median(steps))
    limit = gaps["longer_than_s"] = gap_limit(median)
    wide = np.flatnonzero(steps > limit)
    gaps["count"], gaps["total_s"] = len(wide), float(steps[wide].sum())
    listed = wide[:LISTED_GAPS]
    listed = zip(t[listed].tolist(), steps[listed].tolist(), strict=True)
    gaps["list"] = [{"start_s": start, "duration_s": step} for start, step in listed]
    away, count = steps - median, len(steps) - gaps["count"]
    away[wide] = 0.0
    mean = away.sum() / count
    # infinite where the steps of a damaged file are 1e-318 s
    with np.errstate(over="ignore", divide="ignore"):
        figures["rate_hz"] = float(np.divide(1, median + mean))
    figures["jitter"] = {
        "std_s": float(np.sqrt(max(away @ away / count - mean**2, 0.0))),
        "max_s": float(max(away.max(), -away.min())),
    }
    return figures


def _scales(full_scale):
    """Return the full scale of each channel, SI, None where it is not declared."""
    return {n: (full_scale or {}).get(s) for s, axes in SENSORS.items() for n in axes}


# a damaged file may hold 1e306
@np.errstate(over="ignore", invalid="ignore")
def _channel_figures(samples, names, scales):
    """Return the figures of the channels, those of `names`; `scales` are as in `_scales`."""
    rows, x = len(samples), samples.read(names, 0, len(samples))
    # without a value there is neither an end nor a step
    ends = np.array([[(np.nan, np.nan, np.inf)] * len(names)])
    if rows:
        pieces = (columns for _, columns in samples.pieces(names))
        ends = np.array([[_levels(values) for values in columns] for columns in pieces])
    low, high = np.fmin.reduce(ends[..., 0]), np.fmax.reduce(ends[..., 1])
    step = ends[..., 2].min(axis=0)
    ranges = {
        name: [a, b] if a <= b else None
        for name, a, b in zip(names, low.tolist(), high.tolist(), strict=True)
    }
    clipped = [
        scale and np.count_nonzero(np.abs(values) >= CLIPPED_SHARE * scale)
        for values, scale in zip(x, scales.values(), strict=False)
    ]
    magnitudes = [
        float(np.sqrt(sum(v * v for v in axes)).mean()) if rows else None
        for axes in (x[:3], x[3:6])
    ]
    return {
        "clipped": dict(zip(scales, clipped, strict=True)),
        # one row changes nothing
        "constant": [n for n, ends in ranges.items() if rows > 1 and ends and ends[0] == ends[1]],
        "range": ranges,
        "quantisation_step": {
            name: float(each) if each < np.inf else None
            for name, each in zip(names, step, strict=True)
        },
        "mean_specific_force": magnitudes[0],
        "mean_angular_rate": magnitudes[1],
        "temperature_range": ranges.get(TEMPERATURE),
    }


def _levels(x):
    """Return the ends of values and their smallest step, infinite where most are distinct."""
    # a table of those seen takes a quarter of the time of a sort
    levels = pc.unique(pa.array(x)).to_numpy(zero_copy_only=False)
    levels = levels[np.isfinite(levels)]
    if not levels.size:
        return np.nan, np.nan, np.inf
    low, high, step = levels.min(), levels.max(), np.inf
    if 2 <= levels.size <= np.count_nonzero(np.isfinite(x)) / 2:
        steps = np.diff(np.sort(levels))
        # closer than rounding of the conversion to SI is the same value
        step = steps[steps > 1e-12 * max(abs(low), abs(high))].min(initial=np.inf)
    return low, high, step


def reasons(figures, counts, bad_lines, lost_share=0.0):
    """Return why a log cannot be used, one text per reason; empty if it can.

    `lost_share` is the share of a text's bytes that is in lines that are no row: one can hold half
    of a log.
    """
    found = []
    lost = counts.non_finite + counts.duplicates + counts.out_of_order + bad_lines + counts.spiked
    inside = counts.read - counts.outside - counts.identical + bad_lines
    if inside == 0 and counts.read:
        return [f"none of the log's {plural(counts.read, 'row')} lies in the time range"]
    if inside == 0:
        return ["the log has no rows"]
    if lost > MOST_DROPPED * inside:
        lacking = _listed({n: c for n, c in counts.missing_values.items() if n != TEMPERATURE})
        lacking = f" ({lacking})" if lacking else ""
        missing = f"with missing or non-finite values{lacking}{_impossible(counts)}"
        parts = (
            (counts.non_finite, missing),
            (counts.duplicates, "with a repeated stamp, see columns.time"),
            (counts.out_of_order, "with a stamp before an earlier one"),
            (bad_lines, "lines that are no row"),
            (counts.spiked, f"with a spike ({_listed(counts.spike_values)})"),
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
    elif figures["duration_s"] < LEAST_DURATION:
        found.append(
            f"the log lasts {figures['duration_s']:.3g} s, at least {LEAST_DURATION:g} s needed"
            + (_time_hint(rate, counts.time_unit) if rate > 1e4 else "")
        )
    if set(ACCELERATION) <= set(figures["constant"]):
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


def unread(figures, counts):
    """Return why stamps or rows are none: of such a log nothing else can be said."""
    if fault := counts.clock.fault() or misread.fault(counts):
        return [fault]
    faults, rows, rate = figures["faults"], figures["rows"], figures["rate_hz"]
    if rows >= LEAST_ROWS and rate and not PLAUSIBLE_RATE[0] <= rate <= PLAUSIBLE_RATE[1]:
        return [f"{rate:.3g} Hz is no rate of an IMU{_time_hint(rate, counts.time_unit)}"]
    turns = faults.get("in_turn", {"none": 0})
    if sum(turns.values()) > IN_TURN * rows and min(turns.values()) > MOST_DROPPED * rows:
        listed = " and ".join(f"{sensor} in {n} rows" for sensor, n in turns.items())
        return [
            f"exactly zero on all axes: {listed}, in turn: rows of two sensors, each with "
            "zeros for the other; leave these fields empty, or write a log for each sensor"
        ]
    failed = {n: count for n, count in faults.get("failed_reads", {}).items() if count}
    if failed and max(failed.values()) > MOST_DROPPED * rows:
        share = max(failed.values()) / rows
        often = "every other row holds" if abs(share - 0.5) < 0.02 else f"{share:.0%} of rows hold"
        return [
            f"{', '.join(failed)}: {often} the same value, an end of the range, zero or another, "
            "far from those between: failed reads; look at the bus, the driver and the read rate"
        ]
    return []


def rails(figures, full_scale=None):
    """Return the ends of the range that channels reach, SI: {channel: [low, high]}, None of none.

    A value there may be any beyond it: of quality figures the repeated extremes that were found,
    and the declared full scale, of ``acceleration`` and ``angular_rate``.
    """
    found = {}
    for sensor, axes in SENSORS.items():
        for name in axes:
            values = figures["faults"].get("clipped_at", {}).get(name, {"values": []})["values"]
            ends = [end if end in values else None for end in figures["range"][name] or ()]
            if figures["clipped"][name]:
                limit = CLIPPED_SHARE * full_scale[sensor]
                ends = [-limit, limit]
            if ends != [None, None]:
                found[name] = ends
    return {name: ends for name, ends in found.items() if ends}


def stuck(figures):
    """Return the spans in which a channel keeps one value, (n, 2), s: it shows nothing."""
    each = figures["faults"].get("stuck", {}).values()
    return sorted(span for channel in each for span in channel["spans_s"])


def _listed(by_channel):
    """Name the channels with a count, and how many; empty without."""
    return ", ".join(f"{name} {n}" for name, n in by_channel.items() if n)


def _impossible(counts):
    """Name the channels with values that no sensor gives, and how many; empty without."""
    found = _listed(counts.impossible_values)
    quantity = "acceleration" if found.startswith("a") else "angular_rate"
    beyond = f"beyond ± {BEYOND:g} in SI, which no sensor gives: {found}"
    return f" ({beyond}; see units.{quantity} and nominal.{quantity})" if found else ""


def _time_hint(rate, unit):
    """Name the units of the stamps that would make a rate, in the unit they have, plausible."""
    steps = rate * TIME_SCALES[unit] if unit in TIME_SCALES else 0.0
    fits = [name for name, scale in TIME_SCALES.items() if 1 <= steps / scale <= 1e4]
    if not fits:
        return ""
    return f": the stamps look like {' or '.join(fits)}; {declare(fits[0])}"


def warnings(figures, counts, log, *, rate):
    """Return what a user should look at, though the log, read to its end, can be used."""
    found = list(log.notes)
    if not figures["rows"] or unread(figures, counts):
        return found
    dead = [name for name in figures["constant"] if name in CHANNELS]
    if dead:
        found.append(f"never changing: {', '.join(dead)}")
    at_limit = {name: n for name, n in figures["clipped"].items() if n}
    if at_limit:
        listed = ", ".join(f"{name} {n}" for name, n in at_limit.items())
        found.append(
            f"samples at the end of the full scale: {listed}; rests, turns and moves with them are "
            "left out: choose a wider range or turn more slowly"
        )
    if figures["gaps"]["count"]:
        gaps = figures["gaps"]
        found.append(f"{plural(gaps['count'], 'gap')}, {gaps['total_s']:.4g} s together")
    if rate and figures["rate_hz"] and abs(figures["rate_hz"] / rate - 1) > 0.02:
        found.append(
            f"the stamps give {figures['rate_hz']:.4g} Hz, declared are {rate:g} Hz; stamps used"
        )
    if log.bad_lines and "time" not in log.found:
        found.append("lines that are no row shorten a log without stamps by one step each")
    if counts.identical:
        found.append(
            f"{plural(counts.identical, 'row')} identical to the one before, stamp and values: "
            "dropped, nothing is lost"
        )
    if counts.spiked:
        found.append(
            f"{plural(counts.spiked, 'row')} dropped for a spike that no body makes: "
            f"{_listed(counts.spike_values)}; check the wiring and the logger"
        )
    if impossible := _impossible(counts):
        found.append(f"counted as missing{impossible}")
    missing = counts.missing_values.get(TEMPERATURE)
    if missing:
        found.append(f"{missing} temperatures are missing")
    return found + fault_lines.warnings(figures)
