"""Increments of velocity and angle: divided by the interval that they are of, they are rates."""

import numpy as np

from imuloop.core.gaps import gap_limit
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.core.units import INCREMENTS
from imuloop.core.units import TIME as TIME_SCALES

SENSORS = {"acceleration": ACCELERATION, "angular_rate": ANGULAR_RATE}
# jitter of the stamps that is worth a warning, of a step: it becomes noise of the same share
_JITTER = 1e-3


def factors(units):
    """Return sensor -> SI per unit, of the sensors that are logged as increments."""
    return {q: known[units[q]] for q, known in INCREMENTS.items() if units.get(q) in known}


def by_stamps(log, units):
    """Tell whether increments of a log are divided by the steps of its stamps."""
    return bool(factors(units)) and "time" in log.found and "interval" not in log.found


def usual_step(t):
    """Return the median step of samples at `t`, s; None of fewer than two."""
    return float(np.median(np.diff(t))) if len(t) > 1 else None


# stamps and values of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def steps(x, before, origin, scale, usual, constant):
    """Return the step that ends at each row, s, which row is the first, and which ends a gap.

    `x` are stamps of `scale` s each, `before` the newest one before each, `origin` the log's first
    one. An increment is of one interval of the sensor, however many rows are lost before it: after
    a gap its interval is the `usual` step. Where stamps do not give it, it is `constant`.
    """
    none = np.zeros(len(x), dtype=bool)
    if constant:
        return np.full(len(x), constant), none, none
    # rows that do not go forward are dropped
    dt = np.where(x > before, (x - before) * scale, 1.0)
    wide = none if usual is None else dt > gap_limit(usual)
    return np.where(wide, usual or 1.0, dt), before < origin, wide


@np.errstate(over="ignore", invalid="ignore")
def rates(raw, stamps, units, steps):
    """Return the channels of increments in SI per second.

    The interval is the one among the logged `stamps`, not-a-number where none is readable, else
    that of `steps`.
    """
    found = {}
    for sensor, factor in factors(units).items():
        dt = steps
        if f"interval.{sensor}" in stamps:
            values, readable, _ = stamps[f"interval.{sensor}"]
            dt = values * TIME_SCALES[units["interval"]]
            dt = np.where(readable & (values > 0), dt, np.nan)
        found |= {name: raw[name] * factor / dt for name in SENSORS[sensor]}
    return found


def figures(log, units, counts, usual, rebuilt, rate):
    """Return what quality.json says of increments; None where there are none.

    `usual` is the usual step of the stamps, s; `rebuilt` tells whether they were rebuilt; `rate` is
    the declared one, Hz.
    """
    sensors = {sensor: units[sensor] for sensor in factors(units)}
    if not sensors:
        return None
    interval = "step of the rows, rebuilt" if rebuilt else "step of the stamps that ends at the row"
    if "interval" in log.found:
        interval = "logged"
    elif "time" not in log.found:
        interval = f"1/({rate:g} Hz)" if rate else None
    return {
        "sensors": sensors,
        "interval": interval,
        "usual_step_s": usual,
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
        line += (
            f"; {done['by_usual_step']} after gaps are of one interval too, the usual step "
            f"{done['usual_step_s']:.6g} s"
        )
    found, rate, jitter = [line], measured["rate_hz"], measured["jitter"]["std_s"]
    if done["interval"].startswith("step of the stamps") and jitter * rate > _JITTER:
        found.append(
            f"the stamps jitter by {jitter * rate:.1%} of a step, which the increments turn into "
            "noise of that share of the signal: name columns.interval, or a clock of the sensor"
        )
    return found
