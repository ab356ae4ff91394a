"""A device as it is, and the log of it turned by hand. Nothing of imuloop is in here.

The body moves at a high rate: poses all over the sphere, turns of minimum jerk with a wobble, about
a point of the hand that moves too. The accelerometer's axes are the body's. What the sensors feel
passes their equation ``x = T K (raw - b)``, noise is added, both pass the same low-pass filter, and
are sampled. Devices of one seed have the same truth, motion and noise in every case.
"""

import json
from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, lfilter, lfilter_zi
from scipy.spatial.transform import Rotation

GRAVITY = 9.80665
DEGREE = np.pi / 180
# of the body's motion, at least, Hz
INTERNAL = 1600
# nothing is missing from the model
EFFECT_FREE = (
    "clean", "lowpass", "settle", "tremor", "usb", "quantised", "slow_turns", "fast_turns",
    "twelve_poses", "spikes", "fan", "clipping", "faces", "lossy",
)  # fmt: skip
WITH_EFFECT = ("temperature", "thermometer_lag", "jump")
CASES = (*EFFECT_FREE, *WITH_EFFECT, "all")
# how far from upright a face is put down, rad, and the share of rows that a lossy log has
FACE, KEPT = 0.01, 0.8
# full scale of the gyroscope where it clips, °/s
RAIL = 250
CHANNELS = ("ax", "ay", "az", "gx", "gy", "gz")


@dataclass(frozen=True)
class Sensor:
    """One sensor, ``x = T K (raw - b)``: T (3, 3), unit diagonal; K (3,); b (3,), raw units."""

    T: np.ndarray
    K: np.ndarray
    b: np.ndarray

    def raw(self, x):
        """Return the output of the sensor for true values, (…, 3)."""
        return x @ np.linalg.inv(self.T).T / self.K + self.b

    def corrected(self, raw):
        """Return the values that a raw output stands for, (…, 3)."""
        return (raw - self.b) * self.K @ self.T.T


@dataclass(frozen=True)
class Motion:
    """True motion: attitude body to world, angular rate and specific force, SI."""

    t: np.ndarray
    attitude: Rotation
    angular_rate: np.ndarray
    force: np.ndarray
    on_table: np.ndarray  # 1 at rest, 0 in the middle of a move
    rests: np.ndarray  # start and end of each true rest, what settles included, s


@dataclass(frozen=True)
class Recording:
    """A log, the true parameters of its device, and facts about the log that only the truth has."""

    case: str
    parts: tuple
    seed: int
    rate: float
    accelerometer: Sensor
    gyroscope: Sensor
    rests: np.ndarray
    columns: dict  # the log: t, ax … gz and perhaps temperature
    slopes: tuple  # bias over temperature of both sensors, raw units per °C, (3,) each
    steps: tuple  # step of the bias of both sensors, raw units, (3,) each
    jump_s: float  # when that happens
    middle: float  # temperature at which the bias is b, °C
    temperatures: tuple  # lowest and highest true one of a rest, °C

    @property
    def effect_free(self):
        """Whether T, K and b are all that is true of the device."""
        return not set(self.parts) & set(WITH_EFFECT)

    def bias(self, sensor, t, temperature):
        """Return the sum of the effects on sensor 0 or 1 at a time, raw units, (…, 3)."""
        warmer = np.asarray(temperature)[..., None] - self.middle
        later = np.asarray(t)[..., None] >= self.jump_s
        return warmer * self.slopes[sensor] + later * self.steps[sensor]

    def write(self, path):
        """Write the log as CSV, SI."""
        form = ["%.6f" if name in ("t", "temperature") else "%.7f" for name in self.columns]
        table = np.column_stack(list(self.columns.values()))
        np.savetxt(path, table, form, ",", header=",".join(self.columns), comments="")

    def truth(self):
        """Return the true parameters, as JSON."""
        data = {name: value for name, value in vars(self).items() if name != "columns"}
        return json.dumps(data, default=lambda x: x.tolist() if hasattr(x, "tolist") else vars(x))


def minimum_jerk(x):
    """Return the course of a turn by hand from 0 to 1."""
    x = np.clip(x, 0, 1)
    return x**3 * (10 - 15 * x + 6 * x**2)


def sphere(n):
    """Return n directions that cover the sphere evenly, (n, 3)."""
    z = 1 - (2 * np.arange(n) + 1) / n
    turn = np.pi * (3 - np.sqrt(5)) * np.arange(n)
    return np.column_stack([*(np.sqrt(1 - z**2) * [np.cos(turn), np.sin(turn)]), z])


def parts_of(case, seed):
    """Return the cases that a case is made of."""
    if case != "all":
        return (case,)
    rng = stream(seed, "all")
    parts = set(rng.choice(EFFECT_FREE[1:], 4, replace=False).tolist())
    # turns are of one kind; fast ones that clip would all be spoiled
    speeds = [name for name in ("fast_turns", "clipping", "slow_turns") if name in parts]
    parts -= set(speeds[1:])
    if rng.random() < 0.5:
        parts.add(str(rng.choice(WITH_EFFECT)))
    return tuple(name for name in CASES if name in parts)


def stream(seed, name):
    """Return random numbers for one purpose: what one case draws leaves all others as they are."""
    return np.random.default_rng([seed, *name.encode()])


def poses(n, rng, faces=0.0):
    """Return n attitudes, 50° or more apart, (n,) Rotation.

    All over the sphere in random order, or, with `faces`, the six faces of a case again and again,
    each off by that angle, rad.
    """
    up = Rotation.random(rng=rng).apply(sphere(n) + rng.normal(0, 0.05, (n, 3)))
    if faces:
        up = np.resize([*np.eye(3), *-np.eye(3)], (n, 3)) + rng.normal(0, faces, (n, 3))
    up = up / np.linalg.norm(up, axis=1)[:, None]
    attitudes = []
    for one in up if faces else rng.permutation(up):
        level = Rotation.align_vectors([0, 0, 1], one)[0]
        while True:
            turned = Rotation.from_euler("z", rng.uniform(0, 2 * np.pi)) * level
            if not attitudes or (attitudes[-1].inv() * turned).magnitude() > 50 * DEGREE:
                break
        attitudes.append(turned)
    return Rotation.concatenate(attitudes)


def waves(t, low, high, rng, count=4):
    """Return random waves between two frequencies (Hz), root mean square 1, (n, 3)."""
    wave = np.zeros((len(t), 3))
    for _ in range(count):
        f, phase = rng.uniform(low, high, 3), rng.uniform(0, 2 * np.pi, 3)
        wave += np.sin(2 * np.pi * f * t[:, None] + phase)
    return wave * np.sqrt(2 / count)


def move_seconds(angles, parts, rng):
    """Return the duration, s, of turns by such angles: the peak rate is 15/8 of the mean one."""
    shape, fast = rng.uniform(size=(2, len(angles)))
    if "slow_turns" in parts:
        return 6 + 14 * shape
    if "fast_turns" in parts:
        # no hand is quicker than that
        return np.maximum(15 / 8 * angles / (300 * 5**fast * DEGREE), 0.2)
    if "clipping" in parts:
        return 15 / 8 * angles / ((120 + 300 * fast) * DEGREE)
    return 1 + 2 * shape


def move(seed, parts, rate):
    """Return the Motion of a session, at `rate` or more."""
    rng = stream(seed, "motion")
    count = rng.integers(12, 41)
    count = 12 if "twelve_poses" in parts else count
    attitudes = poses(count, rng, FACE * ("faces" in parts))
    turns = (attitudes[:-1].inv() * attitudes[1:]).as_rotvec()
    seconds = np.zeros(2 * count - 1)
    seconds[::2] = rng.uniform(3, 8, count)
    seconds[0] = rng.uniform(15, 60)
    seconds[1::2] = move_seconds(np.linalg.norm(turns, axis=1), parts, rng)
    edges = np.concatenate([[0], np.cumsum(seconds)])
    t = np.arange(int(edges[-1] * rate)) / rate
    piece = np.minimum(np.searchsorted(edges, t, side="right") - 1, len(seconds) - 1)
    pose, moving = piece // 2, piece % 2 == 1
    x = np.where(moving, (t - edges[piece]) / seconds[piece], 0.0)
    s, following = minimum_jerk(x)[:, None], np.minimum(pose + 1, count - 1)

    def course(values):
        """Return a value per pose, and on the way from each to the next."""
        return values[pose] + s * (values[following] - values[pose])

    bump = (4 * x * (1 - x))[:, None] ** 3
    turns = np.concatenate([turns, np.zeros((1, 3))])
    about = np.cross(turns, rng.standard_normal(turns.shape))
    about /= np.maximum(np.linalg.norm(about, axis=1), 1e-12)[:, None]
    # a quick hand has no time to wander: its acceleration stays below about 1 g
    room = np.append(np.minimum(1, 4 * seconds[1::2] ** 2), 0)[:, None]
    swing = room[:, 0] * rng.uniform(2, 8, count) * DEGREE, rng.uniform(0.7, 1.6, count)
    size = swing[0][pose] * np.sin(2 * np.pi * swing[1][pose] * x)
    small = bump * size[:, None] * about[pose]
    if "settle" in parts:
        small = small + decaying_tilt(t - edges[piece], seconds, pose, moving, s, seed)
    if "tremor" in parts:
        # a hand holds a part of the poses or all; the first time the device lies on a table
        random = stream(seed, "held")
        share = random.choice([0.3, 0.6, 1.0])
        by_hand = (random.random((count, 1)) < share).astype(float)
        by_hand[0] = 0
        small = small + course(by_hand) * hand_tremor(t, seed)
    attitude = attitudes[pose] * Rotation.from_rotvec(s * turns[pose])
    attitude = attitude * Rotation.from_rotvec(small)
    arm = rng.uniform(0.03, 0.1) * sphere(50)[rng.integers(50)]
    way = np.cumsum(np.roll(room, 1, axis=0) * rng.normal(0, 0.1, (count, 3)), axis=0)
    place = course(way) + attitude.apply(arm)
    place += 0.01 * bump * room[pose] * waves(t, 0.5, 2, rng)
    # means over the steps before and after, so that both sensors feel the same instant
    step = (attitude[:-1].inv() * attitude[1:]).as_rotvec() * rate
    angular_rate, acceleration = np.zeros((2, len(t), 3))
    angular_rate[1:-1] = (step[1:] + step[:-1]) / 2
    acceleration[1:-1] = np.diff(place, 2, axis=0) * rate**2
    force = attitude.inv().apply(acceleration + np.array([0, 0, GRAVITY]))
    rests = np.column_stack([edges[:-1:2], edges[1::2]])
    return Motion(t, attitude, angular_rate, force, 1 - bump, rests)


def decaying_tilt(since, seconds, pose, moving, s, seed):
    """Return the tilt that decays after the device was put down on something soft, (n, 3)."""
    rng, count = stream(seed, "settle"), len(seconds) // 2 + 1
    tau = rng.uniform(1, 3, count)
    tilt = rng.uniform(0.05, 0.3, count)[:, None] * DEGREE * rng.permutation(sphere(count))
    # it lay there before the log began
    tilt[0] = 0
    slip = tilt * np.exp(-seconds[::2] / tau)[:, None]
    at_rest = tilt[pose] * np.exp(-since / tau[pose])[:, None]
    return np.where(moving[:, None], (1 - s) * slip[pose] + s * np.roll(tilt, -1, 0)[pose], at_rest)


def hand_tremor(t, seed):
    """Return the tremor and the sway of a hand, rotation vectors, rad, (n, 3)."""
    rng = stream(seed, "tremor")
    f, fine, coarse = rng.uniform(6.5, 11.5), rng.uniform(0.005, 0.03), rng.uniform(0.05, 0.3)
    tremor = fine * waves(t, f - 0.5, f + 0.5, rng)
    return DEGREE * (tremor + coarse * waves(t, 0.05, 0.5, rng))


def fan_vibration(motion, seed):
    """Return the vibration of a table with a fan: specific force and angular rate, (n, 3) each."""
    rng = stream(seed, "fan")
    f, force, turn = rng.uniform(20, 120), rng.uniform(0.05, 0.5), rng.uniform(0.05, 0.5) * DEGREE
    wander = 0.05 * waves(motion.t, 0.01, 0.1, rng)[:, :1]
    phase = 2 * np.pi * f * motion.t[:, None] + wander + rng.uniform(0, 2 * np.pi, 3)
    axes = sphere(50)[rng.integers(50, size=2)]
    wave = motion.on_table * np.sin(phase)
    return force * axes[1] * wave, turn * axes[0] * wave


def true_sensors(rng):
    """Return T, K, b of a middle-grade accelerometer and gyroscope."""
    signs = rng.choice([-1, 1], (2, 5, 3))
    both = []
    for sign, low, high in zip(signs, (0.05, 0.2 * DEGREE), (0.3, 1.0 * DEGREE), strict=True):
        T = np.eye(3)
        T[np.triu_indices(3, 1)] = sign[0] * rng.uniform(0.005, 0.02, 3)
        T[np.tril_indices(3, -1)] = sign[1] * rng.uniform(0.005, 0.02, 3)
        K = 1 + sign[2] * rng.uniform(0.01, 0.02, 3)
        both.append(Sensor(T, K, sign[3] * rng.uniform(low, high, 3)))
    force, turn = both
    return Sensor(np.triu(force.T), force.K, force.b), turn


def true_noise(rng):
    """Return white noise (SI/√Hz), flicker (SI) and random walk (SI/√s) of both, log-uniform."""
    force = (8e-4, 2.2e-3), (1e-4, 5e-4), (1e-6, 3e-5)
    turn = *np.multiply([(0.004, 0.014), (2 / 3600, 12 / 3600)], DEGREE), (3e-7, 3e-6)
    return [[a * (b / a) ** rng.uniform() for a, b in ranges] for ranges in (force, turn)]


def slow_noise(n, rate, flicker, walk, rng):
    """Return flicker, a Gauss–Markov process per decade, and random walk, (n, 3)."""
    noise = np.cumsum(rng.standard_normal((n, 3)) * walk / np.sqrt(rate), axis=0)
    for tau in 0.5 * 10.0 ** np.arange(4):
        keep = np.exp(-1 / rate / tau)
        drive = rng.standard_normal((n, 3)) * np.sqrt(1 - keep**2)
        drive[0] /= np.sqrt(1 - keep**2)
        # S(f) = B²/(π f): a variance of ln 10 B²/π per decade
        size = flicker * np.sqrt(np.log(10) / np.pi)
        noise += size * lfilter([1], [1, -keep], drive, axis=0)
    return noise


def temperature(t, parts, seed):
    """Return true and logged temperature, °C, (n,) each; the logged one perhaps None."""
    rng, x = stream(seed, "temperature"), t / t[-1]
    start, span, lag = rng.uniform(18, 30), rng.uniform(8, 20), rng.uniform(10, 60)
    shape, logged = rng.integers(3), rng.random() < 0.5
    noise = 0.02 * rng.standard_normal(len(t))
    if not {"temperature", "thermometer_lag"} & set(parts):
        true = start + 1.5 * rng.random() * (1 - np.exp(-4 * x))
        return true, np.round(true + noise, 2) if logged else None
    # up at an even rate, up and down, or towards the temperature of the warm device
    true = start + span * (x, 1 - np.abs(2 * x - 1), 1 - np.exp(-3 * x))[shape]
    read = true
    if "thermometer_lag" in parts:
        keep = np.exp(-(t[1] - t[0]) / lag)
        read = lfilter([1 - keep], [1, -keep], true, zi=[keep * true[0]])[0]
    return true, np.round(read + noise, 2)


def arrivals(t, seed):
    """Return when a host stamps the samples: late, in packets, now and then very late."""
    rng = stream(seed, "usb")
    packet, late = int(rng.integers(1, 6)), rng.uniform(0.0005, 0.003)
    last = np.minimum(np.arange(len(t)) // packet * packet + packet - 1, len(t) - 1)
    stamps = t[last] + rng.exponential(late, len(t))[last]
    for at in rng.uniform(0, t[-1], rng.poisson(t[-1] / 15)):
        # the host is busy; what piles up comes at once
        until = at + rng.uniform(0.02, 0.06)
        stamps[(stamps > at) & (stamps < until)] = until
    stamps = np.maximum.accumulate(stamps)
    # what comes at once is stamped 20 µs apart
    new = np.concatenate([[True], np.diff(stamps) > 0])
    waited = np.arange(len(t)) - np.maximum.accumulate(np.where(new, np.arange(len(t)), 0))
    return np.maximum.accumulate(stamps + 2e-5 * waited)


def record(seed, case="clean", noise=True):
    """Return the Recording of a device; `noise` is False for closed forms."""
    rng, parts = stream(seed, "device"), parts_of(case, seed)
    sensors, noises = true_sensors(rng), true_noise(rng)
    rate = float(rng.choice([50, 62.5, 100, 125, 200, 250, 400]))
    corner = rng.uniform(0.4, 0.9) * rate
    every = int(np.ceil(INTERNAL / rate))
    motion = move(seed, parts, every * rate)
    felt = [motion.force, motion.angular_rate]
    if "fan" in parts:
        felt = np.add(felt, fan_vibration(motion, seed))
    rng_of_case = stream(seed, "case")
    if "lowpass" in parts:
        corner = min(rng_of_case.uniform(20, 50), 0.35 * rate)
    b, a = butter(2, corner / (every * rate / 2))
    t = motion.t[::every]
    true, read = temperature(t, parts, seed)
    slopes, steps, jump = effects(parts, rng_of_case, t[-1])
    logged, truth, still = [], [], at_rest(t, motion.rests)
    for k, (sensor, (white, *others)) in enumerate(zip(sensors, noises, strict=True)):
        random, out = stream(seed, f"noise {k}"), sensor.raw(felt[k])
        if noise:
            out += random.standard_normal(out.shape) * white * np.sqrt(every * rate)
            zi = lfilter_zi(b, a)[:, None] * out[:200].mean(axis=0)
            out = lfilter(b, a, out, axis=0, zi=zi)[0]
            slow = slow_noise(len(t), rate, *others, random)
            out[::every] += slow
            # the mean bias while it rested is the truth
            sensor = Sensor(sensor.T, sensor.K, sensor.b + slow[still].mean(axis=0))
        truth.append(sensor)
        logged.append(out[::every])
    log = {}
    middle = float(true.mean())
    seen = [true[(t >= start) & (t < end)].mean() for start, end in motion.rests]
    extremes = float(min(seen)), float(max(seen))
    recording = Recording(
        case, parts, seed, rate, *truth, motion.rests, log, slopes, steps, jump, middle, extremes
    )
    values = np.hstack([out + recording.bias(k, t, true) for k, out in enumerate(logged)])
    values = digitise(values, parts, rng_of_case)
    log.update(t=arrivals(t, seed) if "usb" in parts else t)
    log.update(zip(CHANNELS, values.T, strict=True))
    log.update({} if read is None else {"temperature": read})
    if "lossy" in parts:
        # each by itself, as a radio loses them
        kept = rng_of_case.random(len(t)) < KEPT
        log.update({name: column[kept] for name, column in log.items()})
    return recording


def at_rest(t, rests):
    """Return which instants lie in a rest, (n,)."""
    return np.searchsorted(rests.ravel(), t, side="right") % 2 == 1


def effects(parts, rng, duration):
    """Return the slopes over temperature and the steps of both sensors, and when these happen."""
    slopes, steps, jump = np.zeros((2, 3)), np.zeros((2, 3)), rng.uniform(0.3, 0.7) * duration
    signs = rng.choice([-1, 1], (4, 3))
    if {"temperature", "thermometer_lag"} & set(parts):
        slopes[0] = signs[0] * rng.uniform(0.002, 0.01, 3)
        slopes[1] = signs[1] * rng.uniform(0.01, 0.05, 3) * DEGREE
    if "jump" in parts:
        steps[0] = signs[2] * rng.uniform(0.02, 0.1, 3)
        steps[1] = signs[3] * rng.uniform(0.1, 0.5, 3) * DEGREE
        # of one sensor or both
        steps[[[0], [1], []][rng.integers(3)]] = 0
    return tuple(slopes), tuple(steps), jump


def digitise(log, parts, rng):
    """Return the output, (n, 6), as the digital side of the device hands it over."""
    if "spikes" in parts:
        count = rng.poisson(len(log) / rng.uniform(1000, 4000))
        where = rng.integers(len(log), size=count), rng.integers(6, size=count)
        size = np.where(where[1] < 3, 50, 10) * 10 ** rng.uniform(-1.5, 0, count)
        log[where] += size * rng.choice([-1, 1], count)
    if "clipping" in parts:
        log[:, 3:] = np.clip(log[:, 3:], -RAIL * DEGREE, RAIL * DEGREE)
    if "quantised" in parts:
        bits = rng.integers(12, 17), rng.integers(13, 17)
        ranges = rng.choice([2, 4, 8]) * GRAVITY, rng.choice([500, 1000]) * DEGREE
        steps = np.repeat([2 * r / 2**n for r, n in zip(ranges, bits, strict=True)], 3)
        log = np.round(log / steps) * steps
    return log
