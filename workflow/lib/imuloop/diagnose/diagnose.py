"""Diagnosis of a device: the effects that its model lacks, and what remains unexplained."""

from dataclasses import dataclass, replace

import numpy as np

# this import registers the library of effects
import imuloop.effects  # noqa: F401
from imuloop.calibrate.calibrate import start_fit
from imuloop.calibrate.known_rotation import read_turns
from imuloop.calibrate.nominal import nominal_sensors
from imuloop.calibrate.recording import Recording
from imuloop.calibrate.sessions import GROUPS, largest_recording, read_poses, usable_sessions
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import SENSORS
from imuloop.core.tables import joined
from imuloop.diagnose.motion import diagnose_motion
from imuloop.diagnose.poses import (
    diagnose_poses,
    pose_candidates,
    pose_problem,
)
from imuloop.diagnose.record import PoseResult
from imuloop.diagnose.reference import diagnose_reference
from imuloop.diagnose.static import diagnose_static, static_tests
from imuloop.diagnose.static_means import read_static
from imuloop.diagnose.tables import moves_table, poses_table
from imuloop.estimate.verdict import calibration_verdict, not_testable
from imuloop.model.calibration import Calibration
from imuloop.model.calibration_faults import implausible_values
from imuloop.model.prior import data_sheet

# version of diagnosis.json
FORMAT = 1
# kinds of records that diagnosis.json has for a sensor
RECORDS = ("poses", "static_record", "motion")


@dataclass(frozen=True)
class Diagnosed:
    """The diagnosis of a device: results and intermediate values for validation and advice."""

    content: dict  # content of diagnosis.json without the next steps
    calibration: Calibration  # the model with the added effects
    # Allan table after subtracting the effects, by session; empty without effects
    allan: dict
    noise: NoiseModel  # noise after subtracting the effects of the static records
    poses: PoseResult
    recording: Recording  # all poses and rotations
    names: list  # names of the sessions in the recording
    tables: dict  # columns of poses.parquet, moves.parquet and reference.parquet


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
    prior=None,
):
    """Return the Diagnosed of a device: the effects that its model lacks, from all its records.

    Parameters
    ----------
    device : str
        Name of the device.
    gravity : float
        Local gravity, m/s^2.
    sessions : dict of str to dict
        ``kind``, and paths of ``samples`` and ``segments``, of each session by name.
    noise, six_position, multi_position : path
        Results of the noise stage and of both calibration stages.
    calibrate_settings, settings, noise_settings
        Settings of the calibration, the diagnosis and the noise stage. Calibration and noise are
        estimated again with the effects that the diagnosis adds.
    prior : Prior, optional
        Distribution of the parameters before the data; by default it follows from the data sheet.

    Returns
    -------
    Diagnosed
        Content of diagnosis.json, the calibration with effects, the noise, and tables.
    """
    # the kind of sessions with the most poses is diagnosed
    method, recording = largest_recording(sessions, calibrate_settings.longest_rotation)
    base = Calibration.from_json(six_position if method == "six_position" else multi_position)
    data, noise = read_static(sessions), NoiseModel.from_json(noise)
    records = data.records(base, settings.mean_time)
    tests = settings.family * (
        static_tests(records, settings)
        + sum(len(pose_candidates(sensor, recording)[0]) for sensor in SENSORS)
    )
    # static records are diagnosed first: the poses are diagnosed with the effects that static
    # records show, and with the noise without these effects
    static = diagnose_static(data, records, base, noise, settings, noise_settings, tests)
    # the ramp is left out of this noise, too: it would add slow noise, which poses do not show
    noise, has_static_session = static.noise, "static" in data.kinds.values()
    units = {sensor: getattr(base, sensor).raw_unit for sensor in SENSORS}
    turns = read_turns(sessions, base.accelerometer)
    joint_fit, reasons = start_fit(recording, noise, gravity, units, prior, turns)
    # without a static session, a long rest in the log of the poses is a static record. Its effects
    # are not used here: the poses themselves show effects better
    for_poses = static if has_static_session else None
    problem = joint_fit and pose_problem(joint_fit, recording, settings, tests, for_poses)
    poses = diagnose_poses(problem, reasons)
    # a sensor whose data contradict each other keeps its nominal scale
    refused = nominal_sensors(poses.rejected, recording, noise, units, prior or data_sheet())
    base = replace(base, **refused)
    motion = diagnose_motion(poses)
    bias_held = calibrate_settings.gyroscope_bias == "initial_rest"
    calibration = combine_calibrations(base, poses, static, records, has_static_session, bias_held)
    calibration = replace(calibration, **motion.calibrations)
    calibration = with_validity_ranges(calibration, poses, recording, records, static.effects)
    reference, windows = diagnose_reference(sessions, noise, gravity, settings, tests, calibration)
    names = _names(sessions, GROUPS[method])
    contents = dict(zip(RECORDS, (poses.contents, static.content, motion.contents), strict=True))
    contents |= {"reference": reference} if reference else {}
    by_sensor = {s: {record: c[s] for record, c in contents.items()} for s in SENSORS}
    # rotations that contradict all others, which were left out of the fit
    if left_out := recording.lost.contradicting:
        keys = ("session", "start_s", "end_s", "angle")
        by_sensor["gyroscope"]["poses"]["contradicting"] = [
            dict(zip(keys, (names[session], *values), strict=True)) for session, *values in left_out
        ]
    for sensor, by_record in by_sensor.items():
        fit = judge_calibration(getattr(calibration, sensor), sensor, by_record, data.kinds)
        calibration = replace(calibration, **{sensor: fit})
    residuals = poses.residuals | motion.residuals
    tables = {"poses": poses_table(recording.poses, names, residuals), "reference": windows}
    if method != "six_position":
        # the poses on six faces are in the table, but are not diagnosed
        six_faces = read_poses(sessions, "six_position")
        six_faces = poses_table(six_faces, _names(sessions, ("six_position",)), {})
        tables["poses"] = joined([tables["poses"], six_faces])
    # the calibration by the poses: effects of static records may need channels that poses lack
    force, gyroscope = (poses.calibrations.get(s, getattr(base, s)) for s in SENSORS)
    _, force_in_moves = recording.calibrated_force(force)
    tables["moves"] = moves_table(recording, names, gyroscope, force_in_moves, residuals)
    content = {"format": FORMAT, "device": device, "sensors": by_sensor}
    return Diagnosed(
        content=content,
        calibration=calibration,
        allan=static.allan,
        noise=noise,
        poses=poses,
        recording=recording,
        names=names,
        tables=tables,
    )


def _names(sessions, kinds):
    """Return the names of the sessions of some kinds that were not rejected, a list of str.

    `sessions` has a dict of each session by name, and `kinds` are the kinds that count.
    """
    return [name for name, session in sessions.items() if usable_sessions({name: session}, *kinds)]


def combine_calibrations(base, poses, static, records, has_static_session, bias_held):
    """Return the Calibration of both sensors with the effects that poses or static records show.

    A static record is a rest of minutes to hours, as a list of means.

    - A sensor gets the calibration by the poses if that calibration has effects, or if the bias at
      the poses counts.
    - Otherwise it gets the calibration in `base`, with the effects of its static records if they
      count.

    Parameters
    ----------
    base : Calibration
        The calibration of the stage before, without effects.
    poses : PoseResult
        The diagnosis at the poses.
    static : StaticResult
        The diagnosis of the static records.
    records : dict of str to list of StaticRecord
        Static records by sensor.
    has_static_session : bool
        Whether the records come from a static session. If so, their effects count. If not, the
        records are other rests, and their effects count only for a sensor that the poses do not
        calibrate.
    bias_held : bool
        Whether the gyroscope keeps its bias at the first rest. Then the bias at the poses counts
        only if the accelerometer has effects.
    """
    # the gyroscope was calibrated with the direction of gravity by the accelerometer with effects
    force = poses.calibrations.get("accelerometer")
    # with such effects, the bias of the gyroscope at the poses differs from that at the first rest
    bias_counts, calibrations = not bias_held or (force and force.effects), {}
    for sensor in SENSORS:
        calibration, at_poses = getattr(base, sensor), poses.calibrations.get(sensor)
        if at_poses and (bias_counts or at_poses.effects):
            calibration = at_poses
        elif has_static_session or not at_poses:
            calibration = with_static_effects(calibration, static.effects[sensor], records[sensor])
        calibrations[sensor] = calibration
    return replace(base, **calibrations)


def judge_calibration(calibration, sensor, contents, static_kinds):
    """Return the SensorCalibration with its verdict, and with the reason if it is implausible.

    The verdict is the worst verdict of the records that the calibration comes from. A plausible
    calibration gets no reason.

    Parameters
    ----------
    calibration : SensorCalibration
        The calibration of the sensor without a verdict.
    sensor : str
        Name of the sensor.
    contents : dict of str to dict
        Content of diagnosis.json by kind of record. If the calibration is implausible, a record
        with the verdict ``consistent`` or ``explained`` becomes not testable in this dict.
    static_kinds : dict of str to str
        Kind of each session that has static records, by its name. Long rests of other sessions are
        static records, too. The verdict on static records counts only if at least one of the
        sessions is of the kind ``static``.
    """
    if why := implausible_values(calibration, sensor):
        for record, content in contents.items():
            if content["verdict"] in ("consistent", "explained"):
                contents[record] = not_testable(why)
        calibration = replace(calibration, not_testable=why)
    verdict = calibration_verdict(contents, "static" in static_kinds.values())
    return replace(calibration, verdict=verdict)


def with_static_effects(calibration, effects, records):
    """Return the SensorCalibration of a sensor with the effects of its static records.

    `calibration` is the SensorCalibration without effects, and `effects` are the FittedEffects. A
    static record is a rest of minutes to hours, as means over windows; `records` is the list of
    StaticRecords. If the sensor was only calibrated at rest (`method` is ``static``), its bias is
    estimated again: it is the mean over the records after the effects are subtracted. Otherwise
    the sensor keeps its bias.
    """
    b = calibration.b
    if effects and calibration.method == "static":
        # values are outputs K (raw - b), so that their mean without effects is the error of K b
        levels = [r.values - sum(e.output(r.channels) for e in effects) for r in records]
        lengths = np.concatenate([r.length for r in records])
        b = b + np.average(np.concatenate(levels), axis=0, weights=lengths) / calibration.K
    return replace(calibration, b=b, effects=effects)


def with_validity_ranges(calibration, poses, recording, records, static_effects):
    """Return the Calibration with the range of inputs in which each effect was estimated.

    Outside this range, an applied calibration uses the effect at the end of the range.

    Parameters
    ----------
    calibration : Calibration
        The calibration of both sensors with effects.
    poses : PoseResult
        The diagnosis at the poses. If the poses calibrate a sensor, its ranges come from its inputs
        at the poses. The ranges of a gyroscope include the rotations between poses.
    recording : Recording
        Poses and rotations.
    records : dict of str to list of StaticRecord
        Static records by sensor.
    static_effects : dict of str to tuple of FittedEffect
        Effects of the static records by sensor: their ranges come from these records, too.
    """
    force, turn = calibration.accelerometer, calibration.gyroscope
    at_poses, in_motion, sensors = {sensor: [] for sensor in SENSORS}, [], {}
    if "accelerometer" in poses.calibrations and force.effects:
        # some effects of the accelerometer depend on the angular rate. In poses it is about zero,
        # so the nominal rate is enough; along moves it is the rate by the calibrated gyroscope
        rate, aligned = recording.poses.w, turn.aligned(recording.rotations.w)
        at_poses["accelerometer"] = [recording.pose_channels("accelerometer", force.output, rate)]
        in_motion = [
            recording.rotation_channels("accelerometer", force.output, aligned, turn.aligned)
        ]
    if "gyroscope" in poses.calibrations and turn.effects:
        at_rest, in_moves = recording.calibrated_force(force)
        at_poses["gyroscope"] = [
            recording.pose_channels("gyroscope", turn.output, at_rest),
            recording.rotation_channels("gyroscope", turn.output, in_moves),
        ]
    for sensor, channels in at_poses.items():
        model, effects = getattr(calibration, sensor), []
        static_names = [effect.name for effect in static_effects[sensor]]
        for effect in model.effects:
            data = channels
            if sensor == "accelerometer" and "motion" in effect.effect.records:
                data = in_motion
            elif effect.name in static_names:
                data = channels + [r.channels for r in records[sensor]]
            effects.append(effect.with_ranges(data))
        sensors[sensor] = replace(model, effects=tuple(effects))
    return replace(calibration, **sensors)
