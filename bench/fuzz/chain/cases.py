"""Devices of one to three harmed sessions, each made of its number alone."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from bench.fuzz.chain import recordings
from bench.fuzz.chain.harm import HARMS, other_kind
from bench.fuzz.chain.log import MOST_ROWS, SENSORS, UNITS, Log
from imuloop.core.samples import SENSORS as AXES
from imuloop.core.units import STANDARD_GRAVITY, TIME


@dataclass(frozen=True)
class Case:
    """A device to run the chain on.

    Attributes
    ----------
    number : int
        Of the case.
    entry : dict
        The device in a config.
    words : tuple of str
        What each session was made of, and its harms.
    """

    number: int
    entry: dict
    words: tuple


def make(number, folder):
    """Write the logs of a case into a folder and return the Case; may raise NotAtHand."""
    rng = np.random.default_rng(number)
    families = recordings.FAMILIES
    family = families[rng.integers(len(families))]
    name = family[rng.integers(len(family))]
    first = recordings.recording(name)
    # SI, counts and other units alike
    written = {}
    for sensor, (si, *others) in UNITS.items():
        written[sensor] = [si, "count", others[rng.integers(len(others))]][rng.integers(3)]
    nominal, sessions, words = {}, {}, []
    for k in range(rng.choice([1, 2, 3], p=[0.6, 0.25, 0.15])):
        if k and rng.random() < 0.3:
            family = families[rng.integers(len(families))]
        if k and rng.random() < 0.5:
            name = family[rng.integers(len(family))]
        log = stretch(rng, recordings.recording(name), first.count, written)
        harms = harm(rng, log)
        for sensor in SENSORS:
            if other := log.declared.pop(f"nominal.{sensor}", None):
                nominal[sensor] = other
            elif log.declared[sensor] == "count":
                nominal.setdefault(sensor, first.count[sensor])
        path, declared = write(rng, log, folder / f"log {k}")
        sessions[f"session_{k + 1}"] = {"kind": log.kind, "file": str(path), **declared}
        listed = "; ".join(harms) or "no harm"
        words.append(f"{name} as {log.kind} ({path.name}, {declared['units']}): {listed}")
    gravity = first.gravity if rng.random() < 0.7 else STANDARD_GRAVITY
    entry = {"gravity": gravity, "nominal": nominal, "sessions": sessions}
    return Case(number, entry, tuple(words))


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
    done = []
    for _ in range(rng.choice([0, 1, 1, 1, 2, 2, 3, 5], p=[0.04] + [0.96 / 7] * 7)):
        if len(log):
            each = HARMS[rng.integers(len(HARMS))]
            with np.errstate(all="ignore"):
                done.append(f"{each.__name__} {each(rng, log)}".rstrip())
    return done


def write(rng, log, stem):
    """Write a log; return its path and how it is declared."""
    columns, units = {}, dict(log.declared)
    time = list(TIME)[rng.integers(4)] if rng.random() < 0.4 else "s"
    with np.errstate(all="ignore"):
        if log.rate is None:
            columns["t"], units["time"] = whole(log.t / TIME[time], time != "s"), time
        for sensor, names in zip(SENSORS, AXES.values(), strict=True):
            unit, count, values = log.written[sensor], log.count[sensor], log.x[sensor]
            if unit == "count":
                values = whole(values / count["scale"] + count["offset"], True)
            else:
                values = values / UNITS[sensor][unit]
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


def whole(x, rounded):
    """Return numbers, whole ones where they are to be and can be."""
    if not rounded or not (np.abs(x) < 2**62).all():
        return x
    return np.round(x).astype(np.int64)
