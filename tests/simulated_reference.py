"""A device moved by hand in motion capture: both logs, with a known truth."""

from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from imuloop.core.rotation import exponential, prefix_product, step_vectors

# Hz; of the grid on which motion is made, of the log and of the reference
GRID, RATE, REFERENCE_RATE = 2000.0, 200.0, 100.0
# rad/s and m, root mean square of an axis; Hz, of the fastest motion
TURNS, PLACES, FASTEST = 1.2, 0.12, 1.5
REST = 8.0
# rad/s/√Hz and m/s²/√Hz
WHITE = {"gyroscope": 1e-4, "accelerometer": 1e-3}


@dataclass(frozen=True)
class Beside:
    """Errors of a device that its data sheet does not state, and the quality of its reference; SI.

    `dt`, by sensor, and `drift` are time_offset and clock_drift, `arm` is from marker to sensor,
    T, K and b belong to both sensors; a b that is not given is drawn.
    """

    duration_s: float = 120.0
    dt: dict = field(default_factory=dict)
    drift: float = 0.0
    arm: tuple = (0.0, 0.0, 0.0)
    T: dict = field(default_factory=dict)
    K: dict = field(default_factory=dict)
    b: dict = field(default_factory=dict)
    attitude_noise: float = np.radians(0.2)
    place_noise: float = 1e-3
    lost: float = 0.03
    swapped: float = 0.005
    clock: tuple = (0.0, 0.0)  # s, and s per s, by which the reference's stamps are too late
    rests: int = 0  # besides the first, of `REST` s, evenly spread
    gravity: float = 9.80665


def _wander(rng, t, size):
    """Return a sum of sines of three axes, (n, 3), of a root mean square."""
    frequency = rng.uniform(0.05, FASTEST, (12, 3))
    phase = rng.uniform(0, 2 * np.pi, (12, 3))
    waves = np.sin(2 * np.pi * frequency * t[:, None, None] + phase).sum(axis=1)
    return size * waves / np.sqrt(6)


def _after(t, when):
    """Return a smooth step from 0 to 1 about an instant, s, in some tenths of a second."""
    return 1 / (1 + np.exp(-np.clip((t - when) / 0.3, -50, 50)))


def simulate_beside(truth, seed):
    """Return the columns of a log, ``t ax … gz``, and of its reference, ``t qw … px …``, SI.

    The device rests for 10 s, and is turned and carried about afterwards, but for its `rests`.
    """
    rng = np.random.default_rng(seed)
    # some time before and after, for sensors that are late
    t = np.arange(-0.5, truth.duration_s + 0.5, 1 / GRID)
    moves = _after(t, 10.0)
    for begin in np.linspace(10.0, truth.duration_s - REST, truth.rests + 1)[1:]:
        moves = moves + _after(t, begin + REST) - _after(t, begin)
    rate = _wander(rng, t, TURNS) * moves[:, None]
    place = _wander(rng, t, PLACES) * moves[:, None]
    steps = exponential(step_vectors(rate, np.diff(t)))
    q = np.concatenate([[[1.0, 0, 0, 0]], prefix_product(steps)])
    attitude = Rotation.from_quat(q, scalar_first=True)
    pushed = CubicSpline(t, place)(t, 2) + np.array([0, 0, truth.gravity])
    change, force = np.gradient(rate, t, axis=0), attitude.inv().apply(pushed)
    force = force + np.cross(change, truth.arm) + np.cross(rate, np.cross(rate, truth.arm))
    log = {"t": np.arange(0, truth.duration_s, 1 / RATE)}
    middle = log["t"][-1] / 2
    true = {"accelerometer": force, "gyroscope": rate}
    for sensor, names in (("accelerometer", "a"), ("gyroscope", "g")):
        at = log["t"] + truth.dt.get(sensor, 0.0)
        if sensor == "gyroscope":
            at = at + truth.drift * (log["t"] - middle)
        x = CubicSpline(t, true[sensor])(at)
        y = x @ np.linalg.inv(truth.T.get(sensor, np.eye(3))).T
        bias = rng.normal(0, 0.02 if sensor == "accelerometer" else 0.003, 3)
        y = y / truth.K.get(sensor, np.ones(3)) + truth.b.get(sensor, bias)
        y = y + rng.normal(0, WHITE[sensor] * np.sqrt(RATE), y.shape)
        log |= {f"{names}{axis}": v for axis, v in zip("xyz", y.T, strict=True)}
    at = np.arange(0, truth.duration_s, 1 / REFERENCE_RATE)
    near = np.round((at - t[0]) * GRID).astype(int)
    noise = Rotation.from_rotvec(rng.normal(0, truth.attitude_noise, (len(at), 3)))
    seen = attitude[near] * noise
    p = place[near] + rng.normal(0, truth.place_noise, (len(at), 3))
    # a marker that is taken for another, for some samples on end
    swapped = np.repeat(rng.uniform(size=len(at) // 5 + 1) < truth.swapped, 5)[: len(at)]
    wrong = Rotation.from_rotvec(np.array([0.3, 1.1, -0.5])[None] * swapped[:, None])
    quaternion = (seen * wrong).as_quat(scalar_first=True)
    lost = np.repeat(rng.uniform(size=len(at) // 10 + 1) < truth.lost, 10)[: len(at)]
    quaternion[lost], p[lost] = np.nan, np.nan
    late, gains = truth.clock
    stamps = at * (1 + gains) + late
    columns = np.column_stack([stamps, quaternion, p]).T
    return log, dict(zip(("t", "qw", "qx", "qy", "qz", "px", "py", "pz"), columns, strict=True))
