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
from imuloop.diagnose.records.motion import diagnose_motion
from imuloop.diagnose.records.pose_diagnosis import PoseResult, diagnose_poses, pose_candidates
from imuloop.diagnose.records.pose_tables import moves_table, poses_table
from imuloop.diagnose.records.reference import diagnose_reference
from imuloop.diagnose.records.rests import read_static
from imuloop.diagnose.records.static_diagnosis import diagnose_static, static_tests
from imuloop.estimate.verdict import not_testable, of_calibration
from imuloop.model.calibration import Calibration
from imuloop.model.calibration_faults import implausible_values
from imuloop.model.prior import data_sheet

# version of diagnosis.json
FORMAT = 1
# kinds of records that diagnosis.json has for a sensor
RECORDS = ("poses", "static_record", "motion")


@dataclass(frozen=True)
class Diagnosed:
    """The diagnosis of a device, as validation and advice use it."""

    content: dict  # content of diagnosis.json without the next steps
    calibration: Calibration  # the model with the added effects
    # Allan table after subtracting the effects, by session; empty if there are none
    allan: dict
    noise: NoiseModel  # noise after subtracting the effects of the static records
    poses: PoseResult
    recording: Recording  # all poses and rotations
    names: list  # names of the sessions in the recording
    tables: dict  # columns of poses.parquet, moves.parquet and reference.parquet
    motion: tuple = ()  # JointFit and Fit with the effects that moves show; empty without them


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
    """Return the Diagnosed of a device.

    Parameters
    ----------
    device : str
        Its name.
    gravity : float
        Local gravity, m/s^2.
    sessions : dict of str to dict
        ``kind``, and paths of ``samples`` and ``segments``, of each session by name.
    noise, six_position, multi_position : path
        Results of the noise stage and of both calibration stages.
    calibrate_settings, settings, noise_settings
        Settings of the calibration, the diagnosis and the noise stage. Calibration and noise are
        estimated again with the effects that are found.
    prior : Prior, optional
        The data sheet by default.
    """
    model = NoiseModel.from_json(noise)
    method, recording = largest_recording(sessions, calibrate_settings.longest_rotation)
    stage = six_position if method == "six_position" else multi_position
    base, data = Calibration.from_json(stage), read_static(sessions)
    records = {s: data.records(s, base, settings.mean_time) for s in SENSORS}
    tests = settings.family * (
        static_tests(records, settings)
        + sum(len(pose_candidates(sensor, recording)[0]) for sensor in SENSORS)
    )
    # Static records come first: the poses get their effects, and the noise without these effects.
    # A long rest in the log of the poses gives no effects: the poses themselves show them better.
    still = diagnose_static(
        *(data, records, base, model, settings, noise_settings, tests),
    )
    has_static_session = "static" in data.kinds.values()
    found, information = (), None
    if has_static_session:
        found, information = still.at_poses(recording.poses.temperature is not None)
    # this noise is also without a ramp, which poses do not have but which would add slow noise
    noise = still.noise
    units = {sensor: getattr(base, sensor).raw_unit for sensor in SENSORS}
    turns = read_turns(sessions, base.accelerometer)
    how = recording, noise, gravity, units, prior, turns
    pair, reasons = start_fit(*how)
    how = recording, settings, tests
    poses = diagnose_poses(pair, reasons, *how, found, information)
    refused = nominal_sensors(poses.rejected, recording, noise, units, prior or data_sheet())
    base = replace(base, **refused)
    motion = diagnose_motion(poses.pair, poses.solution, *how, information)
    # the gyroscope was calibrated with the direction of gravity by the accelerometer with effects
    force = poses.calibrations.get("accelerometer", base.accelerometer)
    by_new_force = "accelerometer" in poses.calibrations and force.effects
    bias_refitted = by_new_force or calibrate_settings.gyroscope_bias != "initial_rest"
    final = {}
    for sensor in SENSORS:
        own = poses.calibrations.get(sensor)
        effects = still.effects[sensor] if has_static_session or not own else ()
        given = getattr(base, sensor), own, effects, records[sensor]
        final[sensor] = final_calibration(*given, bias_refitted)
    final = replace(base, **final | motion.calibrations)
    final = with_validity_ranges(final, poses.calibrations, recording, records, still.effects)
    beside, windows = diagnose_reference(sessions, noise, gravity, settings, tests, final)
    names, faces = (
        [name for name, session in sessions.items() if usable_sessions({name: session}, *kinds)]
        for kinds in (GROUPS[method], ("six_position",))
    )
    content = _content(device, poses.contents, still.content, motion.contents)
    if left_out := recording.lost.contradicting:
        keys = ("session", "start_s", "end_s", "angle")
        turns_of = [(names[session], *rest) for session, *rest in left_out]
        turned = content["sensors"]["gyroscope"]["poses"]
        turned["contradicting"] = [dict(zip(keys, turn, strict=True)) for turn in turns_of]
    for sensor, own in content["sensors"].items():
        own |= {"reference": beside[sensor]} if beside else {}
        calibration = getattr(final, sensor)
        if why := implausible_values(calibration, sensor):
            good = [part for part, c in own.items() if c["verdict"] in ("consistent", "explained")]
            own |= {part: not_testable(why) for part in good}
            calibration = replace(calibration, not_testable=why)
        verdict = of_calibration(own, has_static_session)
        final = replace(final, **{sensor: replace(calibration, verdict=verdict)})
    residuals = poses.residuals | motion.residuals
    # the calibration by the poses: effects of static records may need channels that poses lack
    turned = poses.calibrations.get("gyroscope", base.gyroscope)
    _, seen_force = recording.calibrated_force(force)
    shown = [poses_table(recording.poses, names, residuals)]
    if method != "six_position":
        # the poses on six faces are in the table, but are not diagnosed
        shown.append(poses_table(read_poses(sessions, "six_position"), faces, {}))
    tables = {
        "poses": joined(shown),
        "moves": moves_table(recording, names, turned, seen_force, residuals),
        "reference": windows,
    }
    in_motion = (motion.pair, motion.solution) if motion.solution else ()
    of_poses = poses, recording, names
    return Diagnosed(content, final, still.allan, noise, *of_poses, tables, in_motion)


def _content(device, *records):
    """Return the content of diagnosis.json.

    `records` has for each of the `RECORDS` its content by sensor.
    """
    sensors = {s: {r: c[s] for r, c in zip(RECORDS, records, strict=True)} for s in SENSORS}
    return {"format": FORMAT, "device": device, "sensors": sensors}


def final_calibration(base, found, effects, records, bias_refitted):
    """Return the calibration of a sensor with every effect that was found.

    Parameters
    ----------
    base : SensorCalibration
        The calibration of the stage before, without effects.
    found : SensorCalibration or None
        The calibration by the poses. It is the result if it has effects or if `bias_refitted`.
    effects : tuple of FittedEffect
        Effects of the static records. Else they are added to `base`.
    records : list of StaticRecord
        For a sensor that only rested, the bias is the mean of these after subtracting the effects.
    bias_refitted : bool
        Whether the bias of `found` may replace the one of `base`: not if it is held at the first
        rest.
    """
    if found and (bias_refitted or found.effects):
        return found
    if not effects:
        return base
    b = base.b
    if base.method == "static":
        levels = [r.values - sum(e.output(r.channels) for e in effects) for r in records]
        lengths = np.concatenate([r.length for r in records])
        b = b + np.average(np.concatenate(levels), axis=0, weights=lengths) / base.K
    return replace(base, b=b, effects=effects)


def with_validity_ranges(calibration, found, recording, records, static_effects):
    """Return the Calibration with the range of inputs in which each effect was estimated.

    The ranges of a sensor in `found`, its calibrations by the poses, come from the poses; those of
    the gyroscope come from the rotations too. Effects in `static_effects`, by sensor, also have
    the range of the static `records`, by sensor.
    """
    force, turn = calibration.accelerometer, calibration.gyroscope
    at_poses, moving, sensors = {sensor: [] for sensor in SENSORS}, [], {}
    if "accelerometer" in found and force.effects:
        rate, aligned = recording.poses.w, turn.aligned(recording.rotations.w)
        at_poses["accelerometer"] = [recording.pose_channels("accelerometer", force.output, rate)]
        how = force.output, aligned, turn.aligned
        moving = [recording.rotation_channels("accelerometer", *how)]
    if "gyroscope" in found and turn.effects:
        at_rest, along = recording.calibrated_force(force)
        at_poses["gyroscope"] = [
            recording.pose_channels("gyroscope", turn.output, at_rest),
            recording.rotation_channels("gyroscope", turn.output, along),
        ]
    for sensor, own in zip(SENSORS, (force, turn), strict=True):
        effects, resting = [], [effect.name for effect in static_effects[sensor]]
        for effect in own.effects:
            seen = at_poses[sensor]
            if sensor == "accelerometer" and "motion" in effect.effect.records:
                seen = moving
            elif effect.name in resting:
                seen = seen + [r.channels for r in records[sensor]]
            effects.append(effect.with_ranges(seen))
        sensors[sensor] = replace(own, effects=tuple(effects))
    return replace(calibration, **sensors)
