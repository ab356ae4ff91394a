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
    usable,
    with_sessions,
)
from imuloop.calibrate.force import calibrated_force
from imuloop.calibrate.known_rotation import read_turns
from imuloop.calibrate.pose_fits import AccelerometerPoses, GyroscopePoses
from imuloop.calibrate.recording import Recording
from imuloop.core.files import read_json
from imuloop.core.model import Calibration
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import SENSORS
from imuloop.core.tables import joined
from imuloop.diagnose.records.motion import diagnose_motion
from imuloop.diagnose.records.one_solution import with_reference
from imuloop.diagnose.records.pose_diagnosis import (
    diagnose_poses,
    directions_without,
    pose_candidates,
)
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
    sensors: dict  # AccelerometerPoses and GyroscopePoses, by sensor
    recording: Recording  # all poses and rotations
    # Solution of each sensor from all poses, effects included; None where they determine none
    solutions: dict
    # Effects of each sensor that all poses show; None where they could not be tested
    effects: dict
    # `found` and `information` of PoseProblem by sensor: what the static records show
    shown: dict
    names: list  # of the recording's sessions
    tests: int  # number of tests that share the significance
    tables: dict  # columns of poses.parquet and moves.parquet
    motion: tuple = ()  # MotionPoses and the Solution of what the moves show


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
    `imuloop.discover.beyond.beyond`, where effects are to be looked for that no library has.
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
    of_own_session, shown = "static" in data.kinds.values(), dict.fromkeys(SENSORS, ((), None))
    if of_own_session:
        warm = recording.poses.temperature is not None
        shown = {sensor: still.shown(sensor, warm) for sensor in SENSORS}
    # without a ramp too, which the poses do not have, but which would count as slow noise there
    noise = still.noise
    units = (multi.accelerometer.raw_unit, multi.gyroscope.raw_unit)
    force_model = AccelerometerPoses(noise, gravity, units[0], calibrate_settings)

    def of_directions(calibration):
        """Return χ² and reduced χ² of a gyroscope by gravity as an accelerometer has it."""
        model = GyroscopePoses(noise, calibration, units[1], calibrate_settings)
        if model.untestable(recording):
            return 0.0, 1.0
        found = model.fit(recording).fit
        return found.chi2, found.reduced_chi2

    force = diagnose_poses(
        force_model,
        recording,
        settings,
        tests,
        *shown["accelerometer"],
        beyond=beyond,
        misfit=of_directions,
    )

    def directions(out):
        """Return gravity's direction at the poses by an accelerometer that lacks some parts."""
        return directions_without(force.choices, out, force.effects, force.formula)

    gravity_by = force.solution.calibration if force.solution else base.accelerometer
    turn_model = GyroscopePoses(noise, gravity_by, units[1], calibrate_settings)
    seen = directions if force.choices else None
    turns = read_turns(sessions, gravity_by)
    turns = turns.rows() if len(turns) else None
    # what an accelerometer lacks turns the direction by which a gyroscope is judged
    lacks = force.content.get("discovered", {}).get("status", "nothing") != "nothing"
    how = *shown["gyroscope"], seen, turns, None if lacks else beyond
    turn = diagnose_poses(turn_model, recording, settings, tests, *how)
    found = dict(zip(SENSORS, (force, turn), strict=True))
    solutions = {sensor: each.solution for sensor, each in found.items()}
    for each in found.values():
        if "why" in each.content:
            each.content["why"] = with_sessions(each.content["why"], sessions)
    pair = [(m, each.solution) for m, each in ((force_model, force), (turn_model, turn))]
    motion = diagnose_motion(*pair, recording, settings, tests, shown, beyond)
    # a gyroscope is calibrated against gravity as the accelerometer with its effects has it
    anew = bool(force.solution and force.solution.calibration.effects)
    anew = anew or calibrate_settings.gyroscope_bias != "initial_rest"
    final = replace(
        base,
        **{
            sensor: final_calibration(
                getattr(base, sensor),
                solution,
                still.effects[sensor] if of_own_session or not solution else (),
                records[sensor],
                anew,
            )
            for sensor, solution in solutions.items()
        },
    )
    final = replace(final, **motion.calibrations)
    final = as_seen(final, solutions, recording, (records, still.effects), noise)
    beside = diagnose_references(sessions, noise, gravity, settings, tests, final, beyond)
    final = with_reference(final, beside)
    names, faces = (
        [name for name, session in sessions.items() if usable({name: session}, *kinds)]
        for kinds in (POSED, ("six_position",))
    )
    residuals = force.residuals | turn.residuals | motion.residuals
    # with the effects of the rotations alone: those at rest may need what is not logged here
    turned = turn.solution.calibration if turn.solution else base.gyroscope
    seen_force = calibrated_force(turn_model.accelerometer, recording, noise)
    # the six faces are not diagnosed
    six = poses_table(read_poses(sessions, "six_position"), faces, {})
    blocks = {s: (found[s].content, still.content[s], motion.contents[s]) for s in SENSORS}
    content = _content(device, blocks, beside)
    verdicts = {s: of_calibration(content["sensors"][s], of_own_session) for s in SENSORS}
    final = replace(final, **{s: replace(getattr(final, s), verdict=verdicts[s]) for s in verdicts})
    return Diagnosed(
        content,
        final,
        still.allan,
        dict(zip(SENSORS, (force_model, turn_model), strict=True)),
        recording,
        solutions,
        {sensor: each.effects for sensor, each in found.items()},
        shown,
        names,
        tests,
        {
            "poses": joined([poses_table(recording.poses, names, residuals), six]),
            "moves": moves_table(recording, names, turned, seen_force, residuals),
            "reference": windows_table(beside),
        },
        motion.fit,
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


def final_calibration(base, solution, effects, records, anew):
    """Return the calibration of a sensor with every effect that was found.

    The model that was diagnosed, its covariance too: `solution`, of the poses; one without effects
    counts only if `anew`, not where the bias is held at the first rest. Where the poses determine
    none, the static records' effects are added to the base calibration; the bias of a gyroscope
    that only rested then is its level without them.
    """
    if solution and (anew or solution.calibration.effects):
        return solution.calibration
    if not effects:
        return base
    b = base.b
    if base.method == "static":
        left = [r.values - sum(e.output(r.channels) for e in effects) for r in records]
        lengths = np.concatenate([r.length for r in records])
        b = b + np.average(np.concatenate(left), axis=0, weights=lengths) / base.K
    return replace(base, b=b, effects=effects)


def as_seen(calibration, solutions, recording, static, noise):
    """Return the calibration with every effect held to what the data show.

    Those of a sensor with a solution were seen at the poses, the gyroscope's along the rotations
    too; `static` are by sensor the static records, and the effects that they show.
    """
    force, turn = calibration.accelerometer, calibration.gyroscope
    poses, rate = {sensor: [] for sensor in SENSORS}, recording.poses.w
    if solutions["accelerometer"] and force.effects:
        poses["accelerometer"] = [recording.pose_channels("accelerometer", force.output, rate)]
    if solutions["gyroscope"] and turn.effects:
        f = calibrated_force(force, recording, noise)
        poses["gyroscope"] = [
            recording.pose_channels("gyroscope", turn.output, f.poses),
            recording.rotation_channels("gyroscope", turn.output, f.rotations),
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
