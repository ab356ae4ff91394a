"""What can be wrong with a log: each takes its table, SI, and a `random.Random`, returns another.

Columns are t, ax … gz and perhaps temperature.
"""

import numpy as np

from imuloop.core.samples import CHANNELS, SENSORS
from imuloop.core.units import STANDARD_GRAVITY

AXES = list(CHANNELS)


def noise(rng, *shape):
    return np.random.default_rng(rng.randrange(1 << 32)).normal(size=shape)


def sensor(rng):
    """Return the columns of one sensor."""
    return list(rng.choice([*SENSORS.values()]))


def size(rng, low, high):
    """Return a number between two, any order of size alike."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def row(rng, log):
    return rng.randrange(len(log))


# --- time


def dropped(log, rng):
    return log[noise(rng, len(log)) > rng.uniform(-3, 0)]


def cut(log, rng):
    first = row(rng, log)
    return log.drop(log.index[first : first + row(rng, log)])


def short(log, rng):
    return log[: rng.choice([0, 1, 2, 50, 99, 100, 101, 150, 300, 1000])]


def jitter(log, rng):
    step = np.median(np.diff(log.t)) if len(log) > 1 else 1.0
    t = log.t + size(rng, 1e-3, 2) * step * noise(rng, len(log))
    return log.assign(t=rng.choice([t, np.sort(t)]))


def bursts(log, rng):
    n = rng.randint(2, 30)
    return log.assign(t=log.t.to_numpy()[np.arange(len(log)) // n * n])


def clock_jumps(log, rng):
    by = rng.choice([size(rng, 1e-3, 1e8), -10.0, 1.7e9, -1.7e9])
    return log.assign(t=log.t + by * (np.arange(len(log)) >= row(rng, log)))


def shuffled(log, rng):
    first = row(rng, log)
    order = np.r_[:first, np.roll(np.arange(first, len(log)), row(rng, log))]
    return log.iloc[order]


def other_rate(log, rng):
    return log.assign(t=log.t * rng.choice([0.25, 0.5, 2, 4, 0.96, 1.04]))


def thinned(log, rng):
    return log[:: rng.choice([2, 5, 20])]


# --- values


def clipped(log, rng):
    axes, limit = sensor(rng), rng.choice([1.05 * STANDARD_GRAVITY, 1.5, 0.3])
    return log.assign(**{a: log[a].clip(-limit, limit) for a in axes})


def wrapped(log, rng):
    axes, limit = sensor(rng), rng.choice([0.2, 1.0, 4.0, 8.5])
    return log.assign(**{a: (log[a] + limit) % (2 * limit) - limit for a in axes})


def rounded(log, rng):
    axes, step = sensor(rng), size(rng, 1e-4, 3)
    return log.assign(**{a: np.round(log[a] / step) * step for a in axes})


def spikes(log, rng):
    values, axis = log.copy(), rng.choice(AXES)
    rows = [row(rng, log) for _ in range(rng.choice([1, 2, 50]))]
    values.loc[log.index[rows], axis] = size(rng, 10, 1e38) * rng.choice([-1, 1])
    return values


def stuck(log, rng):
    axis, first = rng.choice(AXES), row(rng, log)
    value = rng.choice([0.0, log[axis].iloc[first]])
    return log.assign(**{axis: log[axis].where(np.arange(len(log)) < first, value)})


def padded(log, rng):
    first, values = row(rng, log), log.copy()
    values.loc[log.index[first : first + row(rng, log)], rng.choice([AXES, sensor(rng)])] = 0.0
    return values


def other_axes(log, rng):
    axes = sensor(rng)
    order = rng.sample(axes, 3)
    return log.assign(**{a: rng.choice([-1, 1]) * log[b] for a, b in zip(axes, order, strict=True)})


def changes(log, rng):
    axes, later = sensor(rng), np.arange(len(log)) >= row(rng, log)
    factor = rng.choice([1, 0.5, 2, 1.01, -1, 1e-6, 1e6, 1e30, 1e-200, 1e200])
    offset = rng.choice([0, 5.0, 0.5, 0.02])
    return log.assign(**{a: log[a].mask(later, log[a] * factor + offset) for a in axes})


def drifting(log, rng):
    axes, course = sensor(rng), np.linspace(0, 1, len(log))
    course = rng.choice([course, np.exp(-5 * course), np.sin(9 * course)])
    log = log.assign(**{a: log[a] + size(rng, 1e-4, 1) * course for a in axes})
    return log.assign(temperature=20 + 30 * course) if rng.random() < 0.5 else log


def noisy(log, rng):
    amount = size(rng, 1e-3, 30)
    return log.assign(**{a: log[a] + amount * noise(rng, len(log)) for a in sensor(rng)})


def smoothed(log, rng):
    """Means over stretches, held."""
    n = int(size(rng, 2, 2000))
    return log.assign(**log[AXES].groupby(np.arange(len(log)) // n).transform("mean"))


def without_gravity(log, rng):
    axes = list(SENSORS["accelerometer"])
    force = log[axes]
    lost = force - force.mean()
    of_norm = force.div(np.linalg.norm(force, axis=1), axis=0) * STANDARD_GRAVITY
    return log.assign(**rng.choice([lost, of_norm]))


def missing(log, rng):
    value, absent = rng.choice([np.nan, np.inf, -np.inf]), noise(rng, len(log)) > 2
    return log.assign(**{axis: log[axis].mask(absent, value) for axis in [rng.choice(AXES)]})


def temperature(log, rng):
    course, n = np.linspace(20, 40, len(log)), np.arange(len(log))
    jump, gone = np.where(n < row(rng, log), 20.0, 60.0), np.full(len(log), np.nan)
    courses = [course, np.round(course), jump, gone, 0 * course + 1e300]
    return log.assign(temperature=rng.choice([*courses, np.where(n % 7, course, np.nan)]))


HARMS = (dropped, cut, short, jitter, bursts, clock_jumps, shuffled, other_rate, thinned, clipped)
HARMS += (wrapped, rounded, spikes, stuck, padded, other_axes, changes, drifting, noisy, smoothed)
HARMS += (without_gravity, missing, temperature)
