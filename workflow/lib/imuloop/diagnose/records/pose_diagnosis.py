"""The poses of a device: what is missing in its model, what it is, and what remains with it."""

from dataclasses import dataclass, field
from functools import partial

import numpy as np
from scipy.linalg import LinAlgError
from scipy.special import sph_harm_y

from imuloop.calibrate.least_squares import Solution, why_no_fit
from imuloop.calibrate.sensor_pair import OF_SENSOR, VELOCITY, Kind, OfSensor, SensorPair
from imuloop.core.errors import plural
from imuloop.core.samples import SENSORS
from imuloop.diagnose.candidates import candidates
from imuloop.diagnose.choice import Choices
from imuloop.diagnose.content import residual_entry, search_content, size_of, untried
from imuloop.diagnose.records.pose_tables import residual_columns
from imuloop.diagnose.records.poses import PoseProblem, interleaved
from imuloop.diagnose.records.scan import pose_step
from imuloop.diagnose.residuals import floor_range, held_out_covariance
from imuloop.diagnose.search import kinds_of
from imuloop.diagnose.verdict import RESIDUALS, judge, leaves, not_testable, verdict
from imuloop.effects.steps import Steps

# kinds of residuals that a device leaves which does not lie still, and the share of its rests from
# which on what is left of them may be that
MOVED, MOVED_RESTS = {"pose_rate", "rotation", *VELOCITY}, 0.1
STILL = "left may be that: wait 3 s after putting it down, or lay it on a table"
# attitude patterns below degree 3 are those of bias, scale factor and misalignment
DEGREES = (3, 4, 5)


@dataclass(frozen=True)
class PoseResult:
    """The diagnosis of both sensors at the poses."""

    contents: dict  # the contract's fields, by sensor
    pair: SensorPair | None = None  # None where the poses determine no sensor
    # the fit with the effects that were added; None where nothing could be fitted
    solution: Solution | None = None
    calibrations: dict = field(default_factory=dict)  # of the sensors that were fitted
    choices: Choices | None = None  # the searches; None where nothing could be tested
    # as of `residual_columns`; empty where nothing could be tested
    residuals: dict = field(default_factory=dict)


def pose_candidates(sensor, recording):
    """Return what `candidates` does for a sensor at the poses; nothing to try without poses."""
    poses = recording.poses
    if not len(poses):
        return {}, {}
    other = poses.w if sensor == "accelerometer" else poses.f
    channels = recording.pose_channels(sensor, lambda y: y, other)
    available, others = candidates(sensor, "poses", channels)
    if np.ptp(poses.session):
        del available[Steps]
        others[Steps] = ("not_available", "a step is looked for in poses of one session")
    return available, others


def pose_problem(pair, recording, settings, tests, found=(), information=None, sensors=None):
    """Return the PoseProblem of a device, parts interleaved; effects are tried on some sensors."""
    shapes, scans = {}, {}
    for sensor in pair.estimated if sensors is None else sensors:
        for cls, own in pose_candidates(sensor, recording)[0].items():
            if cls is Steps:
                scans[Kind(cls, sensor)] = partial(pose_step, sensor)
            elif Kind(cls, sensor) not in kinds_of(found):
                shapes[Kind(cls, sensor)] = tuple(OfSensor(shape, sensor) for shape in own)
    fold = interleaved(len(recording.poses), settings.folds)
    rows = pair.prior_rows()
    return PoseProblem(
        pair, recording, shapes, settings, tests, fold, tuple(found), information, rows, scans
    )


def diagnose_poses(
    pair, reasons, recording, settings, tests, found=(), information=None, beyond=None
):
    """Return the PoseResult of a device.

    Takes what `calibrate.calibrate.sensor_pair` gives, the number of tests that share the
    significance, and `found` and `information` of PoseProblem. `beyond`, if any, is
    `search_formulas` of `imuloop.discover`: it looks for what the library leaves.
    """
    contents = {sensor: not_testable(reasons.get(sensor, "")) for sensor in SENSORS}
    if pair is None:
        return PoseResult(contents)
    found = [e for e in found if e.sensor in pair.estimated]
    problem = pose_problem(pair, recording, settings, tests, found, information)
    keeps = [problem.fold_of_pose != k for k in range(problem.parts)]
    tested = []
    for sensor in pair.estimated:
        if any(pair.undetermined(sensor, recording, keeps)):
            why = f"{len(recording.poses)} poses do not determine the model with a part held out"
            contents[sensor] = not_testable(why)
        else:
            tested.append(sensor)
    try:
        if reason := problem.lost(()):
            return PoseResult(contents | {s: not_testable(reason) for s in tested}, pair)
        if not tested:
            return PoseResult(contents, pair, *final_solution(problem, ()))
        problem = pose_problem(pair, recording, settings, tests, found, information, tested)
        return _diagnosed(Choices(problem), tested, contents, beyond)
    except LinAlgError as error:
        why = why_no_fit(error)
        return PoseResult(contents | {s: not_testable(why) for s in tested}, pair)


def _diagnosed(choices, tested, contents, beyond):
    """Return the PoseResult of poses whose fit without effects is one."""
    problem, added = choices.problem, choices.choice().base
    solution, calibrations = final_solution(problem, added)
    errors, residuals = choices.errors(choices.nested), {}
    contents = dict(contents)
    for sensor in tested:
        judged, columns = judged_residuals(choices, OF_SENSOR[sensor], errors, sensor)
        residuals |= columns
        others = pose_candidates(sensor, problem.recording)[1]
        others = {
            c: why for c, why in others.items() if Kind(c, sensor) not in kinds_of(problem.found)
        }
        fitted = fitted_effects(calibrations, added)
        content = judged | search_content(choices, fitted, others, _probes(problem, sensor), sensor)
        content["candidates"] += [
            untried(e.name, "added", "found in the static record")
            for e in problem.found
            if e.sensor == sensor
        ]
        contents[sensor] = content
    for sensor in tested if beyond else ():
        content = contents[sensor]
        more = beyond("poses", sensor, choices) if leaves(content) else None
        if not more:
            continue
        content["discovered"] = more.content
        if more.choices:
            about, base = more.choices.problem, more.choices.base
            solution, calibrations = final_solution(about, base)
            errors, fitted = (
                more.choices.errors(more.choices.nested),
                fitted_effects(calibrations, base),
            )
            for each in tested:
                judged, columns = judged_residuals(more.choices, OF_SENSOR[each], errors, each)
                residuals |= columns
                contents[each] |= judged
            own = [f for f, e in zip(fitted, base, strict=True) if e.sensor == sensor]
            content |= more.joined(content["effects"], content["candidates"], own)
            break
        # what an accelerometer lacks turns the direction by which a gyroscope is judged
        if more.content["status"] != "nothing":
            break
    return PoseResult(contents, problem.sensor, solution, calibrations, choices, residuals)


def fitted_effects(calibrations, base):
    """Return the FittedEffects of effects of a base, in its order, that calibrations hold."""
    every = {
        (sensor, fitted.effect): fitted
        for sensor, calibration in calibrations.items()
        for fitted in calibration.effects
    }
    return [every[effect.sensor, effect.effect] for effect in base]


def judged_residuals(choices, kinds, errors, sensor=None, before=None):
    """Return verdict and residuals of a PoseProblem, and what is left of them, pose by pose.

    Of some kinds of residual: the contract's fields, and the columns of `residual_columns`. Before
    is without the effects of a `sensor`, of all if none is named, or, if given, as other Choices of
    the same rows have it. `errors` are those held out with all effects.
    """
    problem, added = choices.problem, choices.choice().base
    pair, settings = problem.sensor, problem.settings
    others = tuple(e for e in added if sensor and e.sensor != sensor)
    start = before or choices
    more = len(others) < len(added) or start is not choices
    errors = (start.following(kinds_of(others)) if more else errors), errors
    base = start.problem.linearized(others if more else added)
    final = problem.linearized(added)
    # the noise is as likely as the fit with the effects has it
    (_, judged_base), (weights, judged_final) = (
        _judged(problem, kinds, *side) for side in zip((base, final), errors, strict=True)
    )
    floors = [
        np.diag(held_out_covariance(c, base.jacobian, problem.ends))[:, None]
        for _, c in final.alternatives
    ]
    floor = np.tensordot(weights, floors, 1)
    share = settings.significance / RESIDUALS / settings.family
    residuals, above, slow = {}, (False, False), False
    for k, kind in enumerate(kinds):
        unit, rows = pair.kinds[kind][0], problem.of_kind(kind)
        judged = judged_base[k], judged_final[k]
        entry, found = residual_entry(problem, kind, unit, rows, judged, errors, floor, share, more)
        above = np.logical_or(above, found)
        if kind != "rotation" or not problem.recording.rotations.aliased.any():
            slow |= judged[1].estimated < share
        each = [size_of(problem, kind, np.sqrt(v[rows])) for v in floors]
        residuals[kind] = entry | {
            "floor_range": floor_range(weights, each, entry["floor"]),
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
    # what is left of a residual has its sign
    left = (*(-each[:, 0] for each in errors), base.values, final.values)
    return found, residual_columns(problem, kinds, left, floor[:, 0])


def undersampled(problem, solution, floor):
    """Return what the rate of the log adds to the rotations if it is more than all other noise.

    Beside the noise as it was estimated; no more than the `floor` of the residual, rad, has of it.
    At ``enough_hz`` it would be as large as the others: its variance falls with the rate as the
    spectrum of the turns does with frequency.
    """
    sensor, recording, rotations = problem.sensor, problem.recording, problem.recording.rotations
    if not rotations.aliased.any():
        return {}
    found = [
        sensor.covariance_at(solution.fit.x, each, solution.effects).by(sensor.noise)
        for each in (recording, recording.without_aliasing())
    ]
    sums = (np.diag(each)[-2 * len(rotations) :].sum() for each in found)
    whole, others = (total / len(rotations) for total in sums)
    own, rate = min(whole, floor**2) - others, 1 / np.median(rotations.steps[rotations.steps > 0])
    if own <= others:
        return {}
    enough = rate * (own / others) ** (1 / np.average(rotations.fall, weights=rotations.aliased))
    found = {"error": own**0.5, "others": others**0.5, "rate_hz": rate, "enough_hz": enough}
    return {"undersampled": {name: float(value) for name, value in found.items()}}


def final_solution(problem, base):
    """Return the fit with some effects and the calibrations by it.

    Their covariance is that of the noise's uncertainty too.
    """
    solution = problem.linearized(base).solution
    return solution, problem.sensor.calibrations(solution, problem.covariance(base))


def _judged(problem, kinds, about, errors):
    """Return what `judge` does of some kinds of residuals about a fit and of held-out errors."""
    groups = [problem.of_kind(kind) for kind in kinds]
    alternatives = [
        (prior, [(about.values, covariance, about.jacobian, problem.ends, groups)])
        for prior, covariance in about.alternatives
    ]
    return judge(alternatives, [(errors[rows] ** 2).sum() for rows in groups])


def harmonics(directions, degree):
    """Return the real spherical harmonics of one degree, shape (n, 2 degree + 1)."""
    x, y, z = (directions / np.linalg.norm(directions, axis=1, keepdims=True)).T
    theta, phi = np.arccos(np.clip(z, -1, 1)), np.arctan2(y, x)
    values = [sph_harm_y(degree, m, theta, phi) for m in range(degree + 1)]
    return np.column_stack([v.real for v in values] + [v.imag for v in values[1:]])


def _probes(problem, sensor):
    """Return name, kind and columns of what the residual may go with: no effects, but signposts."""
    recording, found = problem.recording, []
    poses, rotations = recording.poses, recording.rotations
    time = (poses.mid_s / (poses.mid_s.max() - poses.mid_s.min()))[:, None] ** [1, 2]
    own = slice(0, 3) if sensor == "accelerometer" else slice(3, 6)
    previous = np.vstack([np.zeros((1, 3)), poses.f[:-1]])
    previous[np.diff(poses.session, prepend=-1) != 0] = 0
    at_pose = {f"harmonics_{d}": harmonics(poses.f, d) for d in DEGREES}
    at_pose |= {"time": time, "pose_variance": poses.variance[:, own], "previous_pose": previous}
    # the mean rate over a rotation, with its sign
    turned = np.einsum("mki,mk->mi", rotations.w[:, 1:], rotations.steps)
    speed = turned / (rotations.end_s - rotations.start_s)[:, None]
    in_turn = {
        "time": time[rotations.first],
        "previous_pose": poses.f[rotations.first],
        "rotation_speed": speed,
    }
    if poses.temperature is not None:
        rate = np.gradient(poses.temperature, poses.mid_s) if len(poses) > 1 else time[:, 0]
        for name, values in (("temperature", poses.temperature), ("temperature_rate", rate)):
            at_pose[name] = values[:, None]
            in_turn[name] = values[rotations.first, None]
    for kind in OF_SENSOR[sensor]:
        probes = in_turn if kind == "rotation" else at_pose
        found += [(name, kind, problem.probe(kind, values)) for name, values in probes.items()]
    return found
