"""The devices of the study: their sessions, and the effects put into them."""

from dataclasses import dataclass, field, replace

import numpy as np

from imuloop.model.effect import find_effect
from imuloop.simulate.simulate import simulate_session, true_motion
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


# variants of a device of poses, in place of the usual one
PLANS = ("usual", "few", "alone", "ramp", "cycles")


def poses_device(plan="usual"):
    """Return a device of 80 poses, the motor on at half of them, and 20 min at rest.

    By `PLANS`: or 36 poses; no record at rest; a temperature that goes up evenly; or three sessions
    of 30 poses, the power switched off between them.
    """
    poses = SessionTruth(
        "multi_position",
        poses=36 if plan == "few" else 80,
        rest_s=(4.0, 8.0),
        temperature=((0, 24), (900, 38)) if plan == "ramp" else HEATED_POSES,
        thermal_s=15.0,
        vibration=MOTOR,
    )
    sessions = {"multi_position": poses}
    if plan == "cycles":
        sessions = {f"power_on_{k}": replace(poses, poses=30) for k in range(3)}
    if plan != "alone":
        rest = SessionTruth("static", duration_s=1200.0, temperature=((0, 24), (1200, 24)))
        sessions["static"] = rest
    return example_truth(name="study", sessions=sessions, thermometer=THERMOMETER)


def record_device(plan="usual"):
    """Return a device that rests for an hour in each of three attitudes while it is heated."""
    rest = SessionTruth("static", duration_s=3600.0, temperature=HEATED_RECORD, thermal_s=60.0)
    sessions = {
        "level": rest,
        "oblique": replace(rest, up=(0.8, 0.5, -0.33)),
        "turned": replace(rest, up=(-0.5, 0.7, 0.4)),
    }
    return example_truth(name="study", rate=10.0, sessions=sessions, thermometer=THERMOMETER)


def motion_device(plan="usual"):
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


def in_variant(truth, seed, injected, found, record):
    """Return the values that an injected effect has in the variant that a diagnosis found.

    Where the variant is the injected one they are those that were injected. Else, as for a time
    constant between two of those that are tried, they are the ones that come nearest to it at
    rest, by least squares with a bias in each session. A random effect has none. `found` is the
    entry of ``effects`` of the diagnosis, `record` the kind of data in which it was found.
    """
    if injected.extra is None:
        return {}
    if found["constants"] == injected.constants:
        return injected.values
    design = find_effect(found["name"])(**found["constants"]).design
    kinds = ("static",) if record == "static_record" else ("multi_position",)
    chosen = [name for name, plan in truth.sessions.items() if plan.kind in kinds]
    rows, effect = [], []
    for number, name in enumerate(chosen):
        seen = []
        watched = _sum(getattr(truth, injected.sensor).extra, lambda c, s=seen: s.append(c) or 0.0)
        sensor = replace(getattr(truth, injected.sensor), extra=watched)
        simulate_session(replace(truth, **{injected.sensor: sensor}), name, seed)
        still = np.flatnonzero(~true_motion(truth, name, seed).angular_rate.any(axis=1))[::10]
        level = np.zeros((len(still), 3, len(chosen), 3))
        level[:, range(3), number, range(3)] = 1.0
        columns = np.concatenate(
            [design(seen[-1])[still], level.reshape(len(still), 3, -1)], axis=2
        )
        rows.append(columns.reshape(-1, columns.shape[2]))
        effect.append(injected.extra(seen[-1])[still].ravel())
    rows, effect = np.concatenate(rows), np.concatenate(effect)
    scale = np.linalg.norm(rows, axis=0)
    nearest = np.linalg.lstsq(rows / scale, effect, rcond=None)[0] / scale
    return dict(zip(found["parameters"], nearest.tolist(), strict=False))
