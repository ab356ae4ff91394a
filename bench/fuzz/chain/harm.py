"""What can be wrong with a log. Each harm changes a Log in place and says with which numbers."""

import numpy as np

from imuloop.core import units

# most rows of a log: a case is to take a second or two
MOST_ROWS = 8_000
KINDS = ("static", "six_position", "multi_position")
UNITS = {"acceleration": units.ACCELERATION, "angular_rate": units.ANGULAR_RATE}


def size(rng, low, high):
    """Return a number between two, any order of size alike."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def middle(rng, log):
    """Return a row in the inner part of a log."""
    return int(len(log) * rng.uniform(0.1, 0.9))


def quantity_of(rng):
    return str(rng.choice([*UNITS]))


def stretches(rng, log, most):
    """Return which rows are in one to four stretches."""
    rows = np.zeros(len(log), dtype=bool)
    for _ in range(rng.integers(1, 5)):
        first = rng.integers(0, len(log) + 1)
        rows[first : first + int(len(log) * most * rng.random() ** 2) + 1] = True
    return rows


# --- time


def dropped(rng, log):
    share = size(rng, 1e-3, 0.4)
    log.take(rng.random(len(log)) >= share)
    return f"{share:.2g} of the samples"


def cut(rng, log):
    rows = stretches(rng, log, 0.15)
    log.take(~rows)
    return f"{rows.sum()} rows"


def short(rng, log):
    n = int(rng.choice([0, 1, 2, 50, 99, 100, 101, 150, 300, 1000]))
    log.take(slice(0, n))
    return f"{n} rows"


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
    row, by = middle(rng, log), size(rng, 1e-3, 1e8) * rng.choice([-1, 1])
    by = float(rng.choice([by, 1.7e9, -1.7e9, 3.15e7, -10.0]))
    log.t[row:] += by
    return f"{by:.4g} s at row {row}"


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
    log.take(np.linspace(0, min(n / rate / log.step, len(log) - 1), max(n, 1)).astype(int))
    log.t = np.arange(len(log)) / rate
    for quantity, values in log.x.items():
        values += 0.5 * log.count[quantity]["scale"] * rng.normal(size=values.shape)
    return f"to {rate:g} Hz"


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


# --- values


def clipped(rng, log):
    quantity = quantity_of(rng)
    most = np.abs(log.x[quantity]).max(initial=0.0)
    limit = rng.choice([1.05 * units.STANDARD_GRAVITY, 1.5, most * rng.uniform(0.2, 1.0)])
    log.x[quantity] = np.clip(log.x[quantity], -limit, limit)
    return f"{quantity} at {limit:.3g}"


def wrapped(rng, log):
    quantity = quantity_of(rng)
    limit = float(rng.choice([5, 7, 8.5] if quantity == "acceleration" else [0.2, 1, 4]))
    log.x[quantity] = (log.x[quantity] + limit) % (2 * limit) - limit
    return f"{quantity} at {limit:g}"


def requantised(rng, log):
    quantity, step = quantity_of(rng), size(rng, 1e-4, 3.0)
    log.x[quantity] = np.round(log.x[quantity] / step) * step
    return f"{quantity} to {step:.3g}"


def spikes(rng, log):
    quantity, height = quantity_of(rng), size(rng, 10, 1e38) * rng.choice([-1, 1])
    rows = rng.integers(0, len(log), rng.choice([1, 1, 2, 5, 50]))
    log.x[quantity][rows, rng.integers(3)] = height
    return f"{len(rows)} of {height:.3g} in {quantity}"


def stuck(rng, log):
    quantity, axis = quantity_of(rng), rng.integers(3)
    first = middle(rng, log) if rng.random() < 0.6 else 0
    value = 0.0 if rng.random() < 0.3 else log.x[quantity][first, axis]
    axes = slice(None) if rng.random() < 0.2 else axis
    log.x[quantity][first:, axes] = value
    return f"{quantity} axis {axes} at {value:.3g} from row {first}"


def padded(rng, log):
    rows = stretches(rng, log, 0.3)
    for quantity in UNITS if rng.random() < 0.5 else [quantity_of(rng)]:
        log.x[quantity][rows] = 0.0
    return f"zeros in {rows.sum()} rows"


def other_axes(rng, log):
    quantity, order, signs = quantity_of(rng), rng.permutation(3), rng.choice([-1.0, 1.0], 3)
    log.x[quantity] = log.x[quantity][:, order] * signs
    return f"{quantity} to {order} by {signs}"


def changes(rng, log):
    quantity, row = quantity_of(rng), middle(rng, log) if rng.random() < 0.7 else 0
    factor = float(rng.choice([1, 0.5, 2, 1.01, -1, 1e-6, 1e6, 1e30, 1e-200, 1e200]))
    offset = rng.choice([0, 5.0, 0.5, 0.02]) * rng.choice([-1, 1], 3)
    log.x[quantity][row:] = log.x[quantity][row:] * factor + offset
    return f"{quantity} by {factor:g} and {offset} from row {row}"


def drifting(rng, log):
    quantity, direction, amount = quantity_of(rng), rng.normal(size=3), size(rng, 1e-4, 1.0)
    course = np.linspace(0, 1, len(log))
    course = [course, np.exp(-5 * course), np.sin(9 * course)][rng.integers(3)]
    log.x[quantity] += amount * course[:, None] * direction
    if rng.random() < 0.5:
        log.temperature = 20 + 30 * course + 0.02 * rng.normal(size=len(log))
    return f"{quantity} by {amount:.3g}"


def noisy(rng, log):
    quantity, amount = quantity_of(rng), size(rng, 1e-3, 30)
    noise = rng.normal(size=log.x[quantity].shape)
    if rng.random() < 0.3:
        noise = np.sin(rng.uniform(0.006, 3) * np.arange(len(log)))[:, None] * rng.normal(size=3)
    log.x[quantity] += amount * noise
    return f"{quantity} by {amount:.3g}"


def smoothed(rng, log):
    """Means over stretches, held."""
    n = int(size(rng, 2, 2000))
    for values in log.x.values():
        for first in range(0, len(log), n):
            values[first : first + n] = values[first : first + n].mean(axis=0)
    return f"over {n} rows"


def corrected(rng, log):
    f = log.x["acceleration"]
    if rng.random() < 0.5:
        f *= units.STANDARD_GRAVITY / np.linalg.norm(f, axis=1)[:, None]
        return "norm to gravity"
    f -= f.mean(axis=0)
    return "gravity taken out"


def missing(rng, log):
    rows, value = rng.random(len(log)) < size(rng, 1e-4, 0.2), rng.choice([np.nan, np.inf, -np.inf])
    quantity = quantity_of(rng)
    log.x[quantity][rows, rng.integers(3)] = value
    return f"{rows.sum()} of {value} in {quantity}"


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
    what = str(rng.choice([*courses]))
    log.temperature = courses[what]
    return what


# --- what is declared


def wrong_unit(rng, log):
    quantity = quantity_of(rng)
    others = [unit for unit in UNITS[quantity] if unit != log.declared[quantity]]
    log.declared[quantity] = str(rng.choice(others))
    return f"{quantity} in {log.written[quantity]} as {log.declared[quantity]}"


def wrong_count(rng, log):
    quantity = quantity_of(rng)
    log.written[quantity] = log.declared[quantity] = "count"
    factor = float(rng.choice([0.5, 2, 4, 1.5, 10, 0.1, 1e5, 1e300]))
    offset = float(rng.choice([0, 32768, 1e6]))
    nominal = {"scale": factor * log.count[quantity]["scale"], "offset": offset}
    log.declared[f"nominal.{quantity}"] = nominal
    return f"{quantity} {nominal}"


def second_header(rng, log):
    text = ["t,ax,ay,az,gx,gy,gz", "t,gx,gy,gz,ax,ay,az,mx", "logger restarted", "", "0,0,0"]
    log.lines += [(rng.random(), text[rng.integers(len(text))]) for _ in range(rng.integers(1, 4))]
    return repr([each for _, each in log.lines])


def other_kind(rng, log):
    log.kind = str(rng.choice(KINDS))
    return log.kind


HARMS = (dropped, cut, short, jitter, bursts, clock_jumps, shuffled, wrong_rate, resampled, only)
HARMS += (clipped, wrapped, requantised, spikes, stuck, padded, other_axes, changes, drifting)
HARMS += (noisy, smoothed, corrected, missing, temperature, wrong_unit, wrong_count, second_header)
HARMS += (other_kind,)
