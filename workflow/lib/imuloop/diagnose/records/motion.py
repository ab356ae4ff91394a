"""Diagnosis of the moves between poses: the velocity at the end of a move should be zero."""

from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy.linalg import LinAlgError

from imuloop.core.errors import plural
from imuloop.core.precision import precision
from imuloop.core.samples import SENSORS
from imuloop.diagnose.content import untried
from imuloop.diagnose.records.pose_diagnosis import PoseResult, diagnose
from imuloop.diagnose.records.pose_problem import PoseProblem, interleaved_folds
from imuloop.effects.products import products
from imuloop.effects.steps import Steps
from imuloop.estimate.choice import Choices
from imuloop.estimate.least_squares import why_no_fit
from imuloop.estimate.search import kinds_of
from imuloop.estimate.verdict import not_testable
from imuloop.factors.factors import AT_RESTS, VELOCITY
from imuloop.factors.velocity import midpoints
from imuloop.model.effect import Effect
from imuloop.model.effects import EffectKind, SensorEffect
from imuloop.model.state import BIAS, COUNT, State

# least number of usable moves
LEAST_MOVES = 10
# m/s; largest velocity that a usable move may lose between two samples: half a g at 100 Hz
SPOILED = 0.05
# largest velocity that dropped samples of a usable move may hide, over that of the noise
HIDDEN = 0.25
SOFTER = (
    "low-pass the accelerometer below half the rate, turn in one to two seconds and set the device "
    "down softly"
)
WHOLE = "log every sample"
BOTH = "motion shows how late one sensor is after the other: it is given to the accelerometer"


class MotionProblem(PoseProblem):
    """The problem of both sensors at the poses and in the moves.

    Only moves are in folds. Every fit uses all poses, which determine the base model.
    """

    @cached_property
    def rows(self):
        """Index of the move of each row, twice, (n, 2), and kind of each row, (N,).

        The index is -1 for rows of poses. The N - n last rows are those of a prior.
        """
        ends, kind = super().rows
        move = np.searchsorted(self.recording.rotations.first, ends[:, :1])
        at_rest = np.isin(kind[: len(ends), None], AT_RESTS)
        return np.where(at_rest, -1, move).repeat(2, axis=1), kind

    @cached_property
    def error_scale(self):
        """Standard deviation of each row, (N,), by which held-out errors are divided.

        It is that of the likeliest noise without effects: the noise of a move grows with its
        length, and so does the error of a missing effect.
        """
        likeliest = self.linearization().evidence.row_groups[0].noise.precision[-1]
        return np.sqrt(np.diag(precision(likeliest)[0]))


def candidates_in_motion(given):
    """Return the shapes to try in motion, by kind of effect, without the kinds in `given`."""
    shapes = {}
    for cls in Effect.library.values():
        kind = EffectKind(cls, cls.sensors[0])
        if "motion" in cls.records and kind not in given:
            shapes[kind] = tuple(SensorEffect(shape, kind.sensor) for shape in cls.shapes(None))
    return shapes


def motion_products(sensor):
    """Return the Products that only motion shows: those of specific force and angular rate."""
    shapes = products(sensor, "fw") if sensor == "accelerometer" else ()
    return tuple(product for product in shapes if "motion" in product.records)


def diagnose_motion(pair, solution, recording, settings, tests, information=None):
    """Return the PoseResult of a device in motion; it has calibrations if an effect was added.

    Parameters
    ----------
    pair : JointFit
        The fit at the poses.
    solution : Fit or None
        Its result, with effects; None if the poses determine nothing.
    recording : Recording
        Poses and moves.
    settings : DiagnoseSettings
    tests : int
        Number of tests of the other records, which share the significance.
    information : callable, optional
        As `PoseProblem.information`.
    """
    if solution is None or set(pair.estimated) != set(SENSORS):
        return no_result("the poses do not determine both sensors")
    if recording.slow_force:
        why = "the accelerometer is slower than the gyroscope, and misses what a move does between"
        return no_result(f"{why} two of its samples: log both at one rate")
    given, start = solution.effects, solution.x[:COUNT]
    knock = knocks(recording, start[BIAS])
    # a rest with a tilt has a velocity that is not zero
    first, tilt = recording.rotations.first, recording.poses.tilt
    tilts = (tilt[first] > 0) | (tilt[first + 1] > 0)
    lossy, columns = hidden_velocity(recording, start[BIAS]) > HIDDEN, {"knock_m_s": knock}
    quiet = (knock <= SPOILED) & ~lossy & ~tilts & ~_jumps(recording, given)
    pair = replace(pair, factors=replace(pair.factors, quiet=quiet), start=start)
    if quiet.sum() < LEAST_MOVES:
        why = f"{quiet.sum()} of {plural(len(quiet), 'move')} without a knock"
        why += " and between rests without a tilt" * bool(tilts.any())
        if np.isnan(knock).any():
            why += " and within the accelerometer's range"
        why += " and without samples that are lost" * bool(lossy.any())
        why += f", at least {LEAST_MOVES} needed{recording.lost.reason}"
        how = WHOLE if lossy.sum() > np.sum(~(knock <= SPOILED)) else SOFTER
        return replace(no_result(f"{why}: {how}", columns), pair=pair, solution=solution)
    state = State(solution.x, given)
    factors = pair.factors.without_rotation(recording, state, pair.noise)
    pair = replace(pair, factors=factors)
    shapes = candidates_in_motion(kinds_of(given))
    problem = MotionProblem(
        pair,
        recording,
        shapes,
        settings,
        tests + settings.family * len(shapes),
        # the last entry, at index -1, is the fold of the poses: none
        np.append(interleaved_folds(len(quiet), settings.folds), -1),
        given,
        information,
        pair.known,
    )
    # the same residuals judge both sensors
    kinds = {tuple(SENSORS): VELOCITY}
    try:
        result = diagnose(Choices(problem), kinds, {}, motion_products)
    except LinAlgError as error:
        return no_result(why_no_fit(error), columns)
    result.contents["gyroscope"]["candidates"].append(untried("time_offset", "confounded", BOTH))
    for content in result.contents.values():
        content["moves"] = {"all": len(quiet), "left_out": int((~quiet).sum())}
    for name, values in result.residuals.items():
        columns[name] = np.full(len(quiet), np.nan)
        columns[name][quiet] = values
    added = len(result.solution.effects) > len(given)
    calibrations = result.calibrations if added else {}
    return replace(result, calibrations=calibrations, residuals=columns)


def _jumps(recording, effects):
    """Return the moves in which a bias has a step, (m,) of bool: its time there is not known."""
    mid, first = recording.poses.mid_s, recording.rotations.first
    times = [effect.effect.times[0] for effect in effects if effect.name == Steps.name]
    inside = [(mid[first] <= time) & (time <= mid[first + 1]) for time in times]
    return np.any([np.zeros(len(first), dtype=bool), *inside], axis=0)


def no_result(why, columns=None):
    """Return the PoseResult of moves that cannot be tested; `why` is the reason.

    `columns` are columns of moves.parquet that were computed nevertheless.
    """
    contents = {sensor: not_testable(why) for sensor in SENSORS}
    return PoseResult(contents, residuals=columns or {})


def knocks(recording, gyroscope_bias):
    """Return the velocity that each move may lose between two samples, m/s, (m,).

    A knock shorter than a sample interval may not be sampled. So the result is the largest
    `unsampled_velocity` of a move, and nan if the specific force is saturated. `gyroscope_bias`,
    (3,), is in nominal SI, rad/s.
    """
    lost = unsampled_velocity(recording.rotations, gyroscope_bias).max(axis=1)
    return np.where(recording.rotations.force_clipped, np.nan, lost)


def hidden_velocity(recording, gyroscope_bias):
    """Return the velocity that dropped samples of each move hide, over that of the noise, (m,).

    Specific force is interpolated over a gap, with an error of about a third of
    `unsampled_velocity`. White noise with the variance σ² of a sample gives a velocity error of
    ``σ √(Δt T)`` in a move of T seconds with the sample interval Δt. `gyroscope_bias`, (3,), is in
    nominal SI, rad/s.
    """
    rotations = recording.rotations
    lost = unsampled_velocity(rotations, gyroscope_bias) * rotations.uneven / 3
    variance = recording.poses.variance[rotations.first, :3].sum(axis=1)
    if not len(rotations):
        return np.zeros(0)
    usual = np.median(rotations.steps[rotations.steps > 0])
    noise = np.sqrt(variance * usual * (rotations.end_s - rotations.start_s))
    return np.linalg.norm(lost, axis=1) / noise


def unsampled_velocity(rotations, gyroscope_bias):
    """Return the velocity that each sample interval may hide, m/s, (m, k - 1).

    It is ``|Δf + w × f Δt| Δt`` for the change Δf of specific force over the interval Δt, without
    the change that the turn at the angular rate w makes. `gyroscope_bias`, (3,), is in nominal SI,
    rad/s.
    """
    f, w, steps = rotations.f, rotations.w - gyroscope_bias, rotations.steps[..., None]
    change = np.diff(f, axis=1) + np.cross(midpoints(w), midpoints(f)) * steps
    return np.linalg.norm(change, axis=2) * rotations.steps
