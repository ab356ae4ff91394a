"""The poses of a sensor: what is missing in its model, what it is, and what remains with it."""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import LinAlgError
from scipy.special import softmax

from imuloop.calibrate.least_squares import SINGULAR
from imuloop.calibrate.pose_fits import Solution, fitted_calibration
from imuloop.diagnose.candidates import candidates
from imuloop.diagnose.choice import Choices
from imuloop.diagnose.content import (
    candidate_entries,
    effect_entries,
    residual_entry,
    size_of,
    untried,
)
from imuloop.diagnose.correlates import correlates
from imuloop.diagnose.likeness import imitated
from imuloop.diagnose.records.pose_tables import residual_columns
from imuloop.diagnose.records.poses import PoseProblem, interleaved
from imuloop.diagnose.records.probes import pose_probes
from imuloop.diagnose.residuals import chance, chi_square, floor_range, held_out_covariance
from imuloop.diagnose.verdict import NOTHING, Judged, verdict

# kinds of residuals at the poses of a device, which share the significance: gravity norm, pose
# rate, rotation
KINDS = 3


@dataclass(frozen=True)
class PoseResult:
    """The diagnosis of a sensor at the poses.

    Attributes
    ----------
    content : dict
        The contract's fields.
    solution : Solution or None
        The fit with the effects that were added; None where nothing could be fitted.
    choices : Choices or None
        The searches; None where nothing could be tested.
    residuals : dict of str to ndarray
        As of `residual_columns`; empty where nothing could be tested.
    """

    content: dict
    solution: Solution | None = None
    choices: Choices | None = None
    residuals: dict = field(default_factory=dict)

    @property
    def effects(self):
        """The effects that were added; None where nothing could be tested."""
        return self.choices.choice().base if self.choices else None


def pose_candidates(sensor, recording):
    """Return what `candidates` does for a sensor at the poses; nothing to try without poses."""
    poses = recording.poses
    if not len(poses):
        return {}, {}
    other = poses.w if sensor == "accelerometer" else poses.f
    return candidates(sensor, "poses", recording.pose_channels(sensor, lambda y: y, other))


def pose_problem(
    sensor, recording, settings, tests, fold=None, found=(), told=None, directions=None
):
    """Return the PoseProblem of a sensor; parts are interleaved without others."""
    available, _ = pose_candidates(sensor.sensor, recording)
    known = set(map(type, found))
    shapes = {cls: own for cls, own in available.items() if cls not in known}
    if fold is None:
        fold = interleaved(len(recording.poses), settings.folds)
    return PoseProblem(
        sensor, recording, shapes, settings, tests, fold, tuple(found), told, directions
    )


def diagnose_poses(sensor, recording, settings, tests=None, found=(), told=None, directions=None):
    """Diagnose one sensor at the poses.

    Parameters
    ----------
    sensor : AccelerometerPoses or GyroscopePoses
        How the sensor is fitted.
    recording : Recording
        Poses and rotations.
    settings : DiagnoseSettings
        Settings.
    tests : int, optional
        Number of tests that share the significance; this sensor's own by default.
    found : sequence of Effect
        Effects that other records show.
    told, directions : callable, optional
        As of PoseProblem.

    Returns
    -------
    PoseResult
        What was found.
    """
    if reason := sensor.untestable(recording):
        return PoseResult({"verdict": "not_testable", "why": reason, **NOTHING})
    tests = tests or len(pose_candidates(sensor.sensor, recording)[0])
    problem = pose_problem(sensor, recording, settings, tests, None, found, told, directions)
    try:
        if reason := problem.lost(()):
            return PoseResult({"verdict": "not_testable", "why": reason, **NOTHING})
        keeps = [problem.fold_of_pose != k for k in range(problem.parts)]
        if any(sensor.undetermined(recording, keeps)):
            reason = f"{len(keeps[0])} poses do not determine the model with a part held out"
            solution = final_solution(problem, ())
            return PoseResult({"verdict": "not_testable", "why": reason, **NOTHING}, solution)
        return _diagnosed(Choices(problem))
    except LinAlgError:
        return PoseResult({"verdict": "not_testable", "why": SINGULAR, **NOTHING})


def directions_without(choices, out, searched):
    """Return gravity's direction at all poses by an accelerometer that does not see some parts.

    Parameters
    ----------
    choices : Choices
        Of the accelerometer.
    out : frozenset of int
        The parts.
    searched : bool or collection
        Whether it may choose effects.
    """
    problem = choices.problem
    base = choices.choice(out).base if searched else ()
    return problem.sensor.directions(problem.fitted(base, out), problem.recording)


def _diagnosed(choices):
    """Return the PoseResult of poses whose fit without effects is one."""
    problem, choice = choices.problem, choices.choice()
    sensor, settings = problem.sensor, problem.settings
    errors = choices.following(()), choices.errors(choices.nested)
    base, final = problem.about(), problem.about(choice.base)
    sides = zip((base, final), errors, strict=True)
    judged = [_judged(problem, about, own) for about, own in sides]
    weights = judged[1][0]
    floors = [
        np.diag(held_out_covariance(c, base.jacobian, problem.ends))[:, None]
        for _, c in final.alternatives
    ]
    floor = np.tensordot(weights, floors, 1)
    solution = final_solution(problem, choice.base)
    share, chosen = settings.significance / KINDS / settings.family, bool(choice.base)
    residuals, above, slow = {}, (False, False), False
    for kind, (unit, _) in sensor.kinds.items():
        rows = problem.of_kind(kind)
        own = [side[kind] for _, side in judged]
        entry, found = residual_entry(problem, kind, unit, rows, own, errors, floor, share, chosen)
        above = np.logical_or(above, found)
        slow |= own[1].estimated < share
        each = [size_of(problem, kind, np.sqrt(v[rows])) for v in floors]
        residuals[kind] = entry | {
            "floor_range": floor_range(weights, each, entry["floor"]),
            "in_sample_before": size_of(problem, kind, base.values[rows][:, None]),
            "in_sample_after": size_of(problem, kind, final.values[rows][:, None]),
        }
    _, others = pose_candidates(sensor.sensor, problem.recording)
    others = {cls: why for cls, why in others.items() if cls not in set(map(type, problem.found))}
    fitted = solution.calibration.effects[len(problem.found) :]
    content = {
        "verdict": verdict(*above, choice.base),
        "slow_noise": bool(slow and not above[1]),
        "residuals": residuals,
        "effects": effect_entries(sensor.sensor, fitted, choices),
        "candidates": [
            *candidate_entries(sensor.sensor, choices, others),
            *(untried(e.name, "added", "found in the static record") for e in problem.found),
        ],
        "confounded": imitated(choices.search()),
        "correlates": correlates(choices.search(), choice.base, _probes(problem)),
    }
    # what is left of a residual has its sign
    left = (*(-each[:, 0] for each in errors), base.values, final.values)
    return PoseResult(content, solution, choices, residual_columns(problem, left, floor[:, 0]))


def final_solution(problem, base):
    """Return the fit with some effects, its covariance that of the noise's uncertainty too."""
    solution = problem.about(base).solution
    calibration = fitted_calibration(problem.sensor, solution, problem.covariance(base))
    return replace(solution, calibration=calibration)


def _judged(problem, about, errors):
    """Return probabilities of the noise's alternatives, and the Judged of each kind of residual."""
    groups = [problem.of_kind(kind) for kind in problem.sensor.kinds]
    found, likelihoods, heldout = [], [], []
    for _, covariance in about.alternatives:
        left, likelihood = chi_square(about.values, covariance, about.jacobian, groups)
        spread = held_out_covariance(covariance, about.jacobian, problem.ends)
        likelihoods.append(likelihood)
        found.append(left)
        heldout.append([chance((errors[g] ** 2).sum(), [spread[np.ix_(g, g)]]) for g in groups])
    weights = softmax(np.add([prior for prior, _ in about.alternatives], likelihoods))
    return weights, {
        kind: Judged.of(weights, [each[k] for each in found], [each[k] for each in heldout])
        for k, kind in enumerate(problem.sensor.kinds)
    }


def _probes(problem):
    """Return name, kind and columns of what the residual may go with."""
    probed, found = pose_probes(problem.recording, problem.sensor.sensor), []
    for kind, (_, k) in problem.sensor.kinds.items():
        for name, values in probed["rotation" if kind == "rotation" else "pose"].items():
            columns = np.zeros((len(problem.fold), 1, k * values.shape[1]))
            columns[problem.of_kind(kind), 0] = np.kron(values - values.mean(axis=0), np.eye(k))
            found.append((name, kind, columns))
    return found
