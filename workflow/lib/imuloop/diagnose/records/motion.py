"""The motion between poses: the velocity that a model of both sensors leaves at its end."""

from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy.linalg import LinAlgError

from imuloop.core.effect import Effect
from imuloop.core.errors import plural
from imuloop.core.precision import precision
from imuloop.core.samples import SENSORS
from imuloop.diagnose.content import untried
from imuloop.diagnose.records.pose_diagnosis import PoseResult, diagnosed
from imuloop.diagnose.records.pose_problem import PoseProblem, interleaved
from imuloop.effects.products import products
from imuloop.effects.steps import Steps
from imuloop.estimate.choice import Choices
from imuloop.estimate.least_squares import why_no_fit
from imuloop.estimate.search import kinds_of
from imuloop.estimate.verdict import not_testable
from imuloop.factors.factors import AT_RESTS, VELOCITY
from imuloop.factors.velocity import midpoints
from imuloop.model.effects import EffectKind, SensorEffect
from imuloop.model.state import BIAS, COUNT, State

# moves of which the velocity counts, at least
LEAST_MOVES = 10
# m/s; what may be lost between two samples of a move that counts: half a g at 100 Hz
SPOILED = 0.05
# velocity that lost samples hide, of what the noise of a move gives, in one that counts
HIDDEN = 0.25
SOFTER = (
    "low-pass the accelerometer below half the rate, turn in one to two seconds and set the device "
    "down softly"
)
WHOLE = "log every sample"
BOTH = "motion shows how late one sensor is after the other: it is given to the accelerometer"


class MotionProblem(PoseProblem):
    """Both sensors at the poses, which every fit sees, and the moves, of which parts are held out.

    The poses alone determine the base model: no fit is lost. The noise of a move grows with its
    length, and so does what a lacking effect leaves.
    """

    @cached_property
    def rows(self):
        """The move that each row is of, twice, -1 for none: of poses too; and its kind, (N,)."""
        ends, kind = super().rows
        move = np.searchsorted(self.recording.rotations.first, ends[:, :1])
        at_rest = np.isin(kind[: len(ends), None], AT_RESTS)
        return np.where(at_rest, -1, move).repeat(2, axis=1), kind

    @cached_property
    def error_scale(self):
        """What a held-out error is compared in: the noise as residuals without effects have it."""
        likeliest = self.linearized().evidence.row_groups[0].noise.precision[-1]
        return np.sqrt(np.diag(precision(likeliest)[0]))


def candidates_in_motion(known):
    """Return the shapes of each effect to try, but of known kinds."""
    found = {}
    for cls in Effect.library.values():
        kind = EffectKind(cls, cls.sensors[0])
        if "motion" in cls.records and kind not in known:
            found[kind] = tuple(SensorEffect(shape, kind.sensor) for shape in cls.shapes(None))
    return found


def motion_products(sensor):
    """Return the products that motion alone shows: an accelerometer's with the angular rate."""
    found = products(sensor, "fw") if sensor == "accelerometer" else ()
    return tuple(product for product in found if "motion" in product.records)


def diagnose_motion(pair, solution, recording, settings, tests, information=None):
    """Return the PoseResult of a device in motion; calibrations where motion shows an effect.

    Takes the JointFit and its Fit at the poses, effects included, None where these determine
    none; the number of tests of the other records, which share the significance; `information` of
    PoseProblem.
    """
    if solution is None or set(pair.estimated) != set(SENSORS):
        return untestable("the poses do not determine both sensors")
    if recording.slow_force:
        why = "the accelerometer is slower than the gyroscope, and misses what a move does between"
        return untestable(f"{why} two of its samples: log both at one rate")
    found, start = solution.effects, solution.x[:COUNT]
    knock = knocks(recording, start[BIAS])
    # where it tilts at either end the velocity there is not zero
    first, tilt = recording.rotations.first, recording.poses.tilt
    tilts = (tilt[first] > 0) | (tilt[first + 1] > 0)
    lossy, columns = hidden(recording, start[BIAS]) > HIDDEN, {"knock_m_s": knock}
    quiet = (knock <= SPOILED) & ~lossy & ~tilts & ~_jumps(recording, found)
    pair = replace(pair, factors=replace(pair.factors, quiet=quiet), start=start)
    if quiet.sum() < LEAST_MOVES:
        why = f"{quiet.sum()} of {plural(len(quiet), 'move')} without a knock"
        why += " and between rests without a tilt" * bool(tilts.any())
        if np.isnan(knock).any():
            why += " and within the accelerometer's range"
        why += " and without samples that are lost" * bool(lossy.any())
        why += f", at least {LEAST_MOVES} needed{recording.lost.reason}"
        how = WHOLE if lossy.sum() > np.sum(~(knock <= SPOILED)) else SOFTER
        return replace(untestable(f"{why}: {how}", columns), pair=pair, solution=solution)
    state = State(solution.x, found)
    factors = pair.factors.without_rotation(recording, state, pair.noise)
    pair = replace(pair, factors=factors)
    shapes = candidates_in_motion(kinds_of(found))
    problem = MotionProblem(
        pair,
        recording,
        shapes,
        settings,
        tests + settings.family * len(shapes),
        # poses are seen by every fit
        np.append(interleaved(len(quiet), settings.folds), -1),
        found,
        information,
        pair.known,
    )
    # the same moves judge both
    parts = {tuple(SENSORS): VELOCITY}
    try:
        result = diagnosed(Choices(problem), parts, {}, motion_products)
    except LinAlgError as error:
        return untestable(why_no_fit(error), columns)
    result.contents["gyroscope"]["candidates"].append(untried("time_offset", "confounded", BOTH))
    for content in result.contents.values():
        content["moves"] = {"all": len(quiet), "left_out": int((~quiet).sum())}
    for name, values in result.residuals.items():
        columns[name] = np.full(len(quiet), np.nan)
        columns[name][quiet] = values
    added = len(result.solution.effects) > len(found)
    calibrations = result.calibrations if added else {}
    return replace(result, calibrations=calibrations, residuals=columns)


def _jumps(recording, effects):
    """Return in which moves a bias jumps, (m,): the poses do not tell when."""
    mid, first = recording.poses.mid_s, recording.rotations.first
    times = [effect.effect.times[0] for effect in effects if effect.name == Steps.name]
    found = [(mid[first] <= time) & (time <= mid[first + 1]) for time in times]
    return np.any([np.zeros(len(first), dtype=bool), *found], axis=0)


def untestable(why, columns=None):
    """Return the PoseResult where nothing could be tested, with the reason."""
    contents = {sensor: not_testable(why) for sensor in SENSORS}
    return PoseResult(contents, residuals=columns or {})


def knocks(recording, gyroscope_bias):
    """Return the velocity that may be lost between two samples of each move, m/s, shape (m,).

    A knock shorter than a step is sampled by chance, or not at all: the largest of `between`. Takes
    the gyroscope's bias, rad/s as logged, (3,). Not-a-number where the specific force reached the
    end of its range: what is beyond is not known.
    """
    lost = between(recording.rotations, gyroscope_bias).max(axis=1)
    return np.where(recording.rotations.force_clipped, np.nan, lost)


def hidden(recording, gyroscope_bias):
    """Return the velocity that lost samples hide of each move, of what its noise gives, (m,).

    Over a gap specific force is a straight line, which is off by about a third of `between`. White
    noise of variance σ² a sample, Δt apart, gives ``σ √(Δt T)`` in a move of T seconds.
    """
    rotations = recording.rotations
    lost = between(rotations, gyroscope_bias) * rotations.uneven / 3
    variance = recording.poses.variance[rotations.first, :3].sum(axis=1)
    if not len(rotations):
        return np.zeros(0)
    usual = np.median(rotations.steps[rotations.steps > 0])
    noise = np.sqrt(variance * usual * (rotations.end_s - rotations.start_s))
    return np.linalg.norm(lost, axis=1) / noise


def between(rotations, gyroscope_bias):
    """Return the change of specific force over a step Δt that the turn does not make, times Δt.

    ``|Δf + w × f Δt| Δt``, m/s, (m, k - 1). Takes the gyroscope's bias, rad/s as logged, (3,).
    """
    f, w, steps = rotations.f, rotations.w - gyroscope_bias, rotations.steps[..., None]
    change = np.diff(f, axis=1) + np.cross(midpoints(w), midpoints(f)) * steps
    return np.linalg.norm(change, axis=2) * rotations.steps
