"""What can be wrong with the values of a log. Each harm changes a Log in place."""

import numpy as np

from bench.fuzz.chain.log import SENSORS, middle, sensor_of, size, some
from imuloop.core.units import STANDARD_GRAVITY


def clipped(rng, log):
    sensor = sensor_of(rng)
    most = np.abs(log.x[sensor]).max(initial=0.0)
    limit = rng.choice([1.05 * STANDARD_GRAVITY, 1.5, most * rng.uniform(0.2, 1.0)])
    log.x[sensor] = np.clip(log.x[sensor], -limit, limit)
    return f"{sensor} at {limit:.3g}"


def requantised(rng, log):
    sensor, step = sensor_of(rng), size(rng, 1e-4, 3.0)
    log.x[sensor] = np.round(log.x[sensor] / step) * step
    return f"{sensor} to {step:.3g}"


def dithered(rng, log):
    for sensor in SENSORS:
        step = log.count[sensor]["scale"]
        dither = rng.uniform(-0.5, 0.5, log.x[sensor].shape)
        log.x[sensor] = np.round(log.x[sensor] / step + dither) * step
    return "by half a count"


def wrapped(rng, log):
    sensor = sensor_of(rng)
    limit = float(rng.choice([5, 7, 8.5] if sensor == "acceleration" else [0.2, 1, 4]))
    log.x[sensor] = (log.x[sensor] + limit) % (2 * limit) - limit
    return f"{sensor} at {limit:g}"


def spikes(rng, log):
    sensor, height = sensor_of(rng), size(rng, 10, 1e38) * rng.choice([-1, 1])
    rows = rng.integers(0, max(len(log), 1), rng.choice([1, 1, 2, 5, 50]))
    if len(log):
        axes = slice(None) if rng.random() < 0.3 else rng.integers(3)
        log.x[sensor][rows, axes] = height
    return f"{len(rows)} of {height:.3g} in {sensor}"


def stuck(rng, log):
    sensor, axis = sensor_of(rng), rng.integers(3)
    first = middle(rng, log) if rng.random() < 0.6 else 0
    value = 0.0 if rng.random() < 0.3 or not len(log) else log.x[sensor][first, axis]
    axes = slice(None) if rng.random() < 0.2 else axis
    log.x[sensor][first:, axes] = value
    return f"{sensor} axis {axes} at {value:.3g} from row {first}"


def held(rng, log):
    sensor, n = sensor_of(rng), int(rng.integers(2, 20))
    log.x[sensor] = log.x[sensor][np.arange(len(log)) // n * n]
    return f"{sensor} over {n} rows"


def padded(rng, log):
    rows = some(rng, log)
    for sensor in SENSORS if rng.random() < 0.5 else [sensor_of(rng)]:
        log.x[sensor][rows] = 0.0
    return f"zeros in {rows.sum()} rows"


def swapped(rng, log):
    sensor, order = sensor_of(rng), rng.permutation(3)
    log.x[sensor] = log.x[sensor][:, order]
    return f"{sensor} to {order}"


def mirrored(rng, log):
    sensor, signs = sensor_of(rng), rng.choice([-1.0, 1.0], 3)
    log.x[sensor] = log.x[sensor] * signs
    return f"{sensor} by {signs}"


def copied(rng, log):
    sensor, other = sensor_of(rng), sensor_of(rng)
    a, b = rng.integers(3, size=2)
    log.x[sensor][:, a] = log.x[other][:, b]
    return f"{other} {b} as {sensor} {a}"


def scale_changes(rng, log):
    sensor, row = sensor_of(rng), middle(rng, log)
    factor = float(rng.choice([0.5, 2, 1.01, 0.1, -1, 1e-6]))
    log.x[sensor][row:] *= factor
    return f"{sensor} by {factor:g} from row {row}"


def offset_changes(rng, log):
    sensor, row = sensor_of(rng), middle(rng, log)
    offset = rng.choice([5.0, 0.5, 0.02]) * rng.choice([-1, 1], 3)
    log.x[sensor][row:] += offset
    return f"{sensor} by {offset} from row {row}"


def drifting(rng, log):
    sensor, direction = sensor_of(rng), rng.normal(size=3)
    course = np.linspace(0, 1, len(log))
    course = [course, np.exp(-5 * course), np.sin(9 * course)][rng.integers(3)]
    amount = size(rng, 1e-4, 1.0)
    log.x[sensor] = log.x[sensor] + amount * course[:, None] * direction
    if rng.random() < 0.5:
        log.temperature = 20 + 30 * course + 0.02 * rng.normal(size=len(log))
    return f"{sensor} by {amount:.3g}"


def scaled(rng, log):
    sensor = sensor_of(rng)
    factor = float(rng.choice([1e-200, 1e-30, 1e-6, 0.5, 2, 4, 1e6, 1e30, 1e200]))
    log.x[sensor] = log.x[sensor] * factor
    return f"{sensor} by {factor:g}"


def noisy(rng, log):
    sensor, amount = sensor_of(rng), size(rng, 1e-3, 30)
    log.x[sensor] = log.x[sensor] + amount * rng.normal(size=log.x[sensor].shape)
    return f"{sensor} by {amount:.3g}"


def without_noise(rng, log):
    n = max(len(log) // int(rng.integers(2, 40)), 1)
    for sensor in SENSORS:
        parts = np.array_split(log.x[sensor], -(-len(log) // n) or 1)
        log.x[sensor] = np.concatenate([0 * p + p.mean(axis=0) if len(p) else p for p in parts])
    return f"means of {n} rows"


def smoothed(rng, log):
    n = int(rng.integers(2, 50))
    for sensor in SENSORS:
        total = np.cumsum(log.x[sensor], axis=0)
        total[n:] = (total[n:] - total[:-n]).copy()
        log.x[sensor] = total / np.minimum(np.arange(1, len(log) + 1), n)[:, None]
    return f"over {n} rows"


def line(rng, log):
    sensor, amount = sensor_of(rng), size(rng, 1e-3, 5)
    phase = 2 * np.pi * rng.uniform(0.001, 0.5) * np.arange(len(log))
    log.x[sensor] = log.x[sensor] + amount * np.sin(phase)[:, None] * rng.normal(size=3)
    return f"of {amount:.3g} in {sensor}"


def corrected(rng, log):
    f = log.x["acceleration"]
    if rng.random() < 0.5:
        with np.errstate(divide="ignore", invalid="ignore"):
            log.x["acceleration"] = STANDARD_GRAVITY * f / np.linalg.norm(f, axis=1)[:, None]
        return "norm to gravity"
    log.x["acceleration"] = f - f.mean(axis=0)
    return "gravity taken out"


def missing(rng, log):
    rows, value = rng.random(len(log)) < size(rng, 1e-4, 0.2), rng.choice([np.nan, np.inf, -np.inf])
    sensor = sensor_of(rng)
    log.x[sensor][rows, rng.integers(3)] = value
    return f"{rows.sum()} of {value} in {sensor}"
