"""Devices of one to three harmed sessions, each made of its number alone."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from bench.fuzz.chain.harm import HARMS, other_kind
from bench.fuzz.chain.log import MOST_ROWS, SENSORS, UNITS, Log
from bench.fuzz.chain.recordings import FAMILIES, recording
from imuloop.core.units import STANDARD_GRAVITY

NAMES = ("t", "ax", "ay", "az", "gx", "gy", "gz")
# units of time, in s
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


@dataclass(frozen=True)
class Case:
    """A device to run the chain on.

    Attributes
    ----------
    number : int
        Of the case.
    entry : dict
        The device in a config.
    told : tuple of str
        What each session was made of, and its harms.
    """

    number: int
    entry: dict
    told: tuple


def make(number, folder):
    """Write the logs of a case into a folder and return the Case.

    Raises
    ------
    NotAtHand
        If it is made of a recording that this machine does not have.
    """
    rng = np.random.default_rng(number)
    family = FAMILIES[rng.integers(len(FAMILIES))]
    name = family[rng.integers(len(family))]
    first = recording(name)
    units = {sensor: ["SI", "count", "other"][rng.integers(3)] for sensor in SENSORS}
    written = {
        sensor: {"SI": next(iter(UNITS[sensor])), "count": "count"}.get(
            unit, list(UNITS[sensor])[rng.integers(1, len(UNITS[sensor]))]
        )
        for sensor, unit in units.items()
    }
    nominal, sessions, told = {}, {}, []
    for k in range(rng.choice([1, 2, 3], p=[0.6, 0.25, 0.15])):
        if k and rng.random() < 0.3:
            family = FAMILIES[rng.integers(len(FAMILIES))]
        if k and rng.random() < 0.5:
            name = family[rng.integers(len(family))]
        log = stretch(rng, recording(name), first.count, written)
        harms = harm(rng, log)
        nominal |= {
            key.removeprefix("nominal."): log.declared.pop(key)
            for key in list(log.declared)
            if key.startswith("nominal.")
        }
        path, declared = write(rng, log, folder / f"log {k}")
        kind = log.kind
        sessions[f"session_{k + 1}"] = {"kind": kind, "file": str(path), **declared}
        listed = "; ".join(harms) or "no harm"
        told.append(f"{name} as {kind} ({path.name}, {declared['units']}): {listed}")
    counts = {s for each in sessions.values() for s in SENSORS if is_count(each, s)}
    nominal = {sensor: nominal.get(sensor, first.count[sensor]) for sensor in sorted(counts)}
    gravity = first.gravity if rng.random() < 0.7 else STANDARD_GRAVITY
    entry = {"gravity": gravity, "nominal": nominal, "sessions": sessions}
    return Case(number, entry, tuple(told))


def is_count(session, sensor):
    return session["units"][sensor] == "count"


def stretch(rng, source, count, written):
    """Return a minute or two of a recording, or all of it thinned."""
    n = len(source.t)
    if rng.random() < 0.5:
        rate = (n - 1) / (source.t[-1] - source.t[0])
        rows = int(min(max(rng.uniform(60, 120) * rate, 2000), MOST_ROWS))
        first = 0 if rng.random() < 0.3 else int(rng.integers(0, max(n - rows, 1)))
        rows = slice(first, first + rows)
    else:
        rows = slice(0, None, -(-n // MOST_ROWS) * int(rng.choice([1, 1, 2])))
    log = Log(
        kind=source.kind,
        t=source.t[rows] - source.t[rows][0],
        x={"acceleration": source.f[rows].copy(), "angular_rate": source.w[rows].copy()},
        temperature=None if source.temperature is None else source.temperature[rows].copy(),
        count=count,
        written=dict(written),
        declared=dict(written),
    )
    if rng.random() < 0.3:
        other_kind(rng, log)
    return log


def harm(rng, log):
    """Do harm to a log; return what was done."""
    told = []
    for _ in range(rng.choice([0, 1, 1, 1, 2, 2, 3, 5], p=[0.04] + [0.96 / 7] * 7)):
        if len(log):
            each = HARMS[rng.integers(len(HARMS))]
            with np.errstate(all="ignore"):
                told.append(f"{each.__name__} {each(rng, log)}".rstrip())
    return told


def write(rng, log, stem):
    """Write a log; return its path and how it is declared."""
    columns, units = {}, dict(log.declared)
    time = list(TIMES)[rng.integers(4)] if rng.random() < 0.4 else "s"
    if log.rate is None:
        columns["t"] = stamps(log.t, time)
        units["time"] = time
    for sensor, names in zip(SENSORS, (NAMES[1:4], NAMES[4:]), strict=True):
        values = logged(log, sensor)
        columns |= dict(zip(names, values.T, strict=True))
    if log.temperature is not None:
        columns["temp"] = log.temperature
    table = pd.DataFrame(columns)
    declared = {"units": units} | ({} if log.rate is None else {"rate": log.rate})
    if not log.lines and rng.random() < 0.6:
        path = stem.with_suffix(".parquet")
        table.to_parquet(path, index=False)
        return path, declared
    path = stem.with_suffix(".csv")
    lines = table.to_csv(index=False).splitlines(keepends=True)
    for share, text in log.lines:
        lines.insert(1 + int(share * len(table)), f"{text}\n")
    path.write_text("".join(lines))
    return path, declared


def stamps(t, unit):
    """Return times in a unit, whole numbers but for s where they can be."""
    with np.errstate(all="ignore"):
        t = t / TIMES[unit]
    if unit == "s" or not (np.abs(t) < 2**62).all():
        return t
    return np.round(t).astype(np.int64)


def logged(log, sensor):
    """Return the values of a sensor as they are written."""
    unit, x = log.written[sensor], log.x[sensor]
    with np.errstate(all="ignore"):
        if unit != "count":
            return x / UNITS[sensor][unit]
        counts = np.round(x / log.count[sensor]["scale"] + log.count[sensor]["offset"])
    if not (np.abs(counts) < 2**31).all():
        return counts
    return counts.astype(np.int32)
