"""Increments of velocity and angle: divided by the interval that they are of, they are rates."""

import numpy as np

from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, GAP_STEPS, TIME
from imuloop.core.units import INCREMENTS
from imuloop.core.units import TIME as TIME_SCALES
from imuloop.ingest.raw_log import rechunked
from imuloop.ingest.stamps import stamp_values

SENSORS = {"acceleration": ACCELERATION, "angular_rate": ANGULAR_RATE}
# rows whose steps give one median; the same for any batches
_BLOCK = 1 << 17
# jitter of the stamps that is told, of a step: it becomes noise of the same share
_JITTER = 1e-3
# mean interval over mean step of the stamps beyond which their units are doubted
_ALIKE = (0.5, 2.0)


def factors(units):
    """Return sensor -> SI per unit, of the sensors that are logged as increments."""
    return {q: known[units[q]] for q, known in INCREMENTS.items() if units.get(q) in known}


def interval_column(sensor):
    """Return the name of a sensor's intervals in raw batches."""
    return f"interval.{sensor}"


def by_stamps(log, units):
    """Tell whether increments of a log are divided by the steps of its stamps."""
    return bool(factors(units)) and "time" in log.found and "interval" not in log.found


def usual_step(batches):
    """Return the median step of samples, s; None of fewer than two.

    Parameters
    ----------
    batches : iterable of pyarrow.RecordBatch
        With `t`.
    """
    medians, last = [], None
    for table in rechunked(batches, _BLOCK):
        t = table[TIME].to_numpy()
        steps = np.diff(t if last is None else np.concatenate(([last], t)))
        last = t[-1]
        if len(steps):
            medians.append((float(np.median(steps)), len(steps)))
    if not medians:
        return None
    values, weights = np.array(sorted(medians)).T
    return values[np.searchsorted(np.cumsum(weights), weights.sum() / 2)].item()


# stamps and values of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def steps(x, before, origin, scale, usual, constant):
    """Return the step that ends at each row, s, which row is the first, and which ends a gap.

    An increment is of one interval of the sensor, however many rows are lost before it: after a
    gap its interval is the usual step.

    Parameters
    ----------
    x, before : ndarray, shape (n,)
        Stamps, and the newest one before each.
    origin : number
        The log's first stamp.
    scale : float
        Seconds per unit of the stamps.
    usual : float or None
        Usual step, s.
    constant : float or None
        The step of every row, s, where stamps do not tell it.
    """
    none = np.zeros(len(x), dtype=bool)
    if constant:
        return np.full(len(x), constant), none, none
    # rows that do not go forward are dropped
    dt = np.where(x > before, (x - before) * scale, 1.0)
    wide = none if usual is None else dt > GAP_STEPS * usual
    return np.where(wide, usual or 1.0, dt), before < origin, wide


def intervals(batch, units, steps):
    """Return sensor -> interval of each row's increment, s: the logged one, else of `steps`.

    Parameters
    ----------
    batch : pyarrow.RecordBatch
        With the logged intervals, if any; not-a-number where none is readable.
    units : dict
        Units as logged.
    steps : ndarray, shape (n,)
        Step that ends at each row, s.
    """
    found = {}
    for sensor in factors(units):
        found[sensor] = steps
        if interval_column(sensor) in batch.schema.names:
            values, readable, _ = stamp_values(batch.column(interval_column(sensor)))
            dt = values * TIME_SCALES[units["interval"]]
            found[sensor] = np.where(readable & (values > 0), dt, np.nan)
    return found


def nanoseconds(intervals, keep):
    """Return the sum of the intervals of rows, whole ns: the same for any batches."""
    dt = next(iter(intervals.values()))[keep]
    return int(np.rint(np.minimum(dt, 1e6) * 1e9).sum())


@np.errstate(over="ignore", invalid="ignore")
def rates(raw, units, intervals):
    """Return the channels of increments, as logged, in SI per second."""
    return {
        name: raw[name] * factor / intervals[sensor]
        for sensor, factor in factors(units).items()
        for name in SENSORS[sensor]
    }


# intervals of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore")
def summed_intervals(batch, past):
    """Return stamps that are sums of the intervals, which are readable, and what goes on.

    A row without interval is not readable; the clock goes on by the last one.

    Parameters
    ----------
    batch : pyarrow.RecordBatch
        With a column of intervals.
    past : (number, number)
        Stamp and interval of the last row.
    """
    name = next(n for n in batch.schema.names if n.startswith(interval_column("")))
    values, readable, _ = stamp_values(batch.column(name))
    readable = readable & (values > 0)
    total, last = past
    rows = np.maximum.accumulate(np.where(readable, np.arange(1, len(values) + 1), 0))
    lasting = np.concatenate(([last], values)).astype(values.dtype)[rows]
    stamps = np.cumsum(np.concatenate(([total], lasting)).astype(values.dtype))[1:]
    return stamps, readable, (stamps[-1], lasting[-1]) if len(values) else past


def figures(log, units, counts, usual, step, rate):
    """Return what quality.json says of increments; None where there are none.

    Parameters
    ----------
    log : RawLog
        The log.
    units : dict
        Units as logged.
    counts : Counts
        After the last row.
    usual, step : float or None
        Usual step of the stamps; step of rows whose stamps were rebuilt, s.
    rate : float or None
        Declared rate, Hz.
    """
    sensors = factors(units)
    if not sensors:
        return None
    if "interval" in log.found:
        interval = "logged"
    elif "time" not in log.found:
        interval = f"1/({rate:g} Hz)" if rate else None
    else:
        interval = (
            "step of the rows, rebuilt" if step else "step of the stamps that ends at the row"
        )
    return {
        "sensors": {sensor: units[sensor] for sensor in sensors},
        "interval": interval,
        "usual_step_s": usual,
        "without_interval": counts.without_interval,
        "by_usual_step": counts.by_usual_step,
    }


def warnings(told, measured, counts):
    """Return how increments were treated, a line each.

    Parameters
    ----------
    told : dict or None
        From `figures`.
    measured : dict
        ``rate_hz`` and ``jitter`` of the samples.
    counts : Counts
        After the last row.
    """
    if not told or not measured["rate_hz"]:
        return []
    listed = " and ".join(f"{sensor} ({unit})" for sensor, unit in told["sensors"].items())
    line = f"increments of {listed} divided by their interval: {told['interval']}"
    if told["without_interval"]:
        line += f"; {told['without_interval']} at the start has none and is dropped"
    if told["by_usual_step"]:
        line += (
            f"; {told['by_usual_step']} after gaps are of one interval too, the usual step "
            f"{told['usual_step_s']:.6g} s"
        )
    found, rate, jitter = [line], measured["rate_hz"], measured["jitter"]["std_s"]
    if told["interval"].startswith("step of the stamps") and jitter * rate > _JITTER:
        found.append(
            f"the stamps jitter by {jitter * rate:.1%} of a step, which the increments turn into "
            "noise of that share of the signal: name columns.interval, or a clock of the sensor"
        )
    if told["interval"] == "logged" and counts.kept:
        mean = counts.intervals_ns * 1e-9 / counts.kept
        if not _ALIKE[0] <= mean * rate <= _ALIKE[1]:
            found.append(
                f"the interval is {mean:.3g} s in the mean, the step of the rows {1 / rate:.3g} s: "
                "see units.interval and units.time"
            )
    return found
