"""What can be wrong with a log. Each harm changes a Log in place and says with which numbers."""

from dataclasses import dataclass, field

import numpy as np

from imuloop.core.units import DEGREE, STANDARD_GRAVITY

# most rows of a log: a case is to take a second or two
MOST_ROWS = 8_000
SENSORS = ("acceleration", "angular_rate")
KINDS = ("static", "six_position", "multi_position")
UNITS = {
    "acceleration": {"m/s^2": 1.0, "g": STANDARD_GRAVITY, "mg": STANDARD_GRAVITY / 1000},
    "angular_rate": {"rad/s": 1.0, "deg/s": DEGREE, "mrad/s": 1e-3, "deg/h": DEGREE / 3600},
}


@dataclass
class Log:
    """A session as it is to be logged and declared.

    Attributes
    ----------
    kind : str
        As declared.
    t : ndarray, shape (n,)
        s.
    x : dict of str to ndarray, shape (n, 3)
        ``acceleration``, m/s^2, and ``angular_rate``, rad/s.
    temperature : ndarray, shape (n,), or None
        degC.
    count : dict
        ``scale`` and ``offset`` of one count by quantity.
    written, declared : dict
        Unit by quantity.
    rate : float or None
        As declared, Hz; the log has no time column then.
    lines : list of (float, str)
        Lines that do not belong into a text log: where, as a share of its rows, and what.
    """

    kind: str
    t: np.ndarray
    x: dict
    temperature: np.ndarray | None
    count: dict
    written: dict
    declared: dict
    rate: float | None = None
    lines: list = field(default_factory=list)

    def __len__(self):
        return len(self.t)

    def take(self, rows):
        """Keep some rows."""
        self.t = self.t[rows]
        self.x = {sensor: values[rows] for sensor, values in self.x.items()}
        if self.temperature is not None:
            self.temperature = self.temperature[rows]

    @property
    def step(self):
        """Median step of time, s; 1 where there is none."""
        steps = np.diff(self.t)
        steps = steps[steps > 0]
        return float(np.median(steps)) if len(steps) else 1.0

    def restamp(self):
        """Stamp the rows one after the other, without a gap."""
        self.t = np.arange(len(self)) * self.step


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


# --- values


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
    *(clipped, requantised, dithered, wrapped, spikes, stuck, held, padded, swapped, mirrored),
    *(copied, scale_changes, offset_changes, drifting, scaled, noisy, without_noise, smoothed),
    *(line, corrected, missing),
    *(dropped, gaps, jitter, bursts, clock_jumps, repeated, shuffled, wrong_rate, other_rate),
    *(short, only_rest, only_motion, only_handling, few_poses, one_pose),
    *(temperature_off, no_temperature, wrong_unit, wrong_count, second_header, other_kind),
)
