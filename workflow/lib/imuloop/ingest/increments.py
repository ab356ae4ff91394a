"""Logs of increments of velocity and angle: they are divided by their intervals."""

import numpy as np

from imuloop.core.gaps import gap_limit
from imuloop.core.units import INCREMENTS
from imuloop.core.units import TIME as TIME_SCALES
from imuloop.ingest.spellings import SENSORS

# largest jitter of time stamps without a warning, as a share of a step: the increments turn it into
# noise of this share of the signal
_JITTER = 1e-3
_BY_STAMPS = "step of the stamps that ends at the row"


def factors(units):
    """Return the factor to SI of each sensor that logs increments, a dict by quantity.

    An increment is the integral of a sensor's output over a short interval. `units` are the units
    of the log by quantity. A sensor that logs no increments is left out.
    """
    return {q: scales[units[q]] for q, scales in INCREMENTS.items() if units.get(q) in scales}


def are_by_stamps(rows):
    """Return whether increments in a log are divided by the steps of their time stamps.

    An increment is the integral of a sensor's output over a short interval. The result is false
    without increments, and if their intervals are logged. `rows` are the `Rows` of the log.
    """
    return bool(factors(rows.units)) and rows.stamped and "interval" not in rows.log.names


# stamps and values of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def rates(rows):
    """Return the increments of a log divided by their intervals, SI, two masks, and the usual step.

    An increment is the integral of a sensor's output over an interval. `rows` are the `Rows` of the
    log. The interval of a row is the logged one. If none is logged, it is the even step if time
    stamps were rebuilt, else the step from the time stamp before to the one of the row. An
    increment covers one interval of the sensor, even if rows before it are lost: after a gap its
    interval is the usual step.

    Returns
    -------
    values : dict of str to array
        Channels by name, (n,) each; not-a-number for a row without a readable interval.
    first, wide : array of bool, shape (n,)
        `first` is the mask of the rows at the start of the log, which have no interval. `wide` is
        the mask of the rows after a gap, whose interval is the usual step.
    usual : float or None
        Usual step of the time stamps, s; None if they are not needed.
    """
    first = wide = np.zeros(len(rows.x), dtype=bool)
    steps, values, usual = rows.even.step if rows.even else rows.scale, {}, None
    if are_by_stamps(rows):
        starts, dt = rows.before < rows.origin, (rows.x - rows.before) * rows.scale
        forward = rows.usable & (dt > 0)
        whole = dt[forward & ~starts][1:]
        usual = np.median(whole).item() if len(whole) else None
        if not rows.even:
            first, wide = starts, forward & (dt > gap_limit(usual or np.inf))
            # rows that do not go forward are dropped
            steps = np.where(wide, usual, np.where(forward, dt, 1.0))
    for sensor, factor in factors(rows.units).items():
        dt = steps
        if f"interval.{sensor}" in rows.stamps:
            logged, readable, _ = rows.stamps[f"interval.{sensor}"]
            scale = TIME_SCALES[rows.units["interval"]]
            dt = np.where(readable & (logged > 0), logged * scale, np.nan)
        values |= {name: rows.values[name] * factor / dt for name in SENSORS[sensor]}
    return values, first, wide, usual


def figures(rows, counts, usual):
    """Return the entry ``increments`` of quality.json, a dict; None if the log holds no increments.

    An increment is the integral of a sensor's output over a short interval. `rows` are the `Rows`
    of the log, `counts` their `Counts`, and `usual` is the usual step of the time stamps, s.
    """
    sensors = {sensor: rows.units[sensor] for sensor in factors(rows.units)}
    if "interval" in rows.log.names:
        interval = "logged"
    elif not rows.stamped:
        interval = rows.time_unit
    else:
        interval = "step of the rows, rebuilt" if rows.even else _BY_STAMPS
    entry = {"sensors": sensors, "interval": interval, "usual_step_s": usual}
    entry |= {name: getattr(counts, name) for name in ("without_interval", "by_usual_step")}
    return entry if sensors else None


def warnings(entry, measured):
    """Return the lines on increments for the user, a list; empty if the log has none.

    `entry` is the entry ``increments`` of quality.json, and `measured` are the quality figures of
    the samples.
    """
    if not entry or not measured["rate_hz"]:
        return []
    listed = " and ".join(f"{sensor} ({unit})" for sensor, unit in entry["sensors"].items())
    lines = [f"increments of {listed} divided by their interval: {entry['interval']}"]
    if entry["interval"] == _BY_STAMPS:
        line = "; {without_interval} at the start has none and is dropped"
        if entry["by_usual_step"]:
            line += ", {by_usual_step} after gaps are of the usual step {usual_step_s:.6g} s"
        lines[0] += line.format(**entry)
        share = measured["jitter"]["std_s"] * measured["rate_hz"]
        if share > _JITTER:
            lines.append(
                f"the stamps jitter by {share:.1%} of a step, which the increments turn into noise "
                "of that share of the signal: name columns.interval, or a clock of the sensor"
            )
    return lines
