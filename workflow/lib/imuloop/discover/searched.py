"""What a search of composed effects sees of a record: its residuals, their noise and the space."""

from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np

from imuloop.core.effect import Channels
from imuloop.diagnose.records.motion import VELOCITY
from imuloop.diagnose.records.slow_noise import unit_noise
from imuloop.diagnose.records.static import StaticProblem
from imuloop.diagnose.search import Search
from imuloop.diagnose.variance import Part
from imuloop.discover.pursuit import Rows
from imuloop.discover.space import Space, space_of

# rows for each parameter of a form
ROWS = 4
# means of a record at rest that are searched, all sessions together, and the least of one
MEANS, LEAST = 100, 20
# of the white noise, for a covariance whose parts may all be none
FAINT = 1e-3


@dataclass(frozen=True)
class Searched:
    """Residuals of a sensor in one kind of record.

    Attributes
    ----------
    rows : Rows
        Residuals and what their noise may be.
    space : Space
        What they may hold.
    fold : ndarray of int, shape (N, 2)
        The part that a row is held out with, and the other that it touches; -1 for none.
    kinds : dict of str to (ndarray of bool, int)
        Which rows are of a kind of residual, and how many of them make one.
    scalars : ndarray, shape (pieces, m)
        What the size of a formula may depend on: the order in time, its half, temperature, the
        components of a direction fixed in the world, products of two and of four of these.
    noise_known : bool
        Whether anything is known beforehand of how large the noise is.
    problem : PoseProblem or StaticProblem
        What they are of; poses and moves that are held out together follow each other.
    test : callable, optional
        Takes the parts that are not seen, gives the test of candidates that `pursue` takes; those
        of drawn residuals if there is none.
    merged : bool
        Whether its rows are means over longer windows than those that the library is tested by.
    """

    rows: Rows
    space: Space
    fold: np.ndarray
    kinds: dict
    scalars: np.ndarray
    noise_known: bool
    problem: object
    test: object = None
    merged: bool = False

    @property
    def settings(self):
        """Draws and seed."""
        return self.problem.settings


def rows_of(problem, base=()):
    """Return the Rows of a PoseProblem, or one of its kind, about its fit with some effects."""
    about = problem.linearized(base)
    first = np.full(len(about.values), -1)
    first[: len(problem.rows[0])] = problem.rows[0][:, 0]
    # rows that every fit sees are one piece, the last
    piece = np.where(first < 0, first.max() + 1, first)
    widest = max((len(about.values) - about.jacobian.shape[1]) // ROWS, 1)
    fixed, parts = about.noise
    return Rows(-about.values, about.jacobian, fixed, tuple(parts), piece, widest)


def of_poses(problem, base=(), sensor=None):
    """Return the Searched of a PoseProblem, which is of one sensor."""
    recording, sensor = problem.recording, problem.sensor.sensor
    poses = recording.poses
    channels = recording.pose_channels(sensor, lambda y: y, poses.f)
    vectors = "f" if sensor == "accelerometer" else "fw"
    space = space_of(sensor, channels, lambda e: problem.added(e)[:, 0], vectors)
    scalars = _scalars(poses.f, poses.temperature)
    return _of_rows(in_a_row(problem), base, space, scalars, problem.sensor.kinds)


def of_motion(problem, base, sensor):
    """Return the Searched of one sensor in the moves of a MotionProblem."""
    recording = problem.recording
    poses, first = recording.poses, recording.rotations.first
    channels = recording.pose_channels(sensor, lambda y: y, poses.f)
    space = space_of(sensor, channels, lambda e: problem.added(e)[:, 0], "fw")
    warmth = None if poses.temperature is None else poses.temperature[first]
    scalars = _scalars(poses.f[first], warmth)
    return _of_rows(in_a_row(problem), base, space, scalars, VELOCITY)


def of_reference(problem, base, _):
    """Return the Searched of a ReferenceProblem, which is of one sensor."""
    recording, sensor = problem.recording, problem.sensor
    session, first, *_ = sensor.windows(recording)
    log = recording.logs[0]
    pair = (log.f, log.w) if sensor.sensor == "accelerometer" else (log.w, log.f)
    channels = Channels(log.t, *pair, log.temperature)
    space = space_of(sensor.sensor, channels, lambda e: problem.added(e)[:, 0], "fw")
    each = list(zip(session, first, strict=True))
    # an axis of the reference's world, on those of the body
    up = np.nan_to_num([recording.logs[s].attitude[i][2] for s, i in each])
    warmth = None
    if all(log.temperature is not None for log in recording.logs):
        warmth = np.array([recording.logs[s].temperature[i] for s, i in each])
    # how large the noise is the residuals themselves tell
    return _of_rows(problem, base, space, _scalars(up, warmth), sensor.kinds, noise_known=False)


def _of_rows(problem, base, space, scalars, kinds, noise_known=True):
    """Return the Searched of the rows of a PoseProblem, or one of its kind."""
    rows = rows_of(problem, base)
    own = {kind: (problem.of_kind(kind), problem.components(kind)) for kind in kinds}
    return Searched(rows, space, problem.ends, own, scalars, noise_known, problem)


def in_a_row(problem):
    """Return a PoseProblem whose parts follow each other: what changes in time is no formula."""
    fold = np.array(problem.fold_of_pose)
    held = fold >= 0
    fold[held] = consecutive(held.sum(), problem.settings.folds)
    return problem.parted(fold)


def of_static(problem, base, sensor):
    """Return the Searched of a StaticProblem: means over so many windows at rest, axis by axis.

    White noise, flicker and walk of each axis are of any size. Fitted to residuals that hold a
    pattern they would take it up, so candidates are tested as effects of the library are: under
    each noise that is as likely as its residuals have it, times the number of candidates.
    """
    most = max(MEANS // len(problem.records), LEAST)
    records = tuple(r.merged(most) for r in problem.records)
    own = StaticProblem(records, {}, problem.settings, problem.tests)
    count = sum(len(r.windows) for r in records)
    channels = [r.channels for r in records]
    warm = [c.temperature for c in channels]
    warmth = None if any(w is None for w in warm) else np.concatenate(warm)
    logged = ([getattr(c, n) for c in channels] for n in ("t", "output", "other"))
    joined = Channels(*map(np.concatenate, logged), warmth)
    number = np.repeat(np.arange(len(records)), [len(r.windows) for r in records])
    levels = np.kron(np.eye(3), np.eye(len(records))[number])

    def added(effect):
        return own.design(effect).swapaxes(0, 1).reshape(3 * count, -1)

    columns = [added(effect) for effect in base]
    jacobian = np.column_stack([levels, *(c[:, c.any(axis=0)] for c in columns)])
    values = np.concatenate([r.values - r.values.mean(axis=0) for r in records])
    fixed, parts = _noise_at_rest(records, values)
    rows = Rows(
        values.T.ravel(),
        jacobian,
        fixed,
        tuple(parts),
        np.tile(np.arange(count), 3),
        max((3 * count - jacobian.shape[1]) // ROWS, 1),
    )
    space = space_of(sensor, joined, added, "f" if len(records) > 1 else "")
    fold = np.tile(np.concatenate(own.folds), 3)
    fold = np.column_stack([fold, np.full(len(fold), -1)])
    kinds = {problem.residual: (np.ones(len(fold), dtype=bool), 3)}
    scalars = _scalars(np.zeros((count, 0)), warmth)

    def test(out):
        search = Search(own, out)

        def best(chosen):
            trials = search.tests((*base, *chosen), [k for k in numbers if k not in chosen])
            log_p, number = min(((t.log_p, t.effect) for t in trials if t), default=(0.0, 0))
            return float(min(1.0, np.exp(log_p) * len(numbers))), number

        return best

    numbers = range(len(space.candidates))
    for k in numbers:
        at = list(space.candidates[k])
        design = space.columns[:, at].reshape(3, count, len(at)).swapaxes(0, 1)
        own.evidence.know(k, design)
    return Searched(rows, space, fold, kinds, scalars, False, problem, test, merged=True)


def _noise_at_rest(records, values):
    """Return covariance and Parts of means at rest, (3 N, 3 N), in sizes of their white noise."""
    ends = np.cumsum([len(r.windows) for r in records])[:-1]
    steps = [np.diff(v, axis=0) for v in np.split(values, ends)]
    white = np.concatenate(steps).var(axis=0) / 2
    length = np.concatenate([r.length for r in records])
    fixed, parts = np.zeros((3 * len(values),) * 2), []
    for axis, variance in enumerate(white):
        at = slice(axis * len(values), (axis + 1) * len(values))
        fixed[at, at] = np.diag(FAINT * variance * length.mean() / length)
        for name in "NBK":
            whole, place = np.zeros_like(fixed), at.start
            for record in records:
                n = len(record.windows)
                own = slice(place, place + n)
                whole[own, own] = unit_noise(name).mean_covariance(record.windows)
                place += n
            # beside a level
            centred = np.trace(whole[at, at]) - whole[at, at].sum() / len(values)
            parts.append(Part(whole * variance * len(values) / centred))
    return fixed, parts


def consecutive(count, folds):
    """Return the part of each pose; parts follow each other in time."""
    return np.arange(count) * min(folds, count) // count


def _scalars(directions, temperature):
    """Return the scalars of `Searched`, (n, m), of directions, (n, 3), not all of one length."""
    order = np.linspace(-1, 1, len(directions))
    size = np.linalg.norm(directions, axis=1, keepdims=True)
    u = directions / np.where(size > 0, size, 1.0)
    axes = range(u.shape[1])
    each = (c for degree in (2, 4) for c in combinations_with_replacement(axes, degree))
    products = [u[:, list(c)].prod(axis=1) for c in each]
    warmth = [] if temperature is None else [temperature - temperature.mean()]
    return np.column_stack([order, np.sign(order), u, *products, *warmth])
