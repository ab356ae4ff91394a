"""Diagnosis of the moves between poses: the velocity at the end of a move should be zero."""

from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy.linalg import LinAlgError

from imuloop.core.errors import plural
from imuloop.core.precision import precision
from imuloop.core.samples import SENSORS
from imuloop.diagnose.content import untried
from imuloop.diagnose.pose_problem import PoseProblem, interleaved_folds
from imuloop.diagnose.record import PoseResult, diagnose_record
from imuloop.effects.products import products
from imuloop.effects.steps import Steps
from imuloop.estimate.least_squares import why_no_fit
from imuloop.estimate.search import kinds_of
from imuloop.estimate.verdict import not_testable
from imuloop.factors.factors import AT_RESTS, VELOCITY
from imuloop.factors.rows import midpoints
from imuloop.model.effect import Effect
from imuloop.model.effects import EffectKind, SensorEffect
from imuloop.model.state import BIAS, COUNT, State

# least number of usable moves
LEAST_MOVES = 10
# m/s; largest velocity that a usable move may lose between two samples: half a g at 100 Hz
LARGEST_KNOCK = 0.05
# largest velocity that dropped samples of a usable move may hide, over the velocity error by noise
LARGEST_HIDDEN = 0.25
MOVE_SOFTLY = (
    "low-pass the accelerometer below half the rate, turn in one to two seconds and set the device "
    "down softly"
)
LOG_EVERY_SAMPLE = "log every sample"
LATE_SENSOR = (
    "motion shows how late one sensor is after the other: it is given to the accelerometer"
)


class MotionProblem(PoseProblem):
    """The poses of a device and the moves between them, as a problem for `Choices`.

    A row is one component of the residual of a pose, or of the velocity after a move.
    Cross-validation holds out rows of moves only. Every fit uses all poses, which determine the
    base model.
    """

    @cached_property
    def rows(self):
        """The move of each row, (n, 2) of int, and the kind of residual of each row, (N,) of str.

        A row is one component of a residual. The first array covers the n rows of poses and moves.
        A row of a move has the index of the move twice, as a move is held out as a whole. A row of
        a pose has the index -1 twice. The other N - n rows come last and belong to a prior; their
        kind is an empty string.
        """
        poses, kind = super().rows
        move = np.searchsorted(self.recording.rotations.first, poses[:, :1])
        at_rest = np.isin(kind[: len(poses), None], AT_RESTS)
        return np.where(at_rest, -1, move).repeat(2, axis=1), kind

    @cached_property
    def error_scale(self):
        """Standard deviation of each of N rows by the noise, (N,), the unit of its held-out error.

        A row is one component of a residual. The noise is the likeliest one without effects. Its
        standard deviation is a good unit because it grows with the length of a move, as the error
        by a missing effect does.
        """
        # the last noise hypothesis is the likeliest
        likeliest = self.linearization().evidence.row_groups[0].noise.precision[-1]
        return np.sqrt(np.diag(precision(likeliest)[0]))


def candidates_in_motion(nuisance_kinds):
    """Return the variants of effects to try in motion, a dict of tuples by kind of effect.

    A variant is an effect with values of its constants. The kinds of effects that other records
    showed, `nuisance_kinds`, are left out: every fit estimates these effects anyway.
    """
    variants = {}
    for cls in Effect.library.values():
        kind = EffectKind(cls, cls.sensors[0])
        if "motion" in cls.records and kind not in nuisance_kinds:
            # the variants of effects in motion do not depend on the data
            variants[kind] = tuple(SensorEffect(v, kind.sensor) for v in cls.variants(None))
    return variants


def motion_products(sensor):
    """Return the Products that only motion shows on a `sensor`, a tuple of effects to try.

    They are products of specific force and angular rate, as errors of the accelerometer. The tuple
    is empty if `sensor`, the name, is the gyroscope.
    """
    every_product = products(sensor, "fw") if sensor == "accelerometer" else ()
    return tuple(product for product in every_product if "motion" in product.records)


def diagnose_motion(poses):
    """Return the effects that the moves of a device show, and the verdict on the velocities.

    The velocity at the end of a move should be zero.

    Parameters
    ----------
    poses : PoseResult
        The diagnosis at the poses, with the problem and the fit to start from.

    Returns
    -------
    PoseResult
        The diagnosis of the moves, which has calibrations if an effect was added.
    """
    problem, solution = poses.problem, poses.solution
    if solution is None or set(problem.joint_fit.estimated) != set(SENSORS):
        return no_result("the poses do not determine both sensors")
    recording, settings = problem.recording, problem.settings
    if recording.slow_force:
        why = "the accelerometer is slower than the gyroscope, and misses what a move does between"
        return no_result(f"{why} two of its samples: log both at one rate")
    # the parameters of the base model, without effects
    start, first, tilt = solution.x[:COUNT], recording.rotations.first, recording.poses.tilt
    knock = knocks(recording, start[BIAS])
    # dropped samples may hide too large a velocity; in a rest with a tilt the device is not still
    lossy = hidden_velocity(recording, start[BIAS]) > LARGEST_HIDDEN
    tilted = (tilt[first] > 0) | (tilt[first + 1] > 0)
    columns = {"knock_m_s": knock}
    usable = (knock <= LARGEST_KNOCK) & ~lossy & ~tilted & ~_has_step(recording, solution.effects)
    if usable.sum() < LEAST_MOVES:
        return no_result(_too_few_moves(recording, usable, knock, lossy, tilted), columns)
    state = State(solution.x, solution.effects)
    factors = replace(problem.joint_fit.factors, quiet=usable)
    factors = factors.without_rotation(recording, state, problem.joint_fit.noise)
    variants = candidates_in_motion(kinds_of(solution.effects))
    problem = MotionProblem(
        joint_fit=replace(problem.joint_fit, factors=factors, start=start),
        recording=recording,
        variants=variants,
        settings=settings,
        tests=problem.tests + settings.family * len(variants),
        # the last entry, at index -1, is the fold of the poses: none
        fold_of_pose=np.append(interleaved_folds(len(usable), settings.folds), -1),
        nuisance_effects=solution.effects,
        static=problem.static,
    )
    try:
        # the same residuals judge both sensors
        result = diagnose_record(problem, {tuple(SENSORS): VELOCITY}, {}, motion_products)
    except LinAlgError as error:
        return no_result(why_no_fit(error), columns)
    entry = untried("time_offset", "confounded", LATE_SENSOR)
    result.contents["gyroscope"]["candidates"].append(entry)
    for content in result.contents.values():
        content["moves"] = {"all": len(usable), "left_out": int((~usable).sum())}
    for name, values in result.residuals.items():
        columns[name] = np.full(len(usable), np.nan)
        columns[name][usable] = values
    has_new_effects = len(result.solution.effects) > len(solution.effects)
    calibrations = result.calibrations if has_new_effects else {}
    return replace(result, calibrations=calibrations, residuals=columns)


def _too_few_moves(recording, usable, knock, lossy, tilted):
    """Return the reason, text, why too few moves are usable, with a remedy.

    `usable`, (m,) of bool, says which of the m moves of the `recording` are usable. The other
    arguments, (m,) each, are faults of each move:

    - `knock`, the velocity that the move may lose between two samples, m/s; nan if the specific
      force is saturated.
    - `lossy`, whether dropped samples may hide too large a velocity.
    - `tilted`, whether a rest before or after the move has a tilt.
    """
    why = f"{usable.sum()} of {plural(len(usable), 'move')} without a knock"
    why += " and between rests without a tilt" * bool(tilted.any())
    if np.isnan(knock).any():
        why += " and within the accelerometer's range"
    why += " and without samples that are lost" * bool(lossy.any())
    # the remedy for the more frequent fault: lost samples, or knocks and saturation
    knocked = (knock > LARGEST_KNOCK) | np.isnan(knock)
    remedy = LOG_EVERY_SAMPLE if lossy.sum() > knocked.sum() else MOVE_SOFTLY
    return f"{why}, at least {LEAST_MOVES} needed{recording.lost.reason}: {remedy}"


def _has_step(recording, effects):
    """Return the moves in which a bias has a step, a mask, (m,) of bool.

    A step is an effect: a bias changes at one time and stays. A move with a step is not used, as
    the time of the step within the move is not known. `effects` are the SensorEffects of the model,
    and `recording` has the m moves.
    """
    mid, first = recording.poses.mid_s, recording.rotations.first
    times = [effect.effect.times[0] for effect in effects if effect.name == Steps.name]
    inside = [(mid[first] <= time) & (time <= mid[first + 1]) for time in times]
    return np.any([np.zeros(len(first), dtype=bool), *inside], axis=0)


def no_result(why, columns=None):
    """Return the PoseResult of moves that cannot be tested.

    `why` is the reason, one line of text. `columns` are columns of moves.parquet that were computed
    before, a dict; none by default.
    """
    contents = {sensor: not_testable(why) for sensor in SENSORS}
    return PoseResult(contents, residuals=columns or {})


def knocks(recording, gyroscope_bias):
    """Return the largest velocity that a knock between two samples may add to each move, m/s, (m,).

    `recording` has the m moves. A knock shorter than the sample interval may fall between two
    samples, so that its velocity is missing from the data. Each interval Δt may hide the velocity
    ``|Δf + w × f Δt| Δt``: Δf is the change of the specific force f over the interval, and w is the
    angular rate minus `gyroscope_bias`, (3,), in nominal SI (raw readings by the data sheet),
    rad/s. A move has the largest of these velocities over its intervals. A move in which the
    specific force is saturated has nan instead. A move with a large value, or with nan, is not
    used.
    """
    velocity = unsampled_velocity(recording.rotations, gyroscope_bias).max(axis=1)
    return np.where(recording.rotations.force_clipped, np.nan, velocity)


def hidden_velocity(recording, gyroscope_bias):
    """Return the velocity error that dropped samples cause in each move, over that by noise, (m,).

    A move with a large ratio is not used. Two errors are compared:

    - Over a gap of the length Δt the specific force f is interpolated. The velocity error is about
      a third of ``|Δf + w × f Δt| Δt``, with the change Δf over the gap and the angular rate w.
      The errors of all gaps of a move are combined as the root of the sum of their squares.
    - White noise with the variance σ² of a sample gives the velocity error ``σ √(τ T)`` in a move
      of T seconds with the sample interval τ.

    `recording` has the m moves;
    `gyroscope_bias`, (3,), is in nominal SI (raw readings by the data sheet), rad/s.
    """
    rotations = recording.rotations
    if not len(rotations):
        return np.zeros(0)
    # only steps that are too long, the mask `uneven`, have dropped samples
    errors = unsampled_velocity(rotations, gyroscope_bias) * rotations.uneven / 3
    variance = recording.poses.variance[rotations.first, :3].sum(axis=1)
    interval = np.median(rotations.steps[rotations.steps > 0])
    noise = np.sqrt(variance * interval * (rotations.end_s - rotations.start_s))
    return np.linalg.norm(errors, axis=1) / noise


def unsampled_velocity(rotations, gyroscope_bias):
    """Return the velocity that each sample interval of m moves may hide, m/s, (m, k - 1).

    It is ``|Δf + w × f Δt| Δt`` for the change Δf of specific force f over the interval Δt. A turn
    of the device also changes f. The term ``w × f Δt`` cancels this change; w is the angular rate
    without its bias. `rotations` are the Rotations, the samples of the moves, with k samples each.
    `gyroscope_bias`, (3,), is in nominal SI (raw readings by the data sheet), rad/s.
    """
    f, w, steps = rotations.f, rotations.w - gyroscope_bias, rotations.steps[..., None]
    change = np.diff(f, axis=1) + np.cross(midpoints(w), midpoints(f)) * steps
    return np.linalg.norm(change, axis=2) * rotations.steps
