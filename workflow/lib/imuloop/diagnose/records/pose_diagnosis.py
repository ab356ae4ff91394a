"""Diagnosis of both sensors at the poses: missing effects, and the residuals that remain."""

from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from scipy.linalg import LinAlgError

from imuloop.calibrate.calibrate import NO_DIRECTION, contradictions
from imuloop.calibrate.contradictions import change
from imuloop.core.errors import plural
from imuloop.core.samples import SENSORS
from imuloop.core.sphere import count_attitudes
from imuloop.diagnose.candidates import candidates
from imuloop.diagnose.content import residual_entry, search_content, size_of, untried
from imuloop.diagnose.records.pose_problem import PoseProblem, interleaved_folds
from imuloop.diagnose.records.pose_tables import residual_columns
from imuloop.diagnose.records.scan import pose_step
from imuloop.effects.products import Product, products
from imuloop.effects.steps import Steps
from imuloop.effects.temperature import LEAST_SPAN, span, whole_degrees
from imuloop.estimate.choice import Choices
from imuloop.estimate.joint_fit import JointFit
from imuloop.estimate.least_squares import Fit, why_no_fit
from imuloop.estimate.residuals import held_out_covariance
from imuloop.estimate.search import kinds_of
from imuloop.estimate.verdict import RESIDUALS, judge, leaves, not_testable, verdict
from imuloop.factors.factors import OF_SENSOR, VELOCITY
from imuloop.model.effects import EffectKind, SensorEffect

# kinds of residuals that grow if the device moves during rests, and the share of such rests from
# which on the motion may explain these residuals
MOVED, MOVED_RESTS = {"pose_rate", "rotation", *VELOCITY}, 0.1
STILL = "left may be that: wait 3 s after putting it down, or lay it on a table"
# least number of poses for a test of effects with cross-validation
TESTABLE = 12
# least number of attitudes among them, one more than parameters; rad between two attitudes
ATTITUDES, APART = 10, 0.17
# least number of turns between poses for a test of effects of the gyroscope
TESTABLE_TURNS = 6
# ratio of held-out error to floor from which on a sensor may have changed during the recording
FAR = 3.0
# alternatives of the noise that are less probable do not count for the range of the floor
NEGLIGIBLE = 0.025


@dataclass(frozen=True)
class PoseResult:
    """The diagnosis of both sensors at the poses, or in motion."""

    contents: dict  # content of diagnosis.json, by sensor
    pair: JointFit | None = None  # None if the poses determine no sensor
    # the fit with the added effects; None if nothing could be fitted
    solution: Fit | None = None
    calibrations: dict = field(default_factory=dict)  # calibration of each fitted sensor
    choices: Choices | None = None  # the searches; None if nothing could be tested
    # columns of residuals as in `residual_columns`; empty if nothing could be tested
    residuals: dict = field(default_factory=dict)
    # reason why the calibration of a sensor is rejected, by sensor
    rejected: dict = field(default_factory=dict)


def pose_candidates(sensor, recording, found=()):
    """Return the shapes to try on a sensor at the poses, and the effects that are not tried.

    Both are dicts by type of effect: a tuple of shapes, and a status with its reason. Effects of
    the sensor in `found` are in neither. Both are empty without poses.
    """
    poses = recording.poses
    if not len(poses):
        return {}, {}
    other = poses.w if sensor == "accelerometer" else poses.f
    channels = recording.pose_channels(sensor, lambda y: y, other)
    available, others = candidates(sensor, "poses", channels)
    if np.ptp(poses.session):
        del available[Steps]
        others[Steps] = ("not_available", "a step is looked for in poses of one session")
    for cls in [e.kind.cls for e in found if e.sensor == sensor]:
        available.pop(cls, None)
        others.pop(cls, None)
    return available, others


def pose_problem(pair, recording, settings, tests, found=(), information=None, sensors=None):
    """Return the PoseProblem of a device with interleaved folds.

    Effects are tried on `sensors`, by default on all estimated ones. `found` and `information` are
    the attributes `given_effects` and `information` of PoseProblem.
    """
    shapes, scans = {}, {}
    for sensor in pair.estimated if sensors is None else sensors:
        for cls, own in pose_candidates(sensor, recording, found)[0].items():
            if cls is Steps:
                scans[EffectKind(cls, sensor)] = partial(pose_step, sensor)
            else:
                shapes[EffectKind(cls, sensor)] = tuple(
                    SensorEffect(shape, sensor) for shape in own
                )
    folds, rows = interleaved_folds(len(recording.poses), settings.folds), pair.known
    return PoseProblem(
        pair, recording, shapes, settings, tests, folds, tuple(found), information, rows, scans
    )


def diagnose_poses(pair, reasons, recording, settings, tests, found=(), information=None):
    """Return the PoseResult of a device.

    Parameters
    ----------
    pair : JointFit or None
        The fit to start from; None if the poses determine no sensor.
    reasons : dict of str to str
        Reason why a sensor is not in the fit, by sensor.
    recording : Recording
        Poses and rotations.
    settings : DiagnoseSettings
    tests : int
        Number of tests that share the significance.
    found : sequence of SensorEffect
        Effects that static records showed; every fit estimates them.
    information : callable, optional
        As `PoseProblem.information`.
    """
    contents = {sensor: not_testable(reasons.get(sensor, "")) for sensor in SENSORS}
    if pair is None:
        return PoseResult(contents)
    found = [e for e in found if e.sensor in pair.estimated]
    few = too_few(recording)
    contents |= {s: not_testable(few[s]) for s in pair.estimated if s in few}
    tested = [sensor for sensor in pair.estimated if sensor not in few]
    problem = pose_problem(pair, recording, settings, tests, found, information, tested)
    try:
        if not tested:
            result = PoseResult(contents, pair, *final_solution(problem, ()))
        else:
            kinds = {(sensor,): OF_SENSOR[sensor] for sensor in tested}
            others = {s: pose_candidates(s, recording, found)[1] for s in tested}
            choices = Choices(problem)
            result = diagnose(choices, kinds, others, partial(pose_products, recording))
            result = replace(result, contents=contents | result.contents)
    except LinAlgError as error:
        why = why_no_fit(error)
        return PoseResult(contents | {s: not_testable(why) for s in tested}, pair)
    for effect in (e for e in found if e.sensor in tested):
        entry = untried(effect.name, "added", "found in the static record")
        result.contents[effect.sensor]["candidates"].append(entry)
    rejected = rejections(result, recording)
    if not rejected:
        return result
    if "accelerometer" in rejected or "accelerometer" not in pair.estimated:
        lost = {sensor: not_testable(why) for sensor, why in rejected.items()}
        return PoseResult(contents | lost, pair, rejected=rejected)
    alone, how = pair.of_sensors(["accelerometer"]), (recording, settings, tests)
    again = diagnose_poses(alone, reasons | rejected, *how, found, information)
    return replace(again, rejected=rejected | again.rejected)


def too_few(recording):
    """Return the reasons, text by sensor, why there are too few poses or turns to test a sensor.

    A sensor that can be tested is not in the result.
    """
    poses, turns, lost = len(recording.poses), len(recording.rotations), recording.lost
    start, count = "calibrated; too few", count_attitudes(recording.poses.f, APART)
    if poses < TESTABLE or count < ATTITUDES:
        few = f"{start} poses to test for missing effects: {plural(poses, 'pose')} found, "
        few += f"{TESTABLE} needed"
        if poses >= TESTABLE:
            few += f" in {ATTITUDES} attitudes, not {count}"
        return {"accelerometer": few + lost.rests_reason, "gyroscope": few + lost.reason}
    if turns < TESTABLE_TURNS:
        few = f"{start} turns to test for missing effects: {plural(turns, 'turn')} between poses, "
        return {"gyroscope": f"{few}{TESTABLE_TURNS} needed{lost.reason}"}
    return {}


def rejections(result, recording):
    """Return the reasons, text by sensor, why the calibration of a sensor is rejected.

    Its data contradict each other, or the sensor changed during the recording, and the effects that
    were added do not explain this.
    """
    rejected = {}
    if result.solution is not None:
        rejected = contradictions(result.pair, result.solution, recording)
    for sensor in result.calibrations:
        # a step that is in the model leaves no large residuals
        residuals = result.contents[sensor]["residuals"].values()
        if any(not r["after"] <= FAR * r["floor"] for r in residuals):
            if why := change(sensor, recording):
                rejected[sensor] = why
    if "accelerometer" in rejected and "gyroscope" in result.calibrations:
        rejected["gyroscope"] = NO_DIRECTION
    return rejected


def pose_products(recording, sensor):
    """Return the Products to try on a sensor at poses and rotations.

    An accelerometer has those of specific force only, since at rest the angular rate is zero.
    """
    channels = recording.pose_channels(sensor, lambda y: y, recording.poses.f)
    reference = whole_degrees(channels) if span(channels) > LEAST_SPAN else None
    return products(sensor, "f" if sensor == "accelerometer" else "wf", reference)


def diagnose(choices, kinds_by_sensors, others, formulas):
    """Return the PoseResult of the Choices of a record that can be tested.

    Parameters
    ----------
    choices : Choices
        The searches in the record.
    kinds_by_sensors : dict of tuple to tuple
        Kinds of residuals by the sensors, a tuple of names, that these residuals judge.
    others : dict of str to dict
        By sensor, status and reason of the effects that are not tried.
    formulas : callable
        Takes a sensor; returns the Products to try if its residuals are still above their floor
        with all other effects.
    """
    result, contents, more = judge_records(choices, kinds_by_sensors), {}, {}
    for sensor in (s for s, content in result.contents.items() if leaves(content)):
        if own := formulas(sensor):
            more[EffectKind(Product, sensor)] = tuple(SensorEffect(shape, sensor) for shape in own)
    if more:
        choices = Choices(choices.problem.with_formulas(more))
        result = judge_records(choices, kinds_by_sensors)
    fitted = fitted_effects(result)
    for sensor, own in result.contents.items():
        why_not = others.get(sensor, {})
        contents[sensor] = own | search_content(choices, fitted, why_not, sensor)
    return replace(result, contents=contents, pair=choices.problem.sensor, choices=choices)


def judge_records(choices, kinds_by_sensors):
    """Compare the residuals of a record with their floors; return a PoseResult.

    Its contents have the verdict and the residuals by sensor, but no effects and candidates yet.
    `choices` are the Choices of the record; `kinds_by_sensors` has the kinds of residual that judge
    a sensor, a tuple, by a tuple of the names of the sensors that they judge together.
    """
    problem, errors = choices.problem, choices.errors(choices.nested_choice)
    contents, columns = {}, {}
    for sensors, kinds in kinds_by_sensors.items():
        content, more = judged_residuals(choices, kinds, errors, sensors)
        contents |= dict.fromkeys(sensors, content)
        columns |= more
    fit = final_solution(problem, choices.choice().base)
    return PoseResult(contents, problem.sensor, *fit, choices, columns)


def fitted_effects(result):
    """Return a list with the FittedEffect of each effect that the Choices of a PoseResult added."""
    fitted = {(s, f.effect): f for s, c in result.calibrations.items() for f in c.effects}
    return [fitted[e.sensor, e.effect] for e in result.choices.choice().base]


def judged_residuals(choices, kinds, errors, sensors=()):
    """Return verdict and residuals of a PoseProblem, for some kinds of residual.

    The first result is a dict with the verdict and the residuals for diagnosis.json; the second one
    has the columns of `residual_columns`. Residuals 'before' are those without the added effects of
    the `sensors`; by default without all added effects. `errors`, (N, 1), are the held-out errors
    with all added effects.
    """
    problem, added = choices.problem, choices.choice().base
    pair, settings = problem.sensor, problem.settings
    others = tuple(e for e in added if sensors and e.sensor not in sensors)
    more = len(others) < len(added)
    plain = choices.errors_with(kinds_of(others)) if more else errors
    predicted = np.isfinite(plain) & np.isfinite(errors)
    errors = [np.where(predicted, each, np.nan) for each in (plain, errors)]
    base = problem.linearization(others if more else added)
    final = problem.linearization(added)
    groups, both = [problem.of_kind(kind) for kind in kinds], []
    # without added effects 'before' and 'after' are the same
    for about, held_out in ((final, errors[1]), (base, errors[0]))[: 1 + more]:
        alternatives = [
            (prior, [(about.values, covariance, about.jacobian, problem.row_folds, groups)])
            for prior, covariance in about.alternatives
        ]
        squares = [np.nansum(held_out[rows] ** 2) for rows in groups]
        both.append(judge(alternatives, squares, predicted=predicted[:, 0]))
    # the floor uses the probabilities of the alternatives in the fit with effects
    (weights, judged_final), (_, judged_base) = both[0], both[-1]
    how = base.jacobian, problem.row_folds
    spreads = (held_out_covariance(c, *how) for _, c in final.alternatives)
    floors = [np.where(predicted, np.diag(spread)[:, None], np.nan) for spread in spreads]
    floor = np.tensordot(weights, floors, 1)
    share = settings.significance / RESIDUALS / settings.family
    residuals, above, slow = {}, (False, False), False
    for k, (kind, rows) in enumerate(zip(kinds, groups, strict=True)):
        unit = pair.kinds[kind][0]
        judged = judged_base[k], judged_final[k]
        entry, found = residual_entry(problem, kind, unit, rows, judged, errors, floor, share, more)
        above = np.logical_or(above, found)
        if kind != "rotation" or not problem.recording.rotations.aliased.any():
            slow |= judged[1].estimated < share
        sizes = (size_of(problem, kind, np.sqrt(v[rows])) for v in floors)
        likely = [s for s, weight in zip(sizes, weights, strict=True) if weight >= NEGLIGIBLE]
        likely.append(entry["floor"])
        residuals[kind] = entry | {
            "floor_range": [min(likely), max(likely)],
            "in_sample_before": size_of(problem, kind, base.values[rows][:, None]),
            "in_sample_after": size_of(problem, kind, final.values[rows][:, None]),
        }
        if kind == "rotation":
            residuals[kind] |= undersampled(problem, final.solution, entry["floor"])
    found = {
        "verdict": verdict(*above, more),
        "slow_noise": bool(slow and not above[1]),
        "residuals": residuals,
    }
    if found["verdict"] == "unexplained" and MOVED.intersection(kinds):
        moved = problem.recording.poses.tilt > 0
        if moved.mean() >= MOVED_RESTS:
            why = f"the device moved in {moved.sum()} of {plural(len(moved), 'rest')}, and what is "
            found |= {"verdict": "not_testable", "why": why + STILL}
    # held-out errors get the sign of the residuals of the fit
    signed = (*(-e[:, 0] for e in errors), base.values, final.values)
    return found, residual_columns(problem, kinds, signed, floor[:, 0])


def undersampled(problem, solution, floor):
    """Return the error of the rotations by slow sampling, if it exceeds all other noise.

    The result has one field, ``undersampled``, or none. It has the ``error`` by sampling and that
    of all ``others``, rad, the sample rate, and the rate ``enough_hz`` at which both would be
    equal: the variance by sampling falls with the rate as the spectrum of the turns does. Both
    errors come from the noise as estimated; together they are not larger than the `floor`, rad.
    """
    sensor, recording, rotations = problem.sensor, problem.recording, problem.recording.rotations
    if not rotations.aliased.any():
        return {}
    noise = sensor.linearise(solution, recording).noise
    covariances = [noise.by(sensor.noise, aliasing) for aliasing in (True, False)]
    sums = (np.diag(covariance)[-2 * len(rotations) :].sum() for covariance in covariances)
    whole, others = (total / len(rotations) for total in sums)
    own, rate = min(whole, floor**2) - others, 1 / np.median(rotations.steps[rotations.steps > 0])
    if own <= others:
        return {}
    enough = rate * (own / others) ** (1 / np.average(rotations.fall, weights=rotations.aliased))
    found = {"error": own**0.5, "others": others**0.5, "rate_hz": rate, "enough_hz": enough}
    return {"undersampled": {name: float(value) for name, value in found.items()}}


def final_solution(problem, base):
    """Return the Fit of all poses with the base effects, and the calibrations from it, by sensor.

    The covariance of the calibrations includes the uncertainty of the noise.
    """
    solution = problem.linearization(base).solution
    return solution, problem.sensor.calibrations(solution, problem.covariance(base))
