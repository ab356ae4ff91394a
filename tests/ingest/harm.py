"""What is done to a sound log: each function gives, of its parameters, one that harms a log."""

from functools import reduce, wraps

import numpy as np
import pandas as pd

from imuloop.core.units import DEGREE, STANDARD_GRAVITY
from ingest.logs import ALL, FORCE, RATE, brief, increments, poses, swaying


def harm(function):
    """Turn ``function(log, *given)`` into one of what is given, which returns one of a log."""

    @wraps(function)
    def given(*what, **more):
        def harmed(log):
            changed = function(log, *what, **more)
            return log if changed is None else changed

        return harmed

    return given


@harm
def nothing(log):
    pass


@harm
def after(log, *harms):
    """Do several things, one after the other."""
    return reduce(lambda changed, each: each(changed), harms, log)


# --- values


@harm
def put(log, names, value, first=0, count=None):
    """Set columns to a value from a share of the log on; None holds what was there."""
    start = int(first * len(log))
    where = slice(start, start + count - 1 if count else None)
    for name in names:
        log.loc[where, name] = log[name].iloc[start] if value is None else value


@harm
def at(log, labels, name, values):
    log.loc[labels, name] = values


@harm
def added(log, labels, names, value):
    """Add a value in some rows, in all of None."""
    log.loc[slice(None) if labels is None else labels, names] += value


@harm
def in_counts(log, scales):
    log[ALL] = (log[ALL] / scales).round()


@harm
def summed(log, rate, *factors):
    return increments(log, rate, *factors)


@harm
def scaled(log, names, factor, offset=0.0):
    log[names] = log[names] * factor + offset


@harm
def rounded(log, names, step):
    log[names] = np.round(log[names] / step) * step


@harm
def clipped(log, names, low, high):
    log[names] = log[names].clip(low, high)


@harm
def fading(log, names):
    """Let a scale change by little, so that no two values are the same."""
    log[names] = log[names] * np.linspace(1, 1.0001, len(log))[:, None]


@harm
def clipped_share(log, name, share):
    """Clip the largest samples, those above a share of all, or the smallest."""
    limit = np.sort(log[name].to_numpy())[int(share * len(log))]
    log[name] = log[name].clip(upper=limit) if share > 0.5 else log[name].clip(lower=limit)


@harm
def flat_top(log, rows, count):
    """Clip gx to so many rows, then hold each value for so many."""
    log["gx"] = log["gx"].clip(upper=log["gx"].nlargest(rows).iloc[-1])
    log[ALL] = log[ALL].to_numpy()[np.arange(len(log)) // count * count]


@harm
def reached(log, limit, rows):
    """Let each axis of the gyroscope reach one end of a range in so many rows."""
    for name, sign in zip(RATE, (1, -1, 1), strict=True):
        largest = log[name].mul(sign).nlargest(rows).index
        log[name] = log[name].clip(-0.99 * limit, 0.99 * limit)
        log.loc[largest, name] = sign * limit


@harm
def sixteen_bits(log, zero):
    """Write the rate as counts of 1e-4 rad/s, the largest of gx at the ends of 16 bits."""
    log[RATE] = (log[RATE] / 1e-4).round()
    fastest = log.gx.abs().nlargest(18).index
    log.loc[fastest, "gx"] = np.where(log.gx[fastest] > 0, 32767, -32768)
    log[RATE] += zero


@harm
def held(log, names, count):
    """Repeat each value for so many rows, as a sensor does that is slower than its log."""
    where = np.floor(np.floor(np.arange(len(log)) / count) * count).astype(int)
    log[names] = log[names].to_numpy()[where]


@harm
def every(log, count, names, value):
    """Put a value into each of so many rows, as a bus does whose reads fail."""
    log.loc[1::count, names] = value


@harm
def spikes(log, size):
    """Add three samples to all channels, each where it is quiet nearby."""
    spread = log["ax"].rolling(17, center=True).std()
    for share in (0.2, 0.5, 0.8):
        start = int(share * len(log))
        log.loc[spread.iloc[start : start + 500].idxmin(), ALL] += size


@harm
def wrapped(log, count):
    """An integer of 16 bits that wraps around in fast turns; g and deg/s that are not declared."""
    log[FORCE], log[RATE] = log[FORCE] / STANDARD_GRAVITY, log[RATE] / DEGREE
    first = log.gx.abs().rolling(9, center=True).mean().idxmax()
    for start in range(first, first + 40 * count, 40):
        log.loc[start - 3 : start, "gx"] = [3276.0, 3276.2, 3276.5, 3276.7]
        log.loc[start + 1 : start + 20, "gx"] = -3276.7 + 0.3 * np.arange(-1, 19).clip(0)
        log.loc[start + 21 : start + 22, "gx"] = [3276.2, 3275.5]


@harm
def turned(log, acceleration, angular_rate):
    """Log as x, y, z of each sensor its true axes of these numbers, with these signs."""
    for names, numbers in ((FORCE, acceleration), (RATE, angular_rate)):
        log[names] = log[names].to_numpy()[:, np.abs(numbers) - 1] * np.sign(numbers)


@harm
def distorted(log, seed):
    """Give the gyroscope biases, misalignments of 5°, scale errors of 10 % and a narrow range."""
    rng = np.random.default_rng(seed)
    mixing = (np.eye(3) + 0.08 * rng.normal(size=(3, 3))) * rng.uniform(0.9, 1.1, 3)
    log[RATE] = log[RATE].to_numpy() @ mixing + rng.uniform(-0.3, 0.3, 3)
    log[RATE] = log[RATE].clip(*np.array([-0.6, 0.6]) * log[RATE].abs().max().max())
    return log[(rng.random(len(log)) > 0.03) & ((log.index < 2000) | (log.index > 2150))]


def about_x():
    """A log that is turned about x alone."""
    t = np.arange(6000) / 100
    angle = 1.2 * np.sin(2 * np.pi * t / 6) * (t > 6)
    log = brief(6000).assign(ax=0.0, ay=9.8 * np.sin(angle), az=9.8 * np.cos(angle), gy=0.0, gz=0.0)
    log["gx"] = np.gradient(angle, t)
    log[ALL] += np.random.default_rng(1).normal(size=(6000, 6)) * 0.02
    return log


@harm
def gravity_as_rate(log, size, digits):
    """Write a fusion filter's vector of gravity in place of the rate."""
    smooth = log[FORCE].rolling(20, min_periods=1).mean()
    unit = smooth.div(np.linalg.norm(smooth, axis=1), axis=0)
    log[RATE] = (size * unit).round(digits).to_numpy()


@harm
def changed_amid(log, factor, bias):
    """Change the scale of the force, or the bias of x, from half of the log on."""
    log.loc[len(log) // 2 :, FORCE] *= factor
    log.loc[len(log) // 2 :, "ax"] += bias


# --- rows


@harm
def turned_in_a_gap(log):
    """Lose all rows from half a second before the first move to half a second after it."""
    spread = log[RATE].abs().max(axis=1).rolling(50, center=True).max()
    moving = np.flatnonzero(spread > 0.3)
    end = moving[np.flatnonzero(np.diff(moving) > 50)[0]] + 50
    return log.drop(index=range(moving[0] - 50, end))


@harm
def lost(log, share):
    """Lose a share of the rows at random."""
    return log[np.random.default_rng(2).random(len(log)) > share]


@harm
def late(log, block, start=100, by=61):
    """Write a block of rows later than those that follow it."""
    order = np.delete(np.arange(len(log)), np.s_[start : start + block])
    return log.iloc[np.insert(order, start + by, np.arange(start, start + block))]


@harm
def written_twice(log, start, each):
    """Write each of so many rows twice."""
    return log.iloc[np.sort(np.r_[np.arange(len(log)), np.arange(start, len(log), each)])]


@harm
def twice(log, force, rate, order=1):
    """Write each row twice, with one time stamp, in other units."""
    again = log.assign(**log[FORCE] * force, **log[RATE] * rate)
    return pd.concat([log, again][::order]).sort_values("t", kind="stable", ignore_index=True)


# --- stamps


@harm
def held_back(log):
    """Stamps of transfers that come after random pauses of some tenths of a second."""
    rng, number = np.random.default_rng(8), np.arange(len(log))
    first = np.cumsum(np.r_[0, rng.integers(2, 60, len(log))])
    transfer = np.searchsorted(first, number, side="right") - 1
    sent = np.cumsum(rng.exponential(0.31, len(log)))
    log["t"] = sent[transfer] + 0.002 * (number - first[transfer])
    return log.sort_values("t", ignore_index=True)


@harm
def stamps(log, function):
    return log.assign(t=function(log.t.to_numpy()))


@harm
def later(log, *steps):
    """Move stamps from a row on by seconds, each pair (row, seconds)."""
    return log.assign(t=log.t + sum(s * (log.index >= row) for row, s in steps))


@harm
def counter(log, width, tick_s, before=200, gap=0):
    """A counter of ticks that rolls over so many rows after the start, and loses rows there."""
    ticks = width + np.rint((log.t - log.t[before]) / tick_s).astype(np.int64)
    return log.assign(t=ticks % width).drop(index=range(before, before + gap))


@harm
def in_bursts(log, size=5, spacing=0.002, rate=100):
    """Stamps of a host to whom samples come `size` at once, some milliseconds late."""
    burst = np.arange(len(log)) // size
    delay = np.random.default_rng(6).gamma(2, 0.001, burst[-1] + 1)[burst]
    place = spacing * (np.arange(len(log)) % size)
    return log.assign(t=(burst + 1) * size / rate + delay + place)


@harm
def in_packets(log, size, share, jitter=0.0, end=True):
    """Stamps of a host: some packets have one, that of their last row or of their first."""
    rng = np.random.default_rng(5)
    t = log.t.to_numpy() + jitter * rng.random(len(log))
    for start in range(0, len(log) - size, size):
        if rng.random() < share:
            t[start : start + size] = t[start + (size - 1) * end]
    return log.assign(t=t)


def scattered(std, seed=12):
    return stamps(lambda t: t + np.random.default_rng(seed).normal(0, std, len(t)))


@harm
def sampled_unevenly(log):
    """A sensor that was sampled at the times of its uneven stamps."""
    t = log.t.to_numpy() + np.random.default_rng(14).normal(0, 0.002, len(log))
    return swaying(t).assign(t=t)


@harm
def on_grid(log, rate, grid):
    """The same poses at another rate, its stamps on a grid about as wide as a step."""
    log = poses(rate)
    return log.assign(t=np.floor(log.t / grid + 0.3) * grid)


@harm
def unpadded(log, rate, start, digits=9):
    """Join whole seconds and their part as numbers: 1 ms after the second is .1, as 100 ms are."""
    ns = np.rint((start + log.index / rate) * 1e9).astype(int)
    part = ns % 10**9 // 10 ** (9 - digits)
    if digits == 9:
        text = (1_700_000_000 + ns // 10**9).astype(str)
    else:
        text = (pd.Timestamp("2024-11-18") + pd.to_timedelta(ns // 10**9, "s")).astype(str)
    return log.assign(t=text + "." + part.astype(str))
