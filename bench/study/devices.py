"""The devices of the study: their sessions, and the effects put into them."""

from dataclasses import dataclass, field, replace

import numpy as np

from imuloop.simulate.truth import SessionTruth, Thermometer, Vibration, example_truth

# temperatures of the surroundings that go up and down at several speeds, and rest, so that no two
# effects of the temperature look like each other: s, degC
HEATED_POSES = (
    (0, 24), (70, 24), (170, 38), (260, 38), (420, 27), (470, 27), (590, 34), (900, 34)
)  # fmt: skip
HEATED_RECORD = (
    (0, 24), (300, 24), (900, 44), (1300, 44), (2300, 27), (2700, 27), (3300, 36), (3600, 36)
)  # fmt: skip
MOTOR = Vibration(share=0.5, rms=(0.02, 0.028), frequency=(15.0, 45.0))
THERMOMETER = Thermometer(noise=0.02, step=0.01)


def poses_device():
    """Return a device of 80 poses, the motor on at half of them, and 20 min at rest."""
    poses = SessionTruth(
        "multi_position",
        poses=80,
        rest_s=(4.0, 8.0),
        temperature=HEATED_POSES,
        thermal_s=15.0,
        vibration=MOTOR,
    )
    rest = SessionTruth("static", duration_s=1200.0, temperature=((0, 24), (1200, 24)))
    sessions = {"multi_position": poses, "static": rest}
    return example_truth(name="study", sessions=sessions, thermometer=THERMOMETER)


def record_device():
    """Return a device that rests for an hour in each of three attitudes while it is heated."""
    rest = SessionTruth("static", duration_s=3600.0, temperature=HEATED_RECORD, thermal_s=60.0)
    sessions = {
        "level": rest,
        "oblique": replace(rest, up=(0.8, 0.5, -0.33)),
        "turned": replace(rest, up=(-0.5, 0.7, 0.4)),
    }
    return example_truth(name="study", rate=10.0, sessions=sessions, thermometer=THERMOMETER)


def motion_device():
    """Return a device of 40 moves of 1 to 2 s, at one temperature, and 20 min at rest."""
    even = ((0, 24), (1200, 24))
    moves = SessionTruth(
        "multi_position", poses=40, rest_s=(4.0, 5.0), move_s=(1.0, 2.0), temperature=even
    )
    rest = SessionTruth("static", duration_s=1200.0, temperature=even)
    sessions = {"multi_position": moves, "static": rest}
    return example_truth(name="study", sessions=sessions, thermometer=THERMOMETER)


# by the record that they are made for
DEVICES = {"poses": poses_device, "static_record": record_device, "motion": motion_device}


@dataclass(frozen=True)
class Injected:
    """What is put into one sensor of a device and declared nowhere."""

    sensor: str
    name: str  # in the library, or one of our own outside it
    values: dict = field(default_factory=dict)  # parameters, SI, by their names in the library
    constants: dict = field(default_factory=dict)  # of the variant
    limits: float = np.nan  # its size in detection limits
    extra: object = None  # its share of the output, from the `Channels` of a log
    noise: dict = field(default_factory=dict)  # or the processes that it adds to the noise


def with_effects(truth, injected):
    """Return the device with effects injected into its sensors."""
    for one in injected:
        sensor = getattr(truth, one.sensor)
        processes = {k: getattr(sensor.noise, k) + v for k, v in one.noise.items()}
        changes = {"noise": replace(sensor.noise, **processes)}
        if one.extra is not None:
            changes["extra"] = _sum(sensor.extra, one.extra)
        truth = replace(truth, **{one.sensor: replace(sensor, **changes)})
    return truth


def _sum(first, second):
    return second if first is None else lambda channels: first(channels) + second(channels)
