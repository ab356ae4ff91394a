"""The truth of a simulated device, which a good calibration has to find."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import imuloop.effects  # noqa: F401  loads the library of effects
from imuloop.core.errors import ImuloopError
from imuloop.core.files import read_yaml
from imuloop.core.samples import SENSORS
from imuloop.core.units import STANDARD_GRAVITY
from imuloop.model.effect import FittedEffect

ZERO = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Popcorn:
    """Popcorn noise: the bias jumps by `size`, (3,), SI, and back, by turns at the `times`, s."""

    size: tuple
    times: tuple


@dataclass(frozen=True)
class Noise:
    """Noise coefficients of a sensor, for each of its three axes, in SI units of its output."""

    # quantisation (SI·s), white (SI/√Hz), flicker (SI), walk (SI/√s), ramp (SI/s)
    Q: tuple = ZERO
    N: tuple = ZERO
    B: tuple = ZERO
    K: tuple = ZERO
    R: tuple = ZERO
    steps: tuple[Popcorn, ...] = ()


@dataclass(frozen=True)
class SensorTruth:
    """The truth of one sensor, ``x = T (K (raw - b) - e)``, so ``raw = (T⁻¹x + e + noise)/K + b``.

    x is the true specific force or angular rate on body axes, raw the logged value, and e the sum
    of the effects. T is the matrix of the misalignments, K the scale factors and b the biases.
    """

    # unit that is logged: m/s^2, rad/s, count, …
    raw_unit: str
    # misalignment, (3, 3), unit diagonal; scale factor, SI per raw unit, and bias, raw units, (3,)
    T: np.ndarray
    K: np.ndarray
    b: np.ndarray
    noise: Noise = Noise()
    # step to which the logged value is rounded, raw units; 0 if it is not rounded
    step: float = 0.0
    # effects of the library, whose sum is part of e
    effects: tuple[FittedEffect, ...] = ()
    # an effect outside the library, added to e: function that takes Channels, returns (n, 3), SI
    extra: Callable | None = None


@dataclass(frozen=True)
class Disturbance:
    """A disturbance of a static session, in which the device should lie still."""

    # 'knock', a burst of acceleration; 'tilt', a lasting turn; 'handling', some seconds of motion
    # that ends where it began
    kind: str
    time_s: float
    # m/s^2 of a knock, degrees of the others
    size: float
    duration_s: float = 1.0
    # body axis of a tilt, of which only the level part counts; at random if not given
    axis: tuple | None = None


@dataclass(frozen=True)
class Vibration:
    """A motor under the table that runs during some poses, along another axis each time."""

    # share of the poses during which the motor runs; it never runs during the first pose
    share: float
    # smallest and largest acceleration, root mean square, m/s^2, and frequency, Hz
    rms: tuple
    frequency: tuple


@dataclass(frozen=True)
class Thermometer:
    """The thermometer of a simulated device: lag, noise and rounding of the logged temperature."""

    # time constant with which it follows the temperature of the device, s
    lag_s: float = 0.0
    # standard deviation of a sample, and step to which it is rounded, K; 0 for none
    noise: float = 0.0
    step: float = 0.0


@dataclass(frozen=True)
class SessionTruth:
    """The plan of one simulated session: its kind, rests, moves, disturbances and temperature."""

    # 'static', 'six_position' or 'multi_position'
    kind: str
    # number from which all of the session's random numbers follow
    seed: int = 0
    # upward direction on body axes in a static session, or before the first pose of other sessions;
    # sessions of six faces begin with z up
    up: tuple = (0.0, 0.0, 1.0)
    # for static sessions: length, s, and the disturbances in order of time
    duration_s: float = 7200.0
    disturbances: tuple[Disturbance, ...] = ()
    # length of the first rest in sessions of the other kinds, s
    initial_rest_s: float = 50.0
    # number of poses after the first rest (multi_position); number of rounds over the six faces
    # (six_position)
    poses: int = 40
    repeats: int = 1
    # placement error of a face, standard deviation about each level axis, degrees
    placement_deg: float = 0.2
    # shortest and longest rest and move, s
    rest_s: tuple = (3.0, 6.0)
    move_s: tuple = (1.0, 2.5)
    # number of poses in which the device is turned slowly about the vertical, which the
    # accelerometer does not see, and rests again
    turns_about_vertical: int = 0
    # motor that runs during some poses (multi_position)
    vibration: Vibration | None = None
    # temperature of the surroundings as knots (s, degC), linear between them; if there are none,
    # the log has no temperature
    temperature: tuple = ()
    # time constant with which the device follows its surroundings, s
    thermal_s: float = 0.0
    # change of the three biases in this power cycle, raw units, (3,), by name of the sensor
    turn_on: dict | None = None


@dataclass(frozen=True)
class Truth:
    """The truth of a simulated device: sensors, thermometer, and plans of its sessions."""

    name: str  # name in the metadata of the logs
    accelerometer: SensorTruth
    gyroscope: SensorTruth
    sessions: dict[str, SessionTruth]  # plan of each log by name
    gravity: float = STANDARD_GRAVITY  # local gravity, m/s^2
    rate: float = 100.0  # sampling rate, Hz
    thermometer: Thermometer = Thermometer()


def read_truth(path):
    """Return the Truth of a simulated device from the YAML file at `path`.

    Examples are the files of data/replicas. Raises an ImuloopError if the file does not hold a
    truth.
    """
    content = read_yaml(path)
    try:
        parts = {name: _sensor(**content[name]) for name in SENSORS}
        parts["sessions"] = {k: _session(**plan) for k, plan in content["sessions"].items()}
        return Truth(**content | parts)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ImuloopError(f"{path}: not a truth: {error!r}") from error


def _sensor(noise, effects=(), **fields):
    """Return a SensorTruth from the entries of one sensor in the YAML file of a truth.

    `noise` is a dict of noise coefficients, with the values of the three axes. `effects` has a dict
    for each FittedEffect. `fields` are T, K, b and other fields of the SensorTruth.
    """
    floats = {key: np.asarray(fields.pop(key), dtype=float) for key in "TKb"}
    coefficients = {key: tuple(map(float, value)) for key, value in noise.items()}
    effects = tuple(FittedEffect.from_dict(effect) for effect in effects)
    return SensorTruth(noise=Noise(**coefficients), effects=effects, **floats, **fields)


def _session(disturbances=(), **plan):
    """Return a SessionTruth from the entries of one session in the YAML file of a truth.

    `disturbances` has a dict of fields for each Disturbance. `plan` has all other entries, which
    are fields of the SessionTruth.
    """
    return SessionTruth(disturbances=tuple(Disturbance(**d) for d in disturbances), **plan)


def example_truth(**changes):
    """Return the Truth in ``example.yaml``, a middle-grade MEMS device, with changes.

    `changes` are attributes of the Truth with new values, such as ``rate=200.0``. Unchanged, the
    device has a rate of 100 Hz, misalignments and scale factor errors of some 0.5 %, and white and
    flicker noise only. Its sessions are half an hour at rest, six positions and many positions.
    """
    return replace(read_truth(Path(__file__).with_name("example.yaml")), **changes)
