"""The poses of a sensor: what is missing in its model, what it is, and what remains with it."""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import LinAlgError
from scipy.special import sph_harm_y

from imuloop.calibrate.least_squares import SINGULAR
from imuloop.calibrate.pose_fits import Solution, fitted_calibration
from imuloop.diagnose.candidates import candidates
from imuloop.diagnose.choice import Choices
from imuloop.diagnose.content import residual_entry, search_content, size_of, untried
from imuloop.diagnose.records.pose_tables import residual_columns
from imuloop.diagnose.records.poses import PoseProblem, interleaved
from imuloop.diagnose.residuals import floor_range, held_out_covariance
from imuloop.diagnose.verdict import judge, leaves, not_testable, verdict

# kinds of residuals at the poses of a device, which share the significance: gravity norm, pose
# rate, rotation
KINDS = 3
# attitude patterns below degree 3 are those of bias, scale factor and misalignment
DEGREES = (3, 4, 5)


@dataclass(frozen=True)
class PoseResult:
    """The diagnosis of a sensor at the poses."""

    content: dict  # the contract's fields
    # the fit with the effects that were added; None where nothing could be fitted
    solution: Solution | None = None
    # the library's searches; None where nothing could be tested
    choices: Choices | None = None
    # as of `residual_columns`; empty where nothing could be tested
    residuals: dict = field(default_factory=dict)
    formula: tuple = ()  # the effect that no library has, if one was found

    @property
    def effects(self):
        """The effects of the library that were added; None where nothing could be tested."""
        return self.choices.choice().base if self.choices else None


def pose_candidates(sensor, recording):
    """Return what `candidates` does for a sensor at the poses; nothing to try without poses."""
    poses = recording.poses
    if not len(poses):
        return {}, {}
    other = poses.w if sensor == "accelerometer" else poses.f
    return candidates(sensor, "poses", recording.pose_channels(sensor, lambda y: y, other))


def pose_problem(
    sensor,
    recording,
    settings,
    tests,
    fold=None,
    found=(),
    information=None,
    directions=None,
    base_rows=None,
):
    """Return the PoseProblem of a sensor; parts are interleaved without others."""
    available, _ = pose_candidates(sensor.sensor, recording)
    shapes = {cls: s for cls, s in available.items() if cls not in set(map(type, found))}
    if fold is None:
        fold = interleaved(len(recording.poses), settings.folds)
    problem = PoseProblem(
        sensor, recording, shapes, settings, tests, fold, tuple(found), information, directions
    )
    return replace(problem, base_rows=base_rows) if base_rows else problem


def diagnose_poses(
    sensor,
    recording,
    settings,
    tests=None,
    found=(),
    information=None,
    directions=None,
    base_rows=None,
    beyond=None,
    misfit=None,
):
    """Return the PoseResult of one sensor; arguments as of PoseProblem.

    Without a number of tests, which share the significance, this sensor's own count. `beyond`, if
    any, is `imuloop.discover.beyond.beyond`: it looks for what the library leaves. What it finds
    `misfit` may tell from what looks like it: it takes a SensorCalibration, gives χ² and reduced χ²
    of data that depend on it.
    """
    if reason := sensor.untestable(recording):
        return PoseResult(not_testable(reason))
    tests = tests or len(pose_candidates(sensor.sensor, recording)[0])
    problem = pose_problem(
        *(sensor, recording, settings, tests, None, found, information, directions, base_rows)
    )
    try:
        if reason := problem.lost(()):
            return PoseResult(not_testable(reason))
        keeps = [problem.fold_of_pose != k for k in range(problem.parts)]
        if any(sensor.undetermined(recording, keeps)):
            reason = f"{len(keeps[0])} poses do not determine the model with a part held out"
            return PoseResult(not_testable(reason), final_solution(problem, ()))
        return _diagnosed(Choices(problem), beyond, misfit)
    except LinAlgError:
        return PoseResult(not_testable(SINGULAR))


def directions_without(choices, out, searched, formula=()):
    """Return gravity's direction at all poses by an accelerometer that does not see some parts.

    `choices` are those of the accelerometer, `searched` whether it may choose effects; `formula`
    is what it has beyond them, fitted here too.
    """
    problem = choices.problem
    base = (*(choices.choice(out).base if searched else ()), *formula)
    return problem.sensor.directions(problem.fitted(base, out), problem.recording)


def _diagnosed(choices, beyond, misfit):
    """Return the PoseResult of poses whose fit without effects is one."""
    problem, added = choices.problem, choices.choice().base
    sensor, solution = problem.sensor, final_solution(problem, added)
    judged, residuals = judged_residuals(choices, sensor.kinds, KINDS)
    others = pose_candidates(sensor.sensor, problem.recording)[1]
    others = {cls: why for cls, why in others.items() if cls not in set(map(type, problem.found))}
    fitted = solution.calibration.effects[len(problem.found) :]
    content = {**judged, **search_content(sensor.sensor, choices, fitted, others, _probes(problem))}
    content["candidates"] += [
        untried(e.name, "added", "found in the static record") for e in problem.found
    ]
    formula = ()
    if beyond and leaves(judged) and (more := beyond("poses", sensor.sensor, choices)):
        if misfit:
            about = more.choices and more.choices.problem
            more = more.told_apart(lambda e: misfit(final_solution(about, e).calibration))
        content["discovered"] = more.content
        if more.choices:
            formula = more.choices.base[-1:]
            judged, residuals = judged_residuals(more.choices, sensor.kinds, KINDS)
            solution = final_solution(more.choices.problem, more.choices.base)
            fitted = solution.calibration.effects[len(problem.found) :]
            content |= judged | more.joined(content["effects"], content["candidates"], fitted)
    return PoseResult(content, solution, choices, residuals, formula)


def judged_residuals(choices, kinds, count, before=None):
    """Return verdict and residuals of a PoseProblem, and what is left of them, pose by pose.

    Of some kinds of residual, `count` of which share the significance: the contract's fields, and
    the columns of `residual_columns`. `before` are Choices of the same rows with less in their
    model, if that of `choices` has more than the effects that it adds.
    """
    problem, added = choices.problem, choices.choice().base
    sensor, settings = problem.sensor, problem.settings
    before = before or choices
    more = bool(added) or before is not choices
    errors = before.following(()), choices.errors(choices.nested)
    base, final = before.problem.linearized(), problem.linearized(added)
    # the noise is as likely as the fit with the effects has it
    (_, judged_base), (weights, judged_final) = (
        _judged(problem, kinds, *side) for side in zip((base, final), errors, strict=True)
    )
    floors = [
        np.diag(held_out_covariance(c, base.jacobian, problem.ends))[:, None]
        for _, c in final.alternatives
    ]
    floor = np.tensordot(weights, floors, 1)
    share = settings.significance / count / settings.family
    residuals, above, slow = {}, (False, False), False
    for k, kind in enumerate(kinds):
        unit, rows = sensor.kinds[kind][0], problem.of_kind(kind)
        judged = judged_base[k], judged_final[k]
        entry, found = residual_entry(problem, kind, unit, rows, judged, errors, floor, share, more)
        above = np.logical_or(above, found)
        if kind != "rotation" or problem.recording.rotations.aliased is None:
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
    if rotations.aliased is None:
        return {}
    found = [sensor.covariances(solution, r) for r in (recording, recording.without_aliasing())]
    sums = (np.diag(each(sensor.noise))[-2 * len(rotations) :].sum() for each in found)
    whole, others = (total / len(rotations) for total in sums)
    own, rate = min(whole, floor**2) - others, 1 / np.median(rotations.steps[rotations.steps > 0])
    if own <= others:
        return {}
    enough = rate * (own / others) ** (1 / np.average(rotations.fall, weights=rotations.aliased))
    found = {"error": own**0.5, "others": others**0.5, "rate_hz": rate, "enough_hz": enough}
    return {"undersampled": {name: float(value) for name, value in found.items()}}


def final_solution(problem, base):
    """Return the fit with some effects, its covariance that of the noise's uncertainty too."""
    solution = problem.linearized(base).solution
    calibration = fitted_calibration(problem.sensor, solution, problem.covariance(base))
    return replace(solution, calibration=calibration)


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


def _probes(problem):
    """Return name, kind and columns of what the residual may go with: no effects, but signposts."""
    recording, found = problem.recording, []
    poses, rotations = recording.poses, recording.rotations
    time = (poses.mid_s / (poses.mid_s.max() - poses.mid_s.min()))[:, None] ** [1, 2]
    own = slice(0, 3) if problem.sensor.sensor == "accelerometer" else slice(3, 6)
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
    for kind in problem.sensor.kinds:
        probes = in_turn if kind == "rotation" else at_pose
        found += [(name, kind, problem.probe(kind, values)) for name, values in probes.items()]
    return found
