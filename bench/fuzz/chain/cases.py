"""Devices of one to three harmed sessions, each made of its number alone."""

from copy import copy
from dataclasses import dataclass

import numpy as np
import pandas as pd

from bench.fuzz.chain import recordings
from bench.fuzz.chain.harm import HARMS, MOST_ROWS, UNITS, other_kind
from imuloop.core.units import STANDARD_GRAVITY, TIME


@dataclass(frozen=True)
class Case:
    """A device to run the chain on."""

    number: int
    entry: dict  # the device in a config
    words: tuple  # what each session was made of, and its harms


def make(number, folder):
    """Write the logs of a case into a folder and return the Case; may raise NotAtHand."""
    rng = np.random.default_rng(number)
    families = recordings.FAMILIES
    family = families[rng.integers(len(families))]
    name = family[rng.integers(len(family))]
    first = recordings.recording(name)
    # SI, counts and other units alike
    written = {}
    for quantity, (si, *others) in UNITS.items():
        written[quantity] = [si, "count", others[rng.integers(len(others))]][rng.integers(3)]
    nominal, sessions, words = {}, {}, []
    for k in range(rng.choice([1, 2, 3], p=[0.6, 0.25, 0.15])):
        if k and rng.random() < 0.3:
            family = families[rng.integers(len(families))]
        if k and rng.random() < 0.5:
            name = family[rng.integers(len(family))]
        log = stretch(rng, recordings.recording(name))
        log.count, log.written, log.declared = first.count, dict(written), dict(written)
        harms = harm(rng, log)
        for quantity in UNITS:
            if other := log.declared.pop(f"nominal.{quantity}", None):
                nominal[quantity] = other
            elif log.declared[quantity] == "count":
                nominal.setdefault(quantity, first.count[quantity])
        path, declared = write(rng, log, folder / f"log {k}")
        sessions[f"session_{k + 1}"] = {"kind": log.kind, "file": str(path), **declared}
        listed = "; ".join(harms) or "no harm"
        words.append(f"{name} as {log.kind} ({path.name}, {declared['units']}): {listed}")
    gravity = first.gravity if rng.random() < 0.7 else STANDARD_GRAVITY
    entry = {"gravity": gravity, "nominal": nominal, "sessions": sessions}
    return Case(number, entry, tuple(words))


def stretch(rng, source):
    """Return a minute or two of a recording, or all of it thinned."""
    n, log = len(source), copy(source)
    if rng.random() < 0.5:
        rate = (n - 1) / (source.t[-1] - source.t[0])
        rows = int(min(max(rng.uniform(60, 120) * rate, 2000), MOST_ROWS))
        first = 0 if rng.random() < 0.3 else int(rng.integers(0, max(n - rows, 1)))
        log.take(slice(first, first + rows))
    else:
        log.take(slice(0, None, -(-n // MOST_ROWS) * int(rng.choice([1, 1, 2]))))
    log.t, log.lines = log.t - log.t[0], []
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
                done.append(f"{each.__name__} {each(rng, log)}")
    return done


def write(rng, log, stem):
    """Write a log; return its path and how it is declared."""
    columns, units = {}, dict(log.declared)
    time = list(TIME)[rng.integers(4)] if rng.random() < 0.4 else "s"
    with np.errstate(all="ignore"):
        if log.rate is None:
            columns["t"], units["time"] = log.t / TIME[time], time
            if time != "s":
                columns["t"] = whole(columns["t"])
        for quantity, axes in recordings.QUANTITIES.items():
            unit, count, values = log.written[quantity], log.count[quantity], log.x[quantity]
            if unit == "count":
                values = whole(values / count["scale"] + count["offset"])
            else:
                values = values / UNITS[quantity][unit]
            columns |= dict(zip(axes, values.T, strict=True))
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


def whole(x):
    """Return whole numbers, where they can be."""
    return np.round(x).astype(np.int64) if (np.abs(x) < 2**62).all() else x
