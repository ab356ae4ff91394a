"""Increments of velocity and angle: divided by the interval that they are of, they are rates."""

import numpy as np

from imuloop.core.gaps import gap_limit
from imuloop.core.units import INCREMENTS
from imuloop.core.units import TIME as TIME_SCALES
from imuloop.ingest.spellings import SENSORS

# jitter of the stamps that is worth a warning, of a step: it becomes noise of the same share
_JITTER = 1e-3
_BY_STAMPS = "step of the stamps that ends at the row"


def factors(units):
    """Return sensor -> SI per unit, of the sensors that are logged as increments."""
    return {q: known[units[q]] for q, known in INCREMENTS.items() if units.get(q) in known}


def by_stamps(log, units):
    """Tell whether increments of a log are divided by the steps of its time stamps."""
    return bool(factors(units)) and "time" in log.found and "interval" not in log.found


# stamps and values of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def rates(rows, steps, units):
    """Return the channels of increments in SI per second, by name.

    `rows` are the `Rows` of a log. The interval is the logged one, not-a-number where none is
    readable, else that of `steps`, s, a number or an array (n,).
    """
    found = {}
    for sensor, factor in factors(units).items():
        dt = steps
        if f"interval.{sensor}" in rows.stamps:
            values, readable, _ = rows.stamps[f"interval.{sensor}"]
            known = readable & (values > 0)
            dt = np.where(known, values * TIME_SCALES[units["interval"]], np.nan)
        found |= {name: rows.values[name] * factor / dt for name in SENSORS[sensor]}
    return found


# stamps of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def intervals(dt, usual):
    """Return the interval of each row, s, and which rows end a gap, from time steps dt, s, (n,).

    An increment is of one interval of the sensor, however many rows are lost before it: after a gap
    it is the `usual` step, s.
    """
    # rows that do not go forward are dropped
    dt = np.where(dt > 0, dt, 1.0)
    wide = dt > gap_limit(usual) if usual else np.zeros(len(dt), dtype=bool)
    return np.where(wide, usual or 1.0, dt), wide


def figures(log, units, counts, rows):
    """Return what quality.json says of increments; None where there are none.

    `rows` are the `Rows` of the log.
    """
    sensors = {sensor: units[sensor] for sensor in factors(units)}
    if not sensors:
        return None
    interval = "step of the rows, rebuilt" if rows.even else _BY_STAMPS
    if "interval" in log.found or not rows.stamped:
        interval = "logged" if "interval" in log.found else rows.time_unit
    return {
        "sensors": sensors,
        "interval": interval,
        "usual_step_s": rows.usual,
        "without_interval": counts.without_interval,
        "by_usual_step": counts.by_usual_step,
    }


def warnings(done, measured):
    """Return how increments were treated (from `figures`), a line each."""
    if not done or not measured["rate_hz"]:
        return []
    listed = " and ".join(f"{sensor} ({unit})" for sensor, unit in done["sensors"].items())
    line = f"increments of {listed} divided by their interval: {done['interval']}"
    if done["without_interval"]:
        line += f"; {done['without_interval']} at the start has none and is dropped"
    if done["by_usual_step"]:
        line += f"; {done['by_usual_step']} after gaps are of one interval too, the usual step "
        line += f"{done['usual_step_s']:.6g} s"
    found, share = [line], measured["jitter"]["std_s"] * measured["rate_hz"]
    if done["interval"] == _BY_STAMPS and share > _JITTER:
        found.append(
            f"the stamps jitter by {share:.1%} of a step, which the increments turn into noise of "
            "that share of the signal: name columns.interval, or a clock of the sensor"
        )
    return found
