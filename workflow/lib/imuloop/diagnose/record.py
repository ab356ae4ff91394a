"""Diagnosis of one kind of record: search for effects, and residuals compared with their floor."""

from dataclasses import dataclass, field

import numpy as np

from imuloop.core.errors import plural
from imuloop.diagnose.content import residuals_content, search_content, size_of
from imuloop.diagnose.pose_problem import PoseProblem
from imuloop.diagnose.tables import residual_columns
from imuloop.effects.products import Product
from imuloop.estimate.choice import Choices
from imuloop.estimate.least_squares import Fit
from imuloop.estimate.search import kinds_of
from imuloop.estimate.verdict import LEFT, ResidualGroup, compare_with_noise, may_lack_effect
from imuloop.factors.factors import VELOCITY
from imuloop.model.effects import EffectKind, SensorEffect

# kinds of residuals that grow if the device moves during rests, and the share of such rests from
# which on the motion may explain these residuals
MOVED, MOVED_RESTS = {"pose_rate", "rotation", *VELOCITY}, 0.1
STILL = "left may be that: wait 3 s after putting it down, or lay it on a table"
# alternatives of the noise that are less probable than this do not count for the range of the floor
NEGLIGIBLE = 0.025


@dataclass(frozen=True)
class PoseResult:
    """The diagnosis of both sensors at the poses, or in the moves between them."""

    contents: dict  # content of diagnosis.json, by sensor
    problem: PoseProblem | None = None  # None if the poses determine no sensor
    # the fit with the added effects; None if nothing could be fitted
    solution: Fit | None = None
    calibrations: dict = field(default_factory=dict)  # calibration of each fitted sensor
    choices: Choices | None = None  # the searches; None if nothing could be tested
    # columns of residuals for poses.parquet or moves.parquet; empty if nothing could be tested
    residuals: dict = field(default_factory=dict)
    # reason why the calibration of a sensor is rejected, by sensor
    rejected: dict = field(default_factory=dict)


def diagnose_record(problem, kinds_by_sensors, reasons, formulas):
    """Return the effects that a record shows, and the verdict on the residuals that remain.

    Parameters
    ----------
    problem : PoseProblem
        The rows of the record.
    kinds_by_sensors : dict of tuple to tuple
        For each tuple of names of sensors, the kinds of residuals that judge these sensors.
    reasons : dict of str to dict
        By sensor, status and reason of the effects that are not tried.
    formulas : callable
        Takes the name of a sensor and returns Products, effects without a known cause. They are
        tried if, with all other effects in the model, the model may still lack an effect
        (`may_lack_effect`).

    Returns
    -------
    PoseResult
    """
    choices, formulas_by_kind = Choices(problem), {}
    contents, columns = judge_residuals(choices, kinds_by_sensors)
    for sensor in (s for s, content in contents.items() if may_lack_effect(content)):
        if variants := formulas(sensor):
            kind = EffectKind(Product, sensor)
            formulas_by_kind[kind] = tuple(SensorEffect(variant, sensor) for variant in variants)
    if formulas_by_kind:
        choices = Choices(problem.with_formulas(formulas_by_kind))
        contents, columns = judge_residuals(choices, kinds_by_sensors)
    effects = choices.choice().effects
    solution, calibrations = final_solution(problem, effects)
    # the added effects with their parameters, in the order in which they were added
    fitted = {(s, f.effect): f for s, c in calibrations.items() for f in c.effects}
    added = [fitted[e.sensor, e.effect] for e in effects]
    contents = {
        sensor: content | search_content(choices, added, reasons.get(sensor, {}), sensor)
        for sensor, content in contents.items()
    }
    return PoseResult(contents, problem, solution, calibrations, choices, columns)


def judge_residuals(choices, kinds_by_sensors):
    """Return the verdict on the residuals of a record, which compares each kind with its floor.

    The floor is the held-out error that the noise alone gives.

    Parameters
    ----------
    choices : Choices
        The searches and the choice of effects.
    kinds_by_sensors : dict of tuple to tuple
        For each tuple of names of sensors, the kinds of residuals that judge these sensors.

    Returns
    -------
    dict of str to dict
        By sensor, the fields of diagnosis.json about the residuals.
    dict of str to ndarray
        Columns of all kinds of residuals for poses.parquet or moves.parquet.
    """
    # held-out errors, for which the effects are chosen again without each fold
    errors, contents, columns = choices.errors(choices.nested_choice), {}, {}
    for sensors, kinds in kinds_by_sensors.items():
        content, columns_of_kinds = judge_sensors(choices, sensors, kinds, errors)
        contents |= dict.fromkeys(sensors, content)
        columns |= columns_of_kinds
    return contents, columns


def judge_sensors(choices, sensors, kinds, errors):
    """Return the residuals that judge some sensors, compared with their floor.

    The floor is the held-out error that the noise alone gives. Residuals ``before`` come from a
    model without the effects that were added to these sensors, residuals ``after`` from one with
    all added effects.

    Parameters
    ----------
    choices : Choices
        Searches and choice of effects for a PoseProblem of N rows, components of residuals.
    sensors : tuple of str
        Names of the sensors.
    kinds : tuple of str
        Kinds of residuals that judge them.
    errors : ndarray, shape (N, 1)
        Held-out errors with all added effects; nan in rows that cannot be predicted.

    Returns
    -------
    dict
        Fields of diagnosis.json: ``verdict``; ``residuals``, a dict by kind; and ``slow_noise``,
        whether the residuals are explained only if slow noise is larger than estimated.
    dict of str to ndarray
        Columns of these kinds of residuals for poses.parquet or moves.parquet.
    """
    problem, added = choices.problem, choices.choice().effects
    effects_before = tuple(e for e in added if e.sensor not in sensors)
    has_effects = len(effects_before) < len(added)
    errors_before = choices.errors_with(kinds_of(effects_before)) if has_effects else errors
    # rows next to a step cannot be predicted: they do not count in either error
    predicted = np.isfinite(errors_before) & np.isfinite(errors)
    errors = [np.where(predicted, e, np.nan) for e in (errors_before, errors)]
    before, after = problem.linearization(effects_before), problem.linearization(added)
    weights, comparisons = compare_rows(problem, after, kinds, errors[1])
    comparisons = comparisons, comparisons
    if has_effects:
        comparisons = compare_rows(problem, before, kinds, errors[0])[1], comparisons[1]
    # the floor is the mean over the alternatives of the noise in the fit with effects
    by_noise = after.error_covariances
    if has_effects:
        by_noise = before.error_covariances_by(after.alternatives[1])
    floors = np.where(predicted, [np.diag(noise)[:, None] for noise in by_noise], np.nan)
    floor = np.tensordot(weights, floors, 1)
    content = residuals_content(problem, kinds, comparisons, errors, floor, has_effects)
    for kind, entry in content["residuals"].items():
        rows = problem.of_kind(kind)
        sizes = [size_of(problem, kind, np.sqrt(f[rows])) for f in floors[weights >= NEGLIGIBLE]]
        sizes.append(entry["floor"])
        entry["floor_range"] = [min(sizes), max(sizes)]
        for when, linearization in (("before", before), ("after", after)):
            in_sample = linearization.values[rows][:, None]
            entry[f"in_sample_{when}"] = size_of(problem, kind, in_sample)
    if "rotation" in kinds:
        entry = content["residuals"]["rotation"]
        entry |= undersampling_error(problem, after, entry["floor"])
    significance = problem.settings.residual_significance
    content["slow_noise"] = content["verdict"] not in LEFT and any(
        comparison.p_value_as_estimated < significance
        for kind, comparison in zip(kinds, comparisons[1], strict=True)
        # turns that were sampled too slowly have their own error, which is not slow noise
        if kind != "rotation" or not problem.recording.rotations.aliased.any()
    )
    moved = problem.recording.poses.tilt > 0
    may_have_moved = MOVED.intersection(kinds) and moved.mean() >= MOVED_RESTS
    if content["verdict"] == "unexplained" and may_have_moved:
        why = f"the device moved in {moved.sum()} of {plural(len(moved), 'rest')}, and what is "
        content |= {"verdict": "not_testable", "why": why + STILL}
    # held-out errors get the same sign as the residuals of the fit
    signed = (*(-e[:, 0] for e in errors), before.values, after.values)
    return content, residual_columns(problem, kinds, signed, floor[:, 0])


def compare_rows(problem, linearization, kinds, errors):
    """Return how the residuals of a fit of all poses compare with those that noise alone gives.

    Parameters
    ----------
    problem : PoseProblem
        Problem with N rows, one for each component of a residual.
    linearization : Linearization
        The fit, with m alternatives of the noise: covariances that it may have.
    kinds : sequence of str
        Kinds of residuals.
    errors : ndarray, shape (N, 1)
        Held-out errors with the effects of the fit; nan in rows that are not predicted.

    Returns
    -------
    ndarray, shape (m,)
        Probability of each alternative.
    list of NoiseComparison
        The comparison for each kind.
    """
    log_prior, covariances = linearization.alternatives
    group = ResidualGroup(
        values=linearization.values,
        errors=errors,
        jacobian=linearization.jacobian,
        covariances=covariances,
        error_covariances=linearization.error_covariances,
        kinds=[problem.of_kind(kind) for kind in kinds],
    )
    return compare_with_noise([group], log_prior)


def undersampling_error(problem, linearization, floor):
    """Return the error that slow sampling causes in the rotations, if it exceeds all other noise.

    Slow sampling misses a part of the motion. The errors, by sampling and by all other noise, are
    root mean squares per rotation. They come from the noise as estimated.

    Parameters
    ----------
    problem : PoseProblem
        The poses and the rotations between them.
    linearization : Linearization
        The fit of all poses.
    floor : float
        Held-out error of the rotations that the noise alone gives, rad. The error by sampling is
        reduced so that both errors together are not larger than this floor.

    Returns
    -------
    dict
        The field ``undersampled`` if the error exceeds all other noise; otherwise the dict is
        empty. The field has the ``error`` by sampling and the error by all other noise,
        ``others``, rad; the sample rate ``rate_hz``; and ``enough_hz``, the rate at which both
        errors would be equal. The variance by sampling falls with the rate as the spectrum of the
        turns does.
    """
    rotations, noise = problem.recording.rotations, linearization.factors.noise
    if not rotations.aliased.any():
        return {}
    # variances, rad², of a rotation; the last rows belong to the rotations, two each
    others, sampling = (
        np.diag(covariance)[-2 * len(rotations) :].sum() / len(rotations)
        for covariance in (noise.by(problem.joint_fit.noise, aliasing=False), noise.of_aliasing())
    )
    sampling = min(others + sampling, floor**2) - others
    if sampling <= others:
        return {}
    rate = 1 / np.median(rotations.steps[rotations.steps > 0])
    fall = np.average(rotations.fall, weights=rotations.aliased)
    entry = {"error": float(sampling**0.5), "others": float(others**0.5), "rate_hz": float(rate)}
    entry["enough_hz"] = float(rate * (sampling / others) ** (1 / fall))
    return {"undersampled": entry}


def final_solution(problem, effects):
    """Return the Fit of all poses with some `effects`, and the calibration of each sensor by it.

    `problem` is the PoseProblem. The calibrations are a dict by sensor. Their covariance includes
    the uncertainty of the noise.
    """
    solution = problem.linearization(effects).solution
    return solution, problem.joint_fit.calibrations(solution, problem.covariance(effects))
