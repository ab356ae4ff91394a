"""What can be wrong with a log. Each harm changes a Log in place and says with which numbers."""

import numpy as np

from bench.fuzz.chain.log import KINDS, MOST_ROWS, SENSORS, UNITS
from imuloop.core.units import STANDARD_GRAVITY


def some(rng, log, most=0.3):
    """Return which rows are in one to four stretches."""
    rows = np.zeros(len(log), dtype=bool)
    for _ in range(rng.integers(1, 5)):
        first = rng.integers(0, len(log) + 1)
        rows[first : first + int(len(log) * most * rng.random() ** 2) + 1] = True
    return rows


def size(rng, low, high):
    """Return a number between two, any order of size alike."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def middle(rng, log):
    """Return a row in the inner part of a log."""
    return int(len(log) * rng.uniform(0.1, 0.9))


def sensor_of(rng):
    return SENSORS[rng.integers(2)]


# --- time


def dropped(rng, log):
    share = size(rng, 1e-3, 0.4)
    log.take(rng.random(len(log)) >= share)
    return f"{share:.2g} of the samples"


def cut(rng, log):
    rows = some(rng, log, 0.15)
    log.take(~rows)
    return f"{rows.sum()} rows"


def jitter(rng, log):
    share = size(rng, 1e-3, 2.0)
    log.t = log.t + share * log.step * rng.normal(size=len(log))
    if rng.random() < 0.7:
        log.t = np.sort(log.t)
    return f"of {share:.2g} steps"


def bursts(rng, log):
    n = int(rng.integers(2, 30))
    log.t = log.t[np.arange(len(log)) // n * n] + rng.choice([0, 1e-5]) * (np.arange(len(log)) % n)
    return f"of {n} rows"


def clock_jumps(rng, log):
    jumps = []
    for _ in range(rng.choice([1, 1, 2, 3])):
        row, by = middle(rng, log), size(rng, 1e-3, 1e8) * rng.choice([-1, 1])
        by = float(rng.choice([by, 1.7e9, -1.7e9, 3.15e7, -10.0]))
        log.t[row:] += by
        jumps.append(f"{by:.4g} s at row {row}")
    return ", ".join(jumps)


def repeated(rng, log):
    rows = rng.integers(0, max(len(log), 1), int(len(log) * size(rng, 1e-3, 0.1)))
    log.take(np.sort(np.concatenate([np.arange(len(log)), rows])))
    return f"{len(rows)} rows"


def shuffled(rng, log):
    first, rows = middle(rng, log), np.arange(len(log))
    rows[first:] = np.roll(rows[first:], rng.integers(1, max(len(log) - first, 2)))
    log.take(rows)
    return f"from row {first}"


def wrong_rate(rng, log):
    factor = float(rng.choice([0.25, 0.5, 2, 4, 0.96, 1.04]))
    log.t = log.t * factor
    if rng.random() < 0.3:
        log.rate = 1 / log.step
    return f"by {1 / factor:g}"


def resampled(rng, log):
    rate = float(rng.choice([5, 10, 20, 50, 200, 400, 1000, 2000]))
    n = min(int((log.t[-1] - log.t[0]) * rate), MOST_ROWS)
    at = np.linspace(0, min(n / rate / log.step, len(log) - 1), max(n, 1)).astype(int)
    log.take(at)
    log.t = np.arange(len(log)) / rate
    for sensor, values in log.x.items():
        noise = 0.5 * log.count[sensor]["scale"] * rng.normal(size=values.shape)
        log.x[sensor] = values + noise
    return f"to {rate:g} Hz"


def short(rng, log):
    n = int(rng.choice([0, 1, 2, 50, 99, 100, 101, 150, 300, 1000]))
    log.take(slice(0, n))
    return f"{n} rows"


# --- what was done with the device


def only(rng, log):
    """Keep seconds of motion, or those of rest."""
    n = max(round(1 / log.step), 4)
    parts = np.arange(len(log)) // n
    each, spread = np.bincount(parts), 0.0
    for x in (log.x["angular_rate"].sum(axis=1), log.x["acceleration"].sum(axis=1) / 10):
        mean = np.bincount(parts, x) / each
        spread = spread + np.bincount(parts, (x - mean[parts]) ** 2) / each
    moving = (spread > 3 * np.quantile(spread, 0.2))[parts]
    rest = rng.random() < 0.5 or not moving.any()
    step = log.step
    log.take(~moving if rest else moving)
    log.t = np.arange(len(log)) * step
    return f"{'rest' if rest else 'motion'}, {len(log)} rows"


def few_poses(rng, log):
    share = rng.uniform(0.05, 0.4)
    first = rng.uniform(0, 1 - share)
    log.take(slice(int(first * len(log)), int((first + share) * len(log))))
    return f"{share:.2g} of the log"


# --- values


def clipped(rng, log):
    sensor = sensor_of(rng)
    most = np.abs(log.x[sensor]).max(initial=0.0)
    limit = rng.choice([1.05 * STANDARD_GRAVITY, 1.5, most * rng.uniform(0.2, 1.0)])
    log.x[sensor] = np.clip(log.x[sensor], -limit, limit)
    return f"{sensor} at {limit:.3g}"


def wrapped(rng, log):
    sensor = sensor_of(rng)
    limit = float(rng.choice([5, 7, 8.5] if sensor == "acceleration" else [0.2, 1, 4]))
    log.x[sensor] = (log.x[sensor] + limit) % (2 * limit) - limit
    return f"{sensor} at {limit:g}"


def requantised(rng, log):
    sensor, step = sensor_of(rng), size(rng, 1e-4, 3.0)
    log.x[sensor] = np.round(log.x[sensor] / step) * step
    return f"{sensor} to {step:.3g}"


def spikes(rng, log):
    sensor, height = sensor_of(rng), size(rng, 10, 1e38) * rng.choice([-1, 1])
    rows = rng.integers(0, len(log), rng.choice([1, 1, 2, 5, 50]))
    log.x[sensor][rows, rng.integers(3)] = height
    return f"{len(rows)} of {height:.3g} in {sensor}"


def stuck(rng, log):
    sensor, axis = sensor_of(rng), rng.integers(3)
    first = middle(rng, log) if rng.random() < 0.6 else 0
    value = 0.0 if rng.random() < 0.3 else log.x[sensor][first, axis]
    axes = slice(None) if rng.random() < 0.2 else axis
    log.x[sensor][first:, axes] = value
    return f"{sensor} axis {axes} at {value:.3g} from row {first}"


def padded(rng, log):
    rows = some(rng, log)
    for sensor in SENSORS if rng.random() < 0.5 else [sensor_of(rng)]:
        log.x[sensor][rows] = 0.0
    return f"zeros in {rows.sum()} rows"


def other_axes(rng, log):
    sensor, order, signs = sensor_of(rng), rng.permutation(3), rng.choice([-1.0, 1.0], 3)
    log.x[sensor] = log.x[sensor][:, order] * signs
    return f"{sensor} to {order} by {signs}"


def copied(rng, log):
    sensor, other = sensor_of(rng), sensor_of(rng)
    a, b = rng.integers(3, size=2)
    log.x[sensor][:, a] = log.x[other][:, b]
    return f"{other} {b} as {sensor} {a}"


def changes(rng, log):
    sensor, row = sensor_of(rng), middle(rng, log)
    factor = float(rng.choice([1, 0.5, 2, 1.01, 0.1, -1, 1e-6]))
    offset = rng.choice([0, 5.0, 0.5, 0.02]) * rng.choice([-1, 1], 3)
    log.x[sensor][row:] = log.x[sensor][row:] * factor + offset
    return f"{sensor} by {factor:g} and {offset} from row {row}"


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
    noise = rng.normal(size=log.x[sensor].shape)
    if rng.random() < 0.3:
        noise = np.sin(rng.uniform(0.006, 3) * np.arange(len(log)))[:, None] * rng.normal(size=3)
    log.x[sensor] = log.x[sensor] + amount * noise
    return f"{sensor} by {amount:.3g}"


def without_noise(rng, log):
    parts = int(rng.integers(2, 40))
    for sensor in SENSORS:
        pieces = np.array_split(log.x[sensor], parts)
        log.x[sensor] = np.concatenate([0 * p + p.mean(axis=0) if len(p) else p for p in pieces])
    return f"{parts} means"


def smoothed(rng, log):
    n = int(rng.integers(2, 50))
    for sensor in SENSORS:
        total = np.cumsum(log.x[sensor], axis=0)
        total[n:] = (total[n:] - total[:-n]).copy()
        log.x[sensor] = total / np.minimum(np.arange(1, len(log) + 1), n)[:, None]
    return f"over {n} rows"


def corrected(rng, log):
    f = log.x["acceleration"]
    if rng.random() < 0.5:
        log.x["acceleration"] = STANDARD_GRAVITY * f / np.linalg.norm(f, axis=1)[:, None]
        return "norm to gravity"
    log.x["acceleration"] = f - f.mean(axis=0)
    return "gravity taken out"


def missing(rng, log):
    rows, value = rng.random(len(log)) < size(rng, 1e-4, 0.2), rng.choice([np.nan, np.inf, -np.inf])
    sensor = sensor_of(rng)
    log.x[sensor][rows, rng.integers(3)] = value
    return f"{rows.sum()} of {value} in {sensor}"


def temperature(rng, log):
    n, course = len(log), np.linspace(0, 1, len(log))
    courses = {
        "constant": np.full(n, 25.0),
        "a jump": np.where(np.arange(n) < middle(rng, log), 20.0, 60.0),
        "1e300": np.full(n, 1e300),
        "missing here and there": np.where(rng.random(n) < 0.1, np.nan, 20 + 20 * course),
        "missing": np.full(n, np.nan),
        "in whole degrees": np.round(20 + 20 * course),
        "spikes": np.where(rng.random(n) < 0.001, 1e38, 20 + course),
        "none": None,
    }
    what = list(courses)[rng.integers(len(courses))]
    log.temperature = courses[what]
    return what


# --- what is declared


def wrong_unit(rng, log):
    sensor = sensor_of(rng)
    units = [unit for unit in UNITS[sensor] if unit != log.declared[sensor]]
    log.declared[sensor] = units[rng.integers(len(units))]
    return f"{sensor} in {log.written[sensor]} as {log.declared[sensor]}"


def wrong_count(rng, log):
    sensor = sensor_of(rng)
    log.written[sensor] = log.declared[sensor] = "count"
    factor = float(rng.choice([0.5, 2, 4, 1.5, 10, 0.1, 1e5, 1e300]))
    offset = float(rng.choice([0, 32768, 1e6]))
    nominal = {"scale": factor * log.count[sensor]["scale"], "offset": offset}
    log.declared[f"nominal.{sensor}"] = nominal
    return f"{sensor} {nominal}"


def second_header(rng, log):
    text = ["t,ax,ay,az,gx,gy,gz", "t,gx,gy,gz,ax,ay,az,mx", "logger restarted", "", "0,0,0"]
    log.lines += [(rng.random(), text[rng.integers(len(text))]) for _ in range(rng.integers(1, 4))]
    return repr([each for _, each in log.lines])


def other_kind(rng, log):
    log.kind = KINDS[rng.integers(len(KINDS))]
    return log.kind


HARMS = (dropped, cut, jitter, bursts, clock_jumps, repeated, shuffled, wrong_rate, resampled)
HARMS += (short, only, few_poses, clipped, wrapped, requantised, spikes, stuck, padded, other_axes)
HARMS += (copied, changes, drifting, scaled, noisy, without_noise, smoothed, corrected, missing)
HARMS += (temperature, wrong_unit, wrong_count, second_header, other_kind)
