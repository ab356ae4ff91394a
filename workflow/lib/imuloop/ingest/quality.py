"""The quality figures of a log: steps of time, gaps, ranges, and the faults of its channels.

The table of `checks` turns them into lines for the user.
"""

from itertools import combinations

import numpy as np
import pandas as pd

from imuloop.core.gaps import gap_limit
from imuloop.core.samples import (
    ACCELERATION,
    ANGULAR_RATE,
    CHANNELS,
    OWN_TIME,
    ROWS,
    SENSORS,
    TEMPERATURE,
    TIME,
    own_rows,
)
from imuloop.ingest import channel, spikes
from imuloop.ingest.channel import Channel
from imuloop.ingest.increments import SENSORS as QUANTITIES
from imuloop.ingest.rests import measure_turns

# most gaps in the list of gaps; all gaps are counted
LISTED_GAPS = 50
# a sample is clipped if it reaches this share of the declared full scale
CLIPPED_SHARE = 0.98
# shortest gap in which a device may be turned, s
TURN_GAP = 0.2
# rate above any sensor, Hz: stamps of a damaged file may lie 1e-300 s apart
FASTEST = 1e9


# values of a damaged file can be of any size
@np.errstate(all="ignore")
def measure(columns, raw_units, full_scale=None):
    """Return the quality figures of samples, as in quality.json.

    The figures of a sensor with a slower clock use the rows with its new samples.

    Parameters
    ----------
    columns : dict of str to array
        Samples, (n,) each, by name of the column.
    raw_units : dict of str to RawUnit
        Unit of each sensor in the log by quantity.
    full_scale : dict, optional
        Full scale by quantity, m/s^2 and rad/s.

    Returns
    -------
    dict
        A figure is None if the rows do not show it. ``isolated`` has the rows and the channel
        numbers of k spikes to be dropped, two arrays of shape (k,).
    """
    t, scales = columns[TIME], full_scale or {}
    names = [name for name in (*CHANNELS, TEMPERATURE) if name in columns]
    ranges = {name: _range(columns[name]) for name in names}
    figures = time_figures(t) | {
        "clipped": {
            n: int(np.sum(np.abs(columns[n]) >= CLIPPED_SHARE * scales[q])) if q in scales else None
            for q, axes in QUANTITIES.items()
            for n in axes
        },
        # in a single row no channel can change
        "constant": [n for n, ends in ranges.items() if len(t) > 1 and ends and not np.ptp(ends)],
        "range": ranges,
        "quantisation_step": {name: quantisation_step(columns[name]) for name in names},
        "mean_specific_force": _mean_size(columns, ACCELERATION),
        "mean_angular_rate": _mean_size(columns, ANGULAR_RATE),
        "temperature_range": ranges.get(TEMPERATURE),
        "faults": {},
        "isolated": np.empty((2, 0), dtype=int),
    }
    if 0 < (figures["rate_hz"] or 0) < FASTEST:
        zeros = {
            n: -raw_units[q].offset * raw_units[q].scale for q, a in QUANTITIES.items() for n in a
        }
        figures |= _faults(columns, names, zeros, figures)
    return figures


def _mean_size(columns, axes):
    """Return the mean magnitude of the vectors in the columns `axes`; None for an empty log."""
    x = [columns[name] for name in axes]
    # the sum goes part by part, which needs little memory
    parts = [slice(i, i + ROWS) for i in range(0, len(x[0]), ROWS)]
    sizes = [np.sqrt(sum(axis[part] ** 2 for axis in x)).sum() for part in parts]
    return float(sum(sizes) / len(x[0])) if sizes else None


def time_figures(t):
    """Return the figures of the steps of times t, s, (n,), a dict as in quality.json."""
    gaps = {"count": 0, "total_s": 0.0, "longer_than_s": None, "list": []}
    jitter = {"std_s": None, "max_s": None}
    figures = {"rows": len(t), "duration_s": 0.0, "rate_hz": None, "jitter": jitter, "gaps": gaps}
    if len(t) < 2:
        return figures
    steps = np.diff(t)
    median = float(np.median(steps))
    limit = gaps["longer_than_s"] = gap_limit(median)
    wide = np.flatnonzero(steps > limit)
    gaps["count"], gaps["total_s"] = len(wide), float(steps[wide].sum())
    gaps["list"] = [
        {"start_s": float(t[i]), "duration_s": float(steps[i])} for i in wide[:LISTED_GAPS]
    ]
    duration, away = float(steps.sum()), np.delete(steps, wide) if len(wide) else steps
    away -= median
    mean = away.mean()
    # infinite where the steps of a damaged file are 1e-318 s
    figures |= {"duration_s": duration, "rate_hz": float(np.divide(1, median + mean))}
    jitter["std_s"] = float(np.sqrt(max(away @ away / len(away) - mean**2, 0.0)))
    jitter["max_s"] = float(max(away.max(), -away.min()))
    return figures


def _range(x):
    """Return the least and the largest value of a channel, None if it has no value."""
    ends = [float(np.fmin.reduce(x)), float(np.fmax.reduce(x))] if len(x) else [np.nan]
    return ends if np.isfinite(ends).all() else None


def quantisation_step(x):
    """Return the smallest step between values of x, (n,), or None if most values are distinct."""
    # only the first part of a long log is used
    x = x[:ROWS][np.isfinite(x[:ROWS])]
    levels = np.sort(pd.unique(x))
    if not 2 <= len(levels) <= len(x) / 2:
        return None
    steps = np.diff(levels)
    # values that differ by the rounding of the conversion to SI are the same value
    steps = steps[steps > 1e-12 * np.abs(levels).max()]
    return float(steps.min()) if len(steps) else None


def _faults(columns, names, zeros, figures):
    """Return the figures ``faults``, ``isolated`` and, with two clocks, ``slower`` of samples.

    `names` are the names of the channels among the `columns`. `zeros` are the SI values of raw
    zeros by channel, and `figures` are the other quality figures.
    """
    t, x = columns[TIME], {name: columns[name] for name in names}
    steps = {name: step or 0.0 for name, step in figures["quantisation_step"].items()}
    # the rows with a new sample of each sensor, and its rate
    rows, rates = dict.fromkeys(SENSORS, slice(None)), dict.fromkeys(SENSORS, figures["rate_hz"])
    added, groups = {}, [(slice(None), CHANNELS)]
    for sensor in (each for each, stamps in OWN_TIME.items() if stamps in columns):
        rows[sensor] = first = own_rows(columns[OWN_TIME[sensor]])
        rate = time_figures(columns[OWN_TIME[sensor]][first])["rate_hz"]
        added["slower"] = {"sensor": sensor, "rate_hz": rate, "rows": len(first)}
        rates[sensor] = rate or figures["rate_hz"]
        groups = [(rows[name], axes) for name, axes in SENSORS.items()]
    single = np.hstack([_isolated(x, steps, *group) for group in groups])
    zero = [np.all([x[n] == zeros[n] for n in axes], axis=0) for axes in SENSORS.values()]
    # a gyroscope at rest may show three zeros, an accelerometer never does
    padding = zero[0], zero[0] & zero[1]
    faults = {
        "zero_rows": dict(zip(QUANTITIES, map(np.count_nonzero, padding), strict=True)),
        "copies": [
            [one, other]
            for one, other in combinations(names, 2)
            if one not in figures["constant"] and np.array_equal(x[one], x[other])
        ],
        "rows_a_value": {},
        "silent_at_rest": [],
    } | {name: {} for name in ("failed_reads", "stuck", "spikes", "wraps", "clipped_at")}
    for k, (sensor, (quantity, axes)) in enumerate(zip(SENSORS, QUANTITIES.items(), strict=True)):
        at, rate = rows[sensor], rates[sensor]
        if padding[k].any():
            x |= {name: np.where(padding[k], np.nan, x[name]) for name in axes}
        channels = {n: Channel(x[n][at], steps[n], *figures["range"][n]) for n in axes}
        silent = channel.silent(channels, [columns[n][at] for n in ACCELERATION])
        clipped = channel.saturation(channels, rate)
        is_zero = zero[k][at]
        alone = np.count_nonzero(is_zero[1:-1] & ~is_zero[:-2] & ~is_zero[2:])
        alone = alone if alone > channel.OFTEN * len(is_zero) else 0
        for name, c in channels.items():
            # neither a silent channel nor a saturated channel at an end of its range is stuck
            ends = clipped[name]["values"]
            stuck = [run for run in c.stuck if name not in silent and c.x[run[0]] not in ends]
            faults["failed_reads"][name] = alone or c.failed_reads
            faults["stuck"][name] = _stuck(stuck, t[at], rate)
            faults["spikes"][name] = c.jumps
            faults["wraps"][name] = len(c.wraps)
            # the values at a wrap of an integer are wrong
            if len(c.wraps):
                x[name] = x[name].copy()
                x[name][np.arange(len(t))[at][np.append(c.wraps, c.wraps + 1)]] = np.nan
        faults["clipped_at"] |= clipped
        faults["rows_a_value"][quantity] = channel.rows_a_value(channels.values())
        faults["silent_at_rest"] += silent
    if TEMPERATURE in x:
        size = channel.jump_sizes(x[TEMPERATURE])
        jumps = spikes.count_jumps(x[TEMPERATURE], steps[TEMPERATURE], size)
        faults["spikes"][TEMPERATURE] = jumps
    long = np.diff(t)
    gaps = np.flatnonzero(long > max(figures["gaps"]["longer_than_s"], TURN_GAP))
    # lost rows make the mean rate less than the usual step says
    rate = (len(t) - 1 - len(gaps)) / (figures["duration_s"] - long[gaps].sum())
    faults["axes"], faults["rests"] = measure_turns(x, np.fmin(rate, FASTEST), t, gaps)
    return {"faults": faults, "isolated": single} | added


def _isolated(x, steps, at, names):
    """Return the rows and the channel numbers of the spikes in the channels `names`, (2, k).

    `x` are the channels and `steps` their quantisation steps, by name. `at` are the rows with a new
    sample. A spike counts in all rows that hold it.
    """
    found = spikes.isolated([x[n][at] for n in names], [steps[n] for n in names])
    edges = np.append(np.arange(len(x["ax"]))[at], len(x["ax"]))
    numbers = [CHANNELS.index(name) for name in names]
    held = [(row, numbers[k]) for i, k in found.T for row in range(edges[i], edges[i + 1])]
    return np.array(held, dtype=int).reshape(-1, 2).T


def _stuck(runs, t, rate):
    """Return the figure ``stuck`` of a channel, a dict.

    `runs` are the stuck runs, a list of (first row, number of rows). `t` are the times of the rows,
    s, (n,), and `rate` is their rate, Hz.
    """
    spans = [[t[i].item(), t[i + n - 1].item()] for i, n in runs]
    return {
        "stretches": len(runs),
        "rows": sum(n for _, n in runs),
        "longest_s": max((n for _, n in runs), default=0) / rate,
        "first_s": spans[0][0] if spans else None,
        "spans_s": spans,
    }


def rails(figures, full_scale=None):
    """Return the ends of the range that channels reach, SI: {channel: [low, high]}.

    The true value of a sample at an end lies at the end or beyond. If clipped samples reach the
    declared `full_scale`, both ends are at its share `CLIPPED_SHARE`. Otherwise they are the
    saturated ends in the `figures`, with None for an end that is not saturated.
    """
    ends, found = {}, figures["faults"].get("clipped_at", {})
    for name, limits in figures["range"].items():
        if figures["clipped"].get(name):
            limit = CLIPPED_SHARE * full_scale["acceleration" if name[0] == "a" else "angular_rate"]
            ends[name] = [-limit, limit]
        elif values := found.get(name, {}).get("values"):
            ends[name] = [end if end in values else None for end in limits]
    return ends


def stuck(figures):
    """Return the time spans in which a channel is stuck, a list of [first, last], s."""
    each = figures["faults"].get("stuck", {}).values()
    return sorted(span for channel in each for span in channel["spans_s"])
