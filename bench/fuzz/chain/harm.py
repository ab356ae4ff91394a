"""What can be wrong with a log. Each harm changes a Log in place and says with which numbers."""

import numpy as np

from bench.fuzz.chain import harm_values
from bench.fuzz.chain.log import KINDS, MOST_ROWS, SENSORS, UNITS, middle, sensor_of, size, some
from imuloop.core.units import STANDARD_GRAVITY

# --- time


def dropped(rng, log):
    share = size(rng, 1e-3, 0.4)
    log.take(rng.random(len(log)) >= share)
    return f"{share:.2g} of the samples"


def gaps(rng, log):
    if rng.random() < 0.5:
        rows = some(rng, log, 0.15)
        log.take(~rows)
        return f"{rows.sum()} rows cut"
    at, seconds = [], []
    for _ in range(rng.integers(1, 6)):
        at.append(middle(rng, log))
        seconds.append(size(rng, 0.05, 1e4))
        log.t[at[-1] :] += seconds[-1]
    return f"of {np.round(seconds, 3)} s at rows {at}"


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
    told = []
    for _ in range(rng.choice([1, 1, 2, 3])):
        row, by = middle(rng, log), size(rng, 1e-3, 1e8) * rng.choice([-1, 1])
        by = float(rng.choice([by, 1.7e9, -1.7e9, 3.15e7, -10.0]))
        log.t[row:] += by
        told.append(f"{by:.4g} s at row {row}")
    return ", ".join(told)


def repeated(rng, log):
    rows = rng.integers(0, max(len(log), 1), int(len(log) * size(rng, 1e-3, 0.1)))
    log.take(np.sort(np.concatenate([np.arange(len(log)), rows])))
    return f"{len(rows)} rows"


def shuffled(rng, log):
    first = middle(rng, log)
    rows = np.arange(len(log))
    rows[first:] = np.roll(rows[first:], rng.integers(1, max(len(log) - first, 2)))
    log.take(rows)
    return f"from row {first}"


def wrong_rate(rng, log):
    factor = float(rng.choice([0.25, 0.5, 2, 4, 0.96, 1.04]))
    log.t = log.t * factor
    if rng.random() < 0.3 and len(log):
        log.rate = 1 / log.step
    return f"by {1 / factor:g}"


def other_rate(rng, log):
    rate = float(rng.choice([5, 10, 20, 50, 200, 400, 1000, 2000]))
    if rng.random() < 0.4 or len(log) < 2:
        log.t = np.arange(len(log)) / rate
        return f"stamped as {rate:g} Hz"
    n = min(int((log.t[-1] - log.t[0]) * rate), MOST_ROWS)
    at = np.linspace(0, min(n / rate / log.step, len(log) - 1), max(n, 1)).astype(int)
    log.take(at)
    log.t = np.arange(len(log)) / rate
    noise = {sensor: 0.5 * log.count[sensor]["scale"] for sensor in SENSORS}
    for sensor, std in noise.items():
        log.x[sensor] = log.x[sensor] + std * rng.normal(size=log.x[sensor].shape)
    return f"resampled to {rate:g} Hz"


def short(rng, log):
    n = int(rng.choice([0, 1, 2, 50, 99, 100, 101, 150, 300, 1000]))
    log.take(slice(0, n))
    return f"{n} rows"


# --- what was done with the device


def _moving(log):
    """Return which rows lie in seconds of motion."""
    n = max(round(1 / log.step), 4)
    parts = np.arange(len(log)) // n
    w, f = log.x["angular_rate"], log.x["acceleration"]
    each = np.bincount(parts)
    spread = np.zeros(len(each))
    for x in (w.sum(axis=1), f.sum(axis=1) / STANDARD_GRAVITY):
        mean = np.bincount(parts, x) / each
        spread += np.bincount(parts, (x - mean[parts]) ** 2) / each
    return (spread > 3 * np.quantile(spread, 0.2))[parts]


def only_rest(rng, log):
    log.take(~_moving(log))
    log.restamp()
    return f"{len(log)} rows"


def only_motion(rng, log):
    moving = _moving(log)
    if moving.any():
        log.take(moving)
        log.restamp()
    return f"{len(log)} rows"


def only_handling(rng, log):
    amount = size(rng, 0.3, 20)
    steps = rng.normal(size=(len(log), 3)) * amount
    for sensor, factor in (("acceleration", 1.0), ("angular_rate", 0.2)):
        shake = np.cumsum(steps * factor, axis=0)
        shake -= shake[np.maximum(np.arange(len(log)) - 25, 0)]
        log.x[sensor] = log.x[sensor] + shake / 5
    return f"by {amount:.3g}"


def few_poses(rng, log):
    share = rng.uniform(0.05, 0.4)
    first = rng.uniform(0, 1 - share)
    log.take(slice(int(first * len(log)), int((first + share) * len(log))))
    return f"{share:.2g} of the log"


def one_pose(rng, log):
    rest = np.flatnonzero(~_moving(log))
    runs = np.split(rest, np.flatnonzero(np.diff(rest) > 1) + 1)
    longest = max(runs, key=len)
    again = int(rng.integers(1, 5))
    log.take(np.tile(longest, again))
    log.restamp()
    return f"{len(longest)} rows, {again} times"


# --- temperature


def temperature_off(rng, log):
    n, way = len(log), rng.integers(9)
    course = np.linspace(0, 1, n)
    log.temperature = [
        np.full(n, 25.0),
        np.where(np.arange(n) < middle(rng, log), 20.0, 60.0),
        np.full(n, 1e300),
        np.full(n, -400.0),
        np.where(rng.random(n) < size(rng, 1e-3, 1), np.nan, 20 + 20 * course),
        np.full(n, np.nan),
        np.round(20 + 20 * course),
        20 + 20 * np.sin(3 * course) + 0.01 * rng.normal(size=n),
        np.where(rng.random(n) < 0.001, 1e38, 20 + course),
    ][way]
    what = "constant, a jump, 1e300, -400, missing here and there, missing, in whole degrees, "
    return (what + "a course, spikes").split(", ")[way]


def no_temperature(rng, log):
    log.temperature = None
    return ""


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
    told = {"scale": factor * log.count[sensor]["scale"]}
    told["offset"] = float(rng.choice([0, 32768, 1e6]))
    log.declared[f"nominal.{sensor}"] = told
    return f"{sensor} {told}"


def second_header(rng, log):
    text = ["t,ax,ay,az,gx,gy,gz", "t,gx,gy,gz,ax,ay,az,mx", "logger restarted", "", "0,0,0"]
    log.lines += [(rng.random(), text[rng.integers(len(text))]) for _ in range(rng.integers(1, 4))]
    return repr([each for _, each in log.lines])


def other_kind(rng, log):
    log.kind = KINDS[rng.integers(len(KINDS))]
    return log.kind


HARMS = (
    *(
        harm_values.clipped,
        harm_values.requantised,
        harm_values.dithered,
        harm_values.wrapped,
        harm_values.spikes,
        harm_values.stuck,
        harm_values.held,
        harm_values.padded,
        harm_values.swapped,
        harm_values.mirrored,
    ),
    *(
        harm_values.copied,
        harm_values.scale_changes,
        harm_values.offset_changes,
        harm_values.drifting,
        harm_values.scaled,
        harm_values.noisy,
        harm_values.without_noise,
        harm_values.smoothed,
    ),
    *(harm_values.line, harm_values.corrected, harm_values.missing),
    *(dropped, gaps, jitter, bursts, clock_jumps, repeated, shuffled, wrong_rate, other_rate),
    *(short, only_rest, only_motion, only_handling, few_poses, one_pose),
    *(temperature_off, no_temperature, wrong_unit, wrong_count, second_header, other_kind),
)
