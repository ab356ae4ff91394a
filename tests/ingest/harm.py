"""Harms by name: each function changes a sound log in place, or returns the changed one."""

import numpy as np
import pandas as pd

from imuloop.core.units import DEGREE, STANDARD_GRAVITY
from ingest.logs import ALL, FORCE, RATE, increments, poses, swaying

NAMES = {"ALL": ALL, "FORCE": FORCE, "RATE": RATE}


def harmed(log, harm):
    """Return a log that is changed by functions of this module, {name: arguments}."""
    for name, arguments in harm.items():
        values = [NAMES.get(x, x) if isinstance(x, str) else x for x in arguments]
        # a harm that is done again has a number after its name
        changed = globals()[name.partition(" ")[0]](log, *values)
        log = log if changed is None else changed
    return log


# --- values


def put(log, names, value, first=0, count=None):
    """Set columns to a value from a share of the log on; "hold" keeps the first value there."""
    start = int(first * len(log))
    rows = slice(start, start + count - 1 if count else None)
    for name in names:
        log.loc[rows, name] = log[name].iloc[start] if value == "hold" else value


def at(log, labels, name, values):
    log.loc[labels, name] = values


def added(log, names, value, *steps):
    """Add a value in all rows, or in the rows of a range."""
    log.loc[slice(None) if not steps else [*range(*steps)], names] += value


def scaled(log, names, factor, offset=0.0):
    log[names] = log[names] * factor + offset


def rounded(log, names, step):
    log[names] = np.round(log[names] / step) * step


def clipped(log, names, low, high):
    log[names] = log[names].clip(low, high)


def summed(log, rate, *factors):
    return increments(log, rate, *factors)


def in_counts(log):
    """Write counts of 16 bits, of ± 2 g and ± 250 deg/s."""
    log[FORCE] = (log[FORCE] * 16384 / STANDARD_GRAVITY).round()
    log[RATE] = (log[RATE] * 131 / DEGREE).round()


def copied(log, source, target):
    log[target] = log[source]


def with_dead_zone(log, width):
    log[RATE] = log[RATE].where(log[RATE].abs() > width, 0.0)


def fading(log):
    """Let the scale change a little, so that no two values are the same."""
    log[ALL] = log[ALL] * np.linspace(1, 1.0001, len(log))[:, None]


def flat_top(log, rows, count):
    """Clip gx to a number of rows, then hold each value for a number of rows."""
    log["gx"] = log["gx"].clip(upper=log["gx"].nlargest(rows).iloc[-1])
    repeated(log, ALL, count)


def sixteen_bits(log, zero):
    """Write the rate as counts of 1e-4 rad/s, the largest of gx at the ends of 16 bits."""
    log[RATE] = (log[RATE] / 1e-4).round()
    fastest = log.gx.abs().nlargest(40).index
    log.loc[fastest, "gx"] = np.where(log.gx[fastest] > 0, 32767, -32768)
    log[RATE] += zero


def repeated(log, names, count):
    """Repeat each value for some rows, as a sensor does that is slower than its log."""
    rows = np.floor(np.floor(np.arange(len(log)) / count) * count).astype(int)
    log[names] = log[names].to_numpy()[rows]


def repeated_about(log, names, count, spread):
    """Repeat each value for `count` rows, give or take `spread`."""
    lengths = np.random.default_rng(1).integers(count - spread, count + spread + 1, len(log))
    first = np.r_[0, np.cumsum(lengths)]
    rows = first[np.searchsorted(first, np.arange(len(log)), side="right") - 1]
    log[names] = log[names].to_numpy()[rows]


def every(log, count, names, value):
    """Put a value into one of `count` rows, as a bus does whose reads fail."""
    log.loc[1::count, names] = value


def spikes(log, size):
    """Add three samples to all channels, where these are quiet."""
    spread = log["ax"].rolling(17, center=True).std()
    for share in (0.2, 0.5, 0.8):
        start = int(share * len(log))
        log.loc[spread.iloc[start : start + 500].idxmin(), ALL] += size


def wrapped(log, count):
    """An integer of 16 bits that wraps around in fast turns; g and deg/s that are not declared."""
    log[FORCE], log[RATE] = log[FORCE] / STANDARD_GRAVITY, log[RATE] / DEGREE
    first = log.gx.abs().rolling(9, center=True).mean().idxmax()
    for start in range(first, first + 40 * count, 40):
        log.loc[start - 3 : start, "gx"] = [3276.0, 3276.2, 3276.5, 3276.7]
        log.loc[start + 1 : start + 20, "gx"] = -3276.7 + 0.3 * np.arange(-1, 19).clip(0)
        log.loc[start + 21 : start + 22, "gx"] = [3276.2, 3275.5]


def turned(log, acceleration, angular_rate):
    """Log as x, y, z of each sensor its true axes of these numbers, with these signs."""
    for names, numbers in ((FORCE, acceleration), (RATE, angular_rate)):
        log[names] = log[names].to_numpy()[:, np.abs(numbers) - 1] * np.sign(numbers)


def distorted(log):
    """Give the gyroscope biases, misalignments of 5°, scale errors of 10 % and a narrow range."""
    rng = np.random.default_rng(0)
    mixing = (np.eye(3) + 0.08 * rng.normal(size=(3, 3))) * rng.uniform(0.9, 1.1, 3)
    log[RATE] = log[RATE].to_numpy() @ mixing + rng.uniform(-0.3, 0.3, 3)
    log[RATE] = log[RATE].clip(*np.array([-0.6, 0.6]) * log[RATE].abs().max().max())
    return log[(rng.random(len(log)) > 0.03) & ((log.index < 2000) | (log.index > 2150))]


def gravity_as_rate(log, size, digits):
    """Write a fusion filter's vector of gravity in place of the rate."""
    smooth = log[FORCE].rolling(20, min_periods=1).mean()
    unit = smooth.div(np.linalg.norm(smooth, axis=1), axis=0)
    log[RATE] = (size * unit).round(digits).to_numpy()


def changed_amid(log, factor):
    """Change the scale of the force from half of the log on."""
    log.loc[len(log) // 2 :, FORCE] *= factor


# --- rows


def first(log, rows):
    return log[:rows]


def without(log, label, count=1):
    return log.drop(index=range(label, label + count))


def lost(log, share):
    """Lose a share of the rows at random."""
    return log[np.random.default_rng(2).random(len(log)) > share]


def late(log, block):
    """Write a block of rows later than those that follow it."""
    order = np.delete(np.arange(len(log)), np.s_[100 : 100 + block])
    return log.iloc[np.insert(order, 161, np.arange(100, 100 + block))]


def written_twice(log, start, step):
    """Write one of `step` rows twice."""
    return log.iloc[np.sort(np.r_[np.arange(len(log)), np.arange(start, len(log), step)])]


def twice(log, force, rate, order=1):
    """Write each row twice, with one time stamp, in other units."""
    again = log.assign(**log[FORCE] * force, **log[RATE] * rate)
    return pd.concat([log, again][::order]).sort_values("t", kind="stable", ignore_index=True)


# --- time stamps


def unix(log, ticks):
    return log.assign(t=np.rint((log.t + 1.7e9) * ticks).astype("int64"))


def whole(log, factor):
    return log.assign(t=np.rint(log.t * factor).astype("int64"))


def later(log, *steps):
    """Move time stamps from a row on by seconds, each pair (row, seconds)."""
    return log.assign(t=log.t + sum(s * (log.index >= row) for row, s in steps))


def set_clock(log, row, value):
    """Let the clock show a value in a row, and go on from there."""
    log.loc[row:, "t"] += value - log.t[row]


def at_midnight(log):
    ms = (np.rint(log.t * 1000) + 86_397_000) % 86_400_000
    return log.assign(t=pd.to_datetime(ms, unit="ms").dt.strftime("%H:%M:%S.%f"))


def counter(log, width, tick_s, before=200, gap=0):
    """A counter of ticks that rolls over some rows after the start, and loses rows there."""
    ticks = width + np.rint((log.t - log.t[before]) / tick_s).astype(np.int64)
    return log.assign(t=ticks % width).drop(index=range(before, before + gap))


def in_bursts(log, spacing=0.002):
    """Stamps of a host to which five samples come at once, some milliseconds late."""
    burst = np.arange(len(log)) // 5
    delay = np.random.default_rng(6).gamma(2, 0.001, burst[-1] + 1)[burst]
    return log.assign(t=(burst + 1) * 0.05 + delay + spacing * (np.arange(len(log)) % 5))


def in_packets(log, size, share, jitter=0.0, end=True):
    """Stamps of a host: some packets have one, when their last or first row was sampled."""
    rng = np.random.default_rng(5)
    t = log.t.to_numpy() + jitter * rng.random(len(log))
    for start in range(0, len(log) - size, size):
        if rng.random() < share:
            t[start : start + size] = t[start + (size - 1) * end]
    return log.assign(t=t)


def scattered(log, std, seed=12):
    return log.assign(t=log.t + np.random.default_rng(seed).normal(0, std, len(log)))


def late_by(log, mean, seed):
    """Stamps of a host that is late by a random delay, s."""
    delay = np.random.default_rng(seed).exponential(mean, len(log))
    return log.assign(t=np.maximum.accumulate(log.t + delay))


def polled(log, interval):
    return log.assign(t=np.ceil(log.t / interval) * interval)


def jittered(log, step):
    return log.assign(t=log.t + step * (log.index % 2))


def sampled_unevenly(log):
    """A sensor that was sampled at the times of its uneven stamps."""
    t = log.t.to_numpy() + np.random.default_rng(14).normal(0, 0.002, len(log))
    return swaying(t).assign(t=t)


def on_grid(log, rate, grid):
    """The same poses at another rate, with stamps on a grid about as wide as a step."""
    log = poses(rate)
    return log.assign(t=np.floor(log.t / grid + 0.3) * grid)


def unpadded(log, rate, start, digits=9):
    """Join whole seconds and their part as numbers: 1 ms after the second is .1, as 100 ms are."""
    ns = np.rint((start + log.index / rate) * 1e9).astype(int)
    part = ns % 10**9 // 10 ** (9 - digits)
    if digits == 9:
        text = (1_700_000_000 + ns // 10**9).astype(str)
    else:
        text = (pd.Timestamp("2024-11-18") + pd.to_timedelta(ns // 10**9, "s")).astype(str)
    return log.assign(t=text + "." + part.astype(str))


def since(log, start):
    """Write whole ns since some time before the log."""
    return log.assign(t=np.rint((log.t + start) * 1e9).astype("int64"))


def of_ios(log):
    """Turn the sign of a force that was written in g with six digits."""
    log[FORCE] = -np.round(log[FORCE] / -STANDARD_GRAVITY, 6) * STANDARD_GRAVITY


def renamed(log, names):
    return log.rename(columns=names)
