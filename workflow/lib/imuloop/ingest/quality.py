"""The quality figures of a log: steps of time, gaps, ranges, and the faults of its channels.

The table of `checks` turns them into lines for the user.
"""

from itertools import combinations

import numpy as np

from imuloop.core.gaps import gap_limit
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, CHANNELS, TEMPERATURE, TIME
from imuloop.ingest import channel
from imuloop.ingest.channel import Channel, new_rows, quantisation_step
from imuloop.ingest.rests import measure_turns
from imuloop.ingest.spellings import SENSORS
from imuloop.ingest.stamps import PLAUSIBLE_RATE

# most gaps in the list of gaps; all gaps are counted
LISTED_GAPS = 50
# a sample is clipped if it reaches this share of the declared full scale
CLIPPED_SHARE = 0.98


# values of a damaged file can be of any size
@np.errstate(all="ignore")
def measure(columns, raw_units, full_scale, absent=None):
    """Return the quality figures of samples, a dict as in quality.json.

    If a sensor has a slower clock, rows repeat its samples; its figures use each sample once. A
    figure is None if it cannot be known from the samples, as the rate of a log with one row.
    ``faults`` is empty if the rate is not within `PLAUSIBLE_RATE`.

    Parameters
    ----------
    columns : dict of str to array
        Samples, (n,) each, by name of the column.
    raw_units : dict of str to RawUnit
        Unit of each sensor in the log by quantity.
    full_scale : dict
        Full scale by quantity, m/s^2 and rad/s.
    absent : str, optional
        Quantity of a sensor that the log lacks; its columns are zero.
    """
    t, limits = columns[TIME], _limits(full_scale)
    names = [name for name in (*CHANNELS, TEMPERATURE) if name in columns]
    ranges = {name: _range(columns[name]) for name in names}
    ranges |= dict.fromkeys(SENSORS[absent] if absent else ())
    figures = time_figures(t) | {
        "clipped": {
            name: int(np.sum(np.abs(columns[name]) >= limits[name])) if name in limits else None
            for name in CHANNELS
        },
        # in a single row no channel can change
        "constant": [n for n, ends in ranges.items() if len(t) > 1 and ends and not np.ptp(ends)],
        "range": ranges,
        "quantisation_step": {name: quantisation_step(columns[name]) or None for name in names},
        "mean_specific_force": _mean_size(columns, ACCELERATION),
        "mean_angular_rate": _mean_size(columns, ANGULAR_RATE),
        "temperature_range": ranges.get(TEMPERATURE),
        "faults": {},
    }
    low, high = PLAUSIBLE_RATE
    if low <= (figures["rate_hz"] or 0) <= high:
        figures["faults"] = _faults(columns, raw_units, absent, figures)
    return figures


# times of a damaged file can be of any size
@np.errstate(all="ignore")
def time_figures(t):
    """Return the figures of the n times of a log, a dict as in quality.json: rate, jitter and gaps.

    `t` are the times, s, (n,).
    """
    gaps = {"count": 0, "total_s": 0.0, "longer_than_s": None, "list": []}
    jitter = {"std_s": None, "max_s": None}
    figures = {"rows": len(t), "duration_s": 0.0, "rate_hz": None, "jitter": jitter, "gaps": gaps}
    if len(t) < 2:
        return figures
    steps = np.diff(t)
    usual = float(np.median(steps))
    limit = gaps["longer_than_s"] = gap_limit(usual)
    wide = np.flatnonzero(steps > limit)
    gaps["count"], gaps["total_s"] = len(wide), float(steps[wide].sum())
    gaps["list"] = [
        {"start_s": float(t[i]), "duration_s": float(steps[i])} for i in wide[:LISTED_GAPS]
    ]
    away = np.delete(steps, wide) - usual
    jitter["std_s"], jitter["max_s"] = float(away.std()), float(np.abs(away).max())
    # infinite where the steps of a damaged file are 1e-318 s
    rate = float(np.divide(1, usual + away.mean()))
    return figures | {"duration_s": float(steps.sum()), "rate_hz": rate}


def _limits(full_scale):
    """Return the magnitude from which on a sample counts as clipped, SI, a dict by channel.

    `full_scale` is the full scale by quantity, SI; channels without one are left out.
    """
    return {n: CLIPPED_SHARE * limit for q, limit in full_scale.items() for n in SENSORS[q]}


def _mean_size(columns, axes):
    """Return the mean magnitude of the vectors in three columns of samples; None for an empty log.

    `columns` are the samples, (n,) by name, and `axes` the names of the columns x, y and z.
    """
    size = np.sqrt(sum(columns[name] ** 2 for name in axes))
    return float(size.mean()) if len(size) else None


def _range(x):
    """Return the least and the largest value of a channel, a list; None if none is finite.

    `x` are the samples of the channel, (n,).
    """
    ends = [float(np.fmin.reduce(x)), float(np.fmax.reduce(x))] if len(x) else [np.nan]
    return ends if np.isfinite(ends).all() else None


def _faults(columns, raw_units, absent, figures):
    """Return the entry ``faults`` of quality.json, a dict: the faults of the values of samples.

    `columns` are the samples, (n,) by name, `raw_units` the unit of each sensor in the log, and
    `absent` the quantity of a sensor that the log lacks, or None. `figures` are the quality figures
    that `measure` has so far. Rows of zeros of the gyroscope count only where the accelerometer is
    zero, too, because a gyroscope at rest may show three zeros. A silent channel does not count as
    stuck, nor does a saturated one at an end of its range.
    """
    t, x, padding = columns[TIME], {**columns}, True
    faults = {
        "zero_rows": {},
        "copies": [
            [one, other]
            for one, other in combinations(figures["range"], 2)
            if np.ptp(figures["range"][one] or 0.0) and np.array_equal(x[one], x[other])
        ],
        "rows_a_value": {},
        "silent_at_rest": [],
    } | {name: {} for name in ("failed_reads", "stuck", "wraps", "clipped_at")}
    for quantity, axes in SENSORS.items():
        rows = new_rows(columns, axes)
        zero = np.all([x[name] == raw_units[quantity].to_si(0.0) for name in axes], axis=0)
        # a gyroscope at rest may show three zeros, an accelerometer never does
        padding = padding & zero
        faults["zero_rows"][quantity] = 0 if quantity == absent else int(np.count_nonzero(padding))
        if padding.any():
            x |= {name: np.where(padding, np.nan, x[name]) for name in axes}
        steps = figures["quantisation_step"]
        channels = {name: Channel(x[name][rows], steps[name] or 0.0) for name in axes}
        silent = [name for name, c in channels.items() if c.is_silent]
        alone = channel.count_alone(zero[rows])
        for name, c in channels.items():
            # neither a silent channel nor a saturated channel at an end of its range is stuck
            runs = [run for run in c.stuck if name not in silent and c.x[run[0]] not in c.ends]
            spans = [[float(t[rows][i]), float(t[rows][i + n - 1])] for i, n in runs]
            faults["stuck"][name] = {"rows": sum(n for _, n in runs), "spans_s": spans}
            faults["failed_reads"][name] = alone or c.failed_reads
            faults["clipped_at"][name] = {"values": [*c.ends], "rows": sum(c.ends.values())}
            faults["wraps"][name] = len(c.wraps)
            # the values at a wrap of an integer are wrong
            if len(c.wraps):
                x[name] = x[name].copy()
                x[name][np.arange(len(t))[rows][np.append(c.wraps, c.wraps + 1)]] = np.nan
        faults["rows_a_value"][quantity] = channel.rows_a_value(channels.values())
        faults["silent_at_rest"] += silent
    faults["axes"], faults["rests"] = measure_turns(x, t)
    return faults


def rails(figures, full_scale):
    """Return the ends of the range at which channels are clipped, SI, {channel: [low, high]}.

    The true value of a sample at an end lies at the end or beyond. If samples of a channel reach
    the declared `full_scale`, both ends are at its share `CLIPPED_SHARE`. Otherwise they are the
    saturated ends in the quality `figures`, with None for an end that is not saturated. Channels
    that are not clipped are left out.
    """
    ends, limits = {}, _limits(full_scale)
    saturated = figures["faults"].get("clipped_at", {})
    for name, span in figures["range"].items():
        if figures["clipped"].get(name):
            ends[name] = [-limits[name], limits[name]]
        elif values := saturated.get(name, {}).get("values"):
            ends[name] = [end if end in values else None for end in span]
    return ends


def stuck(figures):
    """Return the time spans in which any channel is stuck at one value, a list of [first, last], s.

    `figures` are the quality figures of the log, as `measure` returns them.
    """
    channels = figures["faults"].get("stuck", {}).values()
    return sorted(span for channel in channels for span in channel["spans_s"])
