"""Diagnosis of both sensors at the poses: missing effects, and the residuals that remain."""

from dataclasses import replace
from functools import partial

import numpy as np
from scipy.linalg import LinAlgError

from imuloop.calibrate.calibrate import NO_DIRECTION, contradictions
from imuloop.calibrate.contradictions import why_changed
from imuloop.core.errors import plural
from imuloop.core.samples import SENSORS
from imuloop.core.sphere import count_attitudes
from imuloop.diagnose.content import candidates, untried
from imuloop.diagnose.pose_problem import PoseProblem, interleaved_folds
from imuloop.diagnose.record import PoseResult, diagnose_record, final_solution
from imuloop.diagnose.steps import pose_step
from imuloop.effects.products import products
from imuloop.effects.steps import Steps
from imuloop.effects.temperature import LEAST_SPAN, span, whole_degrees
from imuloop.estimate.least_squares import why_no_fit
from imuloop.estimate.verdict import not_testable
from imuloop.factors.factors import OF_SENSOR
from imuloop.model.effect import Channels
from imuloop.model.effects import EffectKind, SensorEffect

# least number of poses for a test of effects with cross-validation
TESTABLE = 12
# least number of different attitudes among these poses, one more than there are parameters; and the
# least angle between two different attitudes, rad
ATTITUDES, APART = 10, 0.17
# least number of turns between poses for a test of effects of the gyroscope
TESTABLE_TURNS = 6
# ratio of held-out error to floor from which on a sensor may have changed during the recording
FAR = 3.0


def pose_candidates(sensor, recording, static_effects=()):
    """Return the variants to try on a sensor at the poses, and the effects that are not tried.

    Return two dicts, keyed by type of effect. The first holds a tuple of variants, which are the
    effect with values of its constants. The second holds the status of an effect that is not tried,
    and the reason. `sensor` is the name of the sensor, and `recording` has the poses; without poses
    both dicts are empty. `static_effects` are SensorEffects that static records showed; those of
    this sensor are in neither dict.
    """
    poses = recording.poses
    if not len(poses):
        return {}, {}
    # the choice of variants depends on time, temperature and power cycle, not on outputs
    channels = Channels(
        poses.mid_s, None, None, temperature=poses.temperature, power_cycle=poses.power_cycle
    )
    variants, reasons = candidates(sensor, "poses", channels)
    if np.ptp(poses.session):
        del variants[Steps]
        reasons[Steps] = ("not_available", "a step is looked for in poses of one session")
    for cls in [e.kind.cls for e in static_effects if e.sensor == sensor]:
        variants.pop(cls, None)
        reasons.pop(cls, None)
    return variants, reasons


def pose_problem(joint_fit, recording, settings, tests, static=None):
    """Return the PoseProblem of a device: its poses, their folds, and the effects to try.

    Neighbouring poses are in different folds of the cross-validation. Effects are tried on the
    fitted sensors that have enough poses and turns. A scan finds the time of a step; all other
    kinds of effects have a list of variants, with values of their constants.

    Parameters
    ----------
    joint_fit : JointFit
        The fit to start from.
    recording : Recording
        Poses and rotations.
    settings : DiagnoseSettings
        Number of folds, significance and power of the tests.
    tests : int
        Number of tests that share the significance.
    static : StaticResult, optional
        Diagnosis of static records. Every fit estimates the effects that these records showed on
        the fitted sensors; an effect of the temperature needs poses with a temperature.
    """
    nuisances = tuple(
        e
        for e in (static.sensor_effects if static else ())
        if e.sensor in joint_fit.estimated
        and (recording.poses.temperature is not None or "temperature" not in e.needs)
    )
    variants, scans, few = {}, {}, too_few(recording)
    for sensor in (s for s in joint_fit.estimated if s not in few):
        for cls, tried in pose_candidates(sensor, recording, nuisances)[0].items():
            kind = EffectKind(cls, sensor)
            if cls is Steps:
                scans[kind] = partial(pose_step, sensor)
            else:
                variants[kind] = tuple(SensorEffect(variant, sensor) for variant in tried)
    return PoseProblem(
        joint_fit=joint_fit,
        recording=recording,
        variants=variants,
        settings=settings,
        tests=tests,
        fold_of_pose=interleaved_folds(len(recording.poses), settings.folds),
        nuisance_effects=nuisances,
        static=static,
        scans=scans,
    )


def diagnose_poses(problem, reasons):
    """Return the effects that the poses of a device show, and the verdict on the residuals.

    If only the data of the gyroscope contradict each other, the accelerometer is diagnosed again by
    itself. If the data of the accelerometer contradict each other, neither sensor gets a
    calibration, because the gyroscope needs the directions of gravity.

    Parameters
    ----------
    problem : PoseProblem or None
        The poses, from `pose_problem`; None if they determine no sensor.
    reasons : dict of str to str
        Reason why a sensor is not in the fit, by sensor.

    Returns
    -------
    PoseResult
        For each sensor the content of diagnosis.json, the calibration with the added effects, and
        the reason if it is rejected; for both together the fit, the searches and the columns of
        residuals.
    """
    contents = {sensor: not_testable(reasons.get(sensor, "")) for sensor in SENSORS}
    if problem is None:
        return PoseResult(contents)
    joint_fit, recording = problem.joint_fit, problem.recording
    sensors, static_effects, few = joint_fit.estimated, problem.nuisance_effects, too_few(recording)
    contents |= {s: not_testable(few[s]) for s in sensors if s in few}
    tested = [sensor for sensor in sensors if sensor not in few]
    try:
        if not tested:
            solution, calibrations = final_solution(problem, ())
            result = PoseResult(contents, problem, solution, calibrations)
        else:
            kinds = {(sensor,): OF_SENSOR[sensor] for sensor in tested}
            not_tried = {s: pose_candidates(s, recording, static_effects)[1] for s in tested}
            result = diagnose_record(problem, kinds, not_tried, partial(pose_products, recording))
            result = replace(result, contents=contents | result.contents)
    except LinAlgError as error:
        why = why_no_fit(error)
        return PoseResult(contents | {s: not_testable(why) for s in tested}, problem)
    for effect in (e for e in static_effects if e.sensor in tested):
        entry = untried(effect.name, "added", "found in the static record")
        result.contents[effect.sensor]["candidates"].append(entry)
    rejected = rejections(result)
    if not rejected:
        return result
    # the gyroscope is calibrated with the directions of gravity that the accelerometer shows
    if "accelerometer" in rejected or "accelerometer" not in sensors:
        contents |= {sensor: not_testable(why) for sensor, why in rejected.items()}
        return PoseResult(contents, problem, rejected=rejected)
    accelerometer = joint_fit.of_sensors(["accelerometer"])
    problem = pose_problem(
        accelerometer, recording, problem.settings, problem.tests, problem.static
    )
    result = diagnose_poses(problem, reasons | rejected)
    return replace(result, rejected=rejected | result.rejected)


def too_few(recording):
    """Return the reasons why there are too few poses or turns to test a sensor, a dict of text.

    The keys are the sensors that cannot be tested. With too few poses these are both sensors, with
    too few turns only the gyroscope. The dict is empty if the `recording` has enough poses and
    turns.
    """
    poses, turns, lost = len(recording.poses), len(recording.rotations), recording.lost
    start, attitudes = "calibrated; too few", count_attitudes(recording.poses.f, APART)
    if poses < TESTABLE or attitudes < ATTITUDES:
        few = f"{start} poses to test for missing effects: {plural(poses, 'pose')} found, "
        few += f"{TESTABLE} needed"
        if poses >= TESTABLE:
            few += f" in {ATTITUDES} attitudes, not {attitudes}"
        return {"accelerometer": few + lost.rests_reason, "gyroscope": few + lost.reason}
    if turns < TESTABLE_TURNS:
        few = f"{start} turns to test for missing effects: {plural(turns, 'turn')} between poses, "
        return {"gyroscope": f"{few}{TESTABLE_TURNS} needed{lost.reason}"}
    return {}


def rejections(result):
    """Return the reasons why calibrations are rejected, a dict of text by sensor.

    A calibration is rejected if the data of the sensor contradict each other, or if the sensor
    changed during the recording and the added effects do not explain the change. If the
    accelerometer is rejected, the gyroscope is rejected, too, as it needs the directions of
    gravity. `result` is a PoseResult. The dict is empty if no calibration is rejected.
    """
    rejected, recording = {}, result.problem.recording
    if result.solution is not None:
        rejected = contradictions(result.problem.joint_fit, result.solution, recording)
    for sensor in result.calibrations:
        residuals = result.contents[sensor]["residuals"].values()
        if any(not r["after"] <= FAR * r["floor"] for r in residuals):
            if why := why_changed(sensor, recording.without_effects(result.calibrations)):
                rejected[sensor] = why
    if "accelerometer" in rejected and "gyroscope" in result.calibrations:
        rejected["gyroscope"] = NO_DIRECTION
    return rejected


def pose_products(recording, sensor):
    """Return the Products to try on a `sensor` at the poses of a `recording`, a tuple.

    Each Product is an effect: a product of powers of outputs, and of the temperature if it changes
    enough. They are tried if the model may still lack an effect. For the gyroscope the outputs are
    angular rate and specific force. For the accelerometer they are specific force only, since at
    rest the angular rate is zero.
    """
    channels = Channels(recording.poses.mid_s, None, None, recording.poses.temperature)
    reference = whole_degrees(channels) if span(channels) > LEAST_SPAN else None
    return products(sensor, "f" if sensor == "accelerometer" else "wf", reference)
