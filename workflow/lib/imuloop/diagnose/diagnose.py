"""Diagnose a device: is anything missing in its model, what is it, and what remains with it."""

from dataclasses import dataclass, replace

import numpy as np

# the library of effects joins by being loaded
import imuloop.effects  # noqa: F401
from imuloop.calibrate.calibrate import (
    POSED,
    best,
    read_poses,
    read_recording,
    sensor_pair,
    usable,
    with_sessions,
)
from imuloop.calibrate.known_rotation import read_turns
from imuloop.calibrate.recording import Recording
from imuloop.calibrate.sensor_pair import OfSensor
from imuloop.core.files import read_json
from imuloop.core.model import Calibration
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import SENSORS
from imuloop.core.tables import joined
from imuloop.diagnose.records.motion import diagnose_motion
from imuloop.diagnose.records.one_solution import with_reference
from imuloop.diagnose.records.pose_diagnosis import PoseResult, diagnose_poses, pose_candidates
from imuloop.diagnose.records.pose_tables import moves_table, poses_table
from imuloop.diagnose.records.reference import (
    diagnose_references,
    windows_table,
)
from imuloop.diagnose.records.rests import read_static
from imuloop.diagnose.records.static_diagnosis import diagnose_static, static_tests
from imuloop.diagnose.verdict import not_testable, of_calibration

# version of the JSON file
FORMAT = 1
# kinds of records that it has of a sensor
RECORDS = ("poses", "static_record", "motion")


@dataclass(frozen=True)
class Diagnosed:
    """The diagnosis of a device, and what its validation and the next recording take from there."""

    content: dict  # content of diagnosis.json, but for the next recording
    calibration: Calibration  # with the effects that were added
    # Allan table without the effects, by session; empty where nothing was taken out
    allan: dict
    noise: NoiseModel  # without the effects of the static records
    poses: PoseResult
    recording: Recording  # all poses and rotations
    names: list  # of the recording's sessions
    tables: dict  # columns of poses.parquet and moves.parquet
    motion: tuple = ()  # SensorPair and the Solution of what the moves show


def diagnose_device(
    *,
    device,
    gravity,
    sessions,
    noise,
    six_position,
    multi_position,
    calibrate_settings,
    settings,
    noise_settings,
    beyond=None,
):
    """Return the Diagnosed of a device, by its name.

    Takes local gravity, m/s^2, ``kind``, ``samples`` and ``segments`` (paths) of each session by
    name, paths of the results of the stages before, and settings: of the calibration, repeated with
    effects, of the diagnosis, and of the noise stage, repeated without them. `beyond` is
    `search_formulas` of `imuloop.discover`, where effects are to be looked for that no library has.
    """
    model = NoiseModel.from_json(noise)
    multi, base = Calibration.from_json(multi_position), calibrated(six_position, multi_position)
    recording = read_recording(sessions, calibrate_settings.longest_rotation)
    data = read_static(sessions)
    records = {s: data.records(s, base, settings.mean_time) for s in SENSORS}
    tests = settings.family * (
        static_tests(records, settings)
        + sum(len(pose_candidates(sensor, recording)[0]) for sensor in SENSORS)
    )
    # first the static records: the poses have their effects too, and the noise without these; but
    # a rest of the poses' own log is one attitude and a start, and they judge for themselves
    still = diagnose_static(
        *(data, records, base, model, read_json(noise)["curve_fit"]),
        *(settings, noise_settings, tests, beyond),
    )
    of_own_session = "static" in data.kinds.values()
    found, information = (), None
    if of_own_session:
        found, information = of_static_records(still, recording.poses.temperature is not None)
    # without a ramp too, which the poses do not have, but which would count as slow noise there
    noise = still.noise
    units = {sensor: getattr(multi, sensor).raw_unit for sensor in SENSORS}
    pair, reasons = sensor_pair(
        recording,
        noise,
        gravity,
        units,
        replace(calibrate_settings, gyroscope_bias="rests"),
        base.accelerometer if base.accelerometer.method == "six_position" else None,
        read_turns(sessions, base.accelerometer),
    )
    reasons = {sensor: with_sessions(reason, sessions) for sensor, reason in reasons.items()}
    how = recording, settings, tests
    poses = diagnose_poses(pair, reasons, *how, found, information, beyond)
    motion = diagnose_motion(pair, poses.solution, *how, information, beyond)
    # a gyroscope is calibrated against gravity as the accelerometer with its effects has it
    force = poses.calibrations.get("accelerometer")
    anew = bool(force and force.effects) or calibrate_settings.gyroscope_bias != "initial_rest"
    final = replace(
        base,
        **{
            sensor: final_calibration(
                getattr(base, sensor),
                own,
                still.effects[sensor] if of_own_session or not own else (),
                records[sensor],
                anew,
            )
            for sensor in SENSORS
            for own in [poses.calibrations.get(sensor)]
        },
    )
    final = replace(final, **motion.calibrations)
    final = as_seen(final, poses.calibrations, recording, (records, still.effects))
    beside = diagnose_references(sessions, noise, gravity, settings, tests, final, beyond)
    final = with_reference(final, beside)
    names, faces = (
        [name for name, session in sessions.items() if usable({name: session}, *kinds)]
        for kinds in (POSED, ("six_position",))
    )
    residuals = poses.residuals | motion.residuals
    # with the effects of the rotations alone: those at rest may need what is not logged here
    turned = poses.calibrations.get("gyroscope", base.gyroscope)
    seen_force = recording.calibrated_force(force or base.accelerometer)
    # the six faces are not diagnosed
    six = poses_table(read_poses(sessions, "six_position"), faces, {})
    blocks = {s: (poses.contents[s], still.content[s], motion.contents[s]) for s in SENSORS}
    content = _content(device, blocks, beside)
    verdicts = {s: of_calibration(content["sensors"][s], of_own_session) for s in SENSORS}
    final = replace(final, **{s: replace(getattr(final, s), verdict=verdicts[s]) for s in verdicts})
    return Diagnosed(
        content,
        final,
        still.allan,
        noise,
        poses,
        recording,
        names,
        {
            "poses": joined([poses_table(recording.poses, names, residuals), six]),
            "moves": moves_table(recording, names, turned, seen_force[1], residuals),
            "reference": windows_table(beside),
        },
        (motion.pair, motion.solution) if motion.solution else (),
    )


def undiagnosed(device, why):
    """Return the content of diagnosis.json where nothing could be tested, with the reason."""
    return _content(device, dict.fromkeys(SENSORS, (not_testable(why),) * len(RECORDS)))


def _content(device, blocks, beside=()):
    """Return the content of diagnosis.json, of each sensor's records in the order of `RECORDS`.

    `beside` are ReferenceResults by sensor.
    """
    sensors = {sensor: dict(zip(RECORDS, own, strict=True)) for sensor, own in blocks.items()}
    for sensor in beside:
        sensors[sensor]["reference"] = beside[sensor].content
    return {"format": FORMAT, "device": device, "sensors": sensors}


def calibrated(six_position, multi_position):
    """Return the calibration that the stages before give: of each sensor what rests on most."""
    six, multi = Calibration.from_json(six_position), Calibration.from_json(multi_position)
    return replace(
        multi,
        accelerometer=best(multi.accelerometer, six.accelerometer),
        gyroscope=best(multi.gyroscope, six.gyroscope),
    )


def of_static_records(still, warm):
    """Return what static records say of a device's poses: effects, and what PoseProblem takes.

    Takes the StaticResult, and whether the poses have a temperature.
    """
    shown = {sensor: still.shown(sensor, warm) for sensor in SENSORS}
    found = tuple(OfSensor(e, s) for s, (effects, _) in shown.items() for e in effects)

    def information(effects):
        """Return A and b as of `static.information`; zero for what a static record cannot show."""
        ends = np.cumsum([0, *(len(e.parameters) for e in effects)])
        whole, moment = np.zeros((ends[-1],) * 2), np.zeros(ends[-1])
        for sensor, (known, of_record) in shown.items():
            own = [
                k
                for k, e in enumerate(effects)
                if e.sensor == sensor
                and (e.effect in known or ("temperature" in e.needs and not e.timed))
            ]
            if of_record and own:
                at = np.concatenate([np.arange(ends[k], ends[k + 1]) for k in own])
                own, right = of_record(tuple(effects[k].effect for k in own))
                whole[np.ix_(at, at)], moment[at] = own, right
        return whole, moment

    shows = any(of_record for _, of_record in shown.values())
    return found, information if shows else None


def final_calibration(base, found, effects, records, anew):
    """Return the calibration of a sensor with every effect that was found.

    The model that was diagnosed, its covariance too: `found`, by the poses; one without effects
    counts only if `anew`, not where the bias is held at the first rest. Where the poses determine
    none, the static records' effects are added to the base calibration; the bias of a gyroscope
    that only rested then is its level without them.
    """
    if found and (anew or found.effects):
        return found
    if not effects:
        return base
    b = base.b
    if base.method == "static":
        left = [r.values - sum(e.output(r.channels) for e in effects) for r in records]
        lengths = np.concatenate([r.length for r in records])
        b = b + np.average(np.concatenate(left), axis=0, weights=lengths) / base.K
    return replace(base, b=b, effects=effects)


def as_seen(calibration, found, recording, static):
    """Return the calibration with every effect held to what the data show.

    Those of a sensor that the poses determine, by `found`, were seen there, the gyroscope's along
    the rotations too; `static` are by sensor the static records, and the effects that they show.
    """
    force, turn = calibration.accelerometer, calibration.gyroscope
    poses, rate = {sensor: [] for sensor in SENSORS}, recording.poses.w
    if "accelerometer" in found and force.effects:
        poses["accelerometer"] = [recording.pose_channels("accelerometer", force.output, rate)]
    if "gyroscope" in found and turn.effects:
        at_rest, along = recording.calibrated_force(force)
        poses["gyroscope"] = [
            recording.pose_channels("gyroscope", turn.output, at_rest),
            recording.rotation_channels("gyroscope", turn.output, along),
        ]

    along = []
    if any("motion" in e.effect.records for e in force.effects):
        rate = turn.aligned(recording.rotations.w)
        along = [recording.rotation_channels("accelerometer", force.output, rate, turn.aligned)]

    def held(sensor, effect):
        if sensor == "accelerometer" and "motion" in effect.effect.records:
            return effect.with_ranges(along)
        at_rest = effect.name in [each.name for each in static[1][sensor]]
        records = [r.channels for r in static[0][sensor]] if at_rest else []
        return effect.with_ranges(poses[sensor] + records)

    return replace(
        calibration,
        **{
            sensor: replace(own, effects=tuple(held(sensor, e) for e in own.effects))
            for sensor, own in zip(SENSORS, (force, turn), strict=True)
        },
    )
