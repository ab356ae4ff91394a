"""What a search sees of a record; the one file that knows the problems of the diagnosis."""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np
from scipy.linalg import block_diag
from scipy.special import chdtrc

from imuloop.calibrate.noise_components import Component
from imuloop.calibrate.sensor_pair import OF_SENSOR, VELOCITY, OfSensor
from imuloop.core.effect import Channels
from imuloop.diagnose.records.motion import MotionProblem
from imuloop.diagnose.records.pose_problem import by_effect
from imuloop.diagnose.records.slow_noise import unit_noise
from imuloop.diagnose.records.static import StaticProblem
from imuloop.diagnose.search import Search
from imuloop.discover.selection import Rows
from imuloop.discover.space import Space, space_of

# means of a record at rest that are searched, all sessions together, and the least of one
MEANS, LEAST = 100, 20
# of the white noise, for a covariance whose parts may all be none
FAINT = 1e-3


@dataclass(frozen=True)
class SearchInput:
    """Residuals of a sensor in one kind of record."""

    problem: object  # of the record; poses and moves held out together follow each other
    rows: Rows  # residuals and what their noise may be
    space: Space  # what they may hold
    row_parts: np.ndarray  # (N, 2): as of `RowGroup`
    kinds: dict  # of each kind of residual, which rows are of it, and how many of them make one
    scalars: np.ndarray  # (poses, m): what the size of a formula may depend on
    # whether the problem is of both sensors: then their noise is known beforehand
    of_pair: bool = False
    # of means over longer windows than the library's: takes parts that are held out, and what the
    # test of `select` does
    test: object = None

    def of_gravity_alone(self):
        """Return the same of the accelerometer's own rows, without the rotations."""
        at = np.flatnonzero(np.any([own for own, _ in self.kinds.values()], axis=0))
        rows = self.rows.subset(at)
        jacobian = rows.jacobian[:, rows.jacobian.any(axis=0)]
        parts = tuple(part for part in rows.parts if part.covariance.any())
        rows = replace(rows, jacobian=jacobian, parts=parts)
        space = replace(self.space, columns=self.space.columns[at])
        kinds = {kind: (own[at], count) for kind, (own, count) in self.kinds.items()}
        return replace(self, rows=rows, space=space, row_parts=self.row_parts[at], kinds=kinds)

    def named(self, effect):
        """Return a formula as the problem has it: of which sensor it is, where it has both."""
        return OfSensor(effect, self.space.sensor) if self.of_pair else effect

    @cached_property
    def held_and_seen(self):
        """Of each part the rows that are held out, and those that are seen."""
        numbers, row_parts = range(self.row_parts[:, 0].max() + 1), self.row_parts
        each = ((row_parts[:, 0] == k, ~(row_parts == k).any(axis=1)) for k in numbers)
        return [(np.flatnonzero(held), np.flatnonzero(seen)) for held, seen in each]


def of_poses(problem, base, sensor):
    """Return the SearchInput of one sensor in a PoseProblem, or in a MotionProblem's moves."""
    poses = problem.recording.poses
    begin, kinds, vectors = slice(None), OF_SENSOR[sensor], "fw"
    if isinstance(problem, MotionProblem):
        begin, kinds = problem.recording.rotations.first, VELOCITY
    elif sensor == "accelerometer":
        # at rest nothing turns
        vectors = "f"
    channels = problem.recording.pose_channels(sensor, lambda y: y, poses.f)
    warmth = None if poses.temperature is None else poses.temperature[begin]
    scalars = scalars_of(poses.f[begin], warmth)
    # parts that follow each other: what changes in time is no formula
    part_of_pose, parts = np.array(problem.part_of_pose), problem.settings.folds
    held = np.flatnonzero(part_of_pose >= 0)
    part_of_pose[held] = np.arange(len(held)) * min(parts, len(held)) // len(held)
    problem = problem.with_parts(part_of_pose)

    def added(effect):
        return problem.added(OfSensor(effect, sensor))[:, 0]

    space = space_of(sensor, channels, added, vectors)
    each = {kind: (problem.of_kind(kind), problem.components(kind)) for kind in kinds}
    rows = rows_of(problem, base)
    return SearchInput(problem, rows, space, problem.row_parts, each, scalars, of_pair=True)


def rows_of(problem, base=()):
    """Return the Rows of a PoseProblem, or one of its kind, about its fit with some effects."""
    about, ends = problem.linearized(base), problem.rows[0]
    count, fixed, parts = len(about.values), *about.noise
    # rows that every fit sees are one piece, the last
    pose = np.append(ends[:, 0], np.full(count - len(ends), -1))
    pose = np.where(pose < 0, pose.max() + 1, pose)
    return Rows(-about.values, about.jacobian, fixed, tuple(parts), pose, count)


def still_needed(problem, base, effect):
    """Return the effects of the library that a PoseProblem still shows beside a formula.

    Their parameters θ, of covariance C, have ``θᵀ C⁻¹ θ`` beyond chance, as the search of the
    library asks of them; others stood for what the formula says.
    """
    while base:
        x = problem.linearized(base).solution.fit.x
        change, covariance = rows_of(problem, base).fit(problem.added(effect)[:, 0])
        theta, chances = x + change[: len(x)], {}
        count = sum(len(e.parameters) for e in base)
        for each, at in by_effect(np.arange(len(x) - count, len(x)), base).items():
            square = theta[at] @ np.linalg.solve(covariance[np.ix_(at, at)], theta[at])
            chances[each] = chdtrc(len(at), square)
        worst = max(chances, key=chances.get)
        if chances[worst] < problem.settings.significance / problem.tests:
            break
        base = tuple(e for e in base if e != worst)
    return base


def of_static(problem, base, sensor):
    """Return the SearchInput of a StaticProblem: means over some windows at rest, axis by axis.

    White noise, flicker and walk of any size would take up a pattern: candidates are tested as
    effects of the library are, under all noise that is likely, times the number of candidates.
    """
    records = tuple(r.merged(max(MEANS // len(problem.records), LEAST)) for r in problem.records)
    merged = StaticProblem(records, {}, problem.settings, problem.tests)
    lengths = [len(r.windows) for r in records]
    count = sum(lengths)

    def joined(name):
        own = [getattr(r.channels, name) for r in records]
        return None if any(values is None for values in own) else np.concatenate(own)

    def added(effect):
        return merged.design(effect).swapaxes(0, 1).reshape(3 * count, -1)

    channels = Channels(*map(joined, ("t", "output", "other", "temperature")))
    levels = np.kron(np.eye(3), np.repeat(np.eye(len(records)), lengths, axis=0))
    columns = (design[:, design.any(axis=0)] for design in map(added, base))
    jacobian = np.column_stack([levels, *columns])
    values = np.concatenate([r.values - r.values.mean(axis=0) for r in records])
    pose, noise = np.tile(np.arange(count), 3), _noise_at_rest(records, values)
    rows = Rows(values.T.ravel(), jacobian, *noise, pose, 3 * count)
    space = space_of(sensor, channels, added, "f" if len(records) > 1 else "")
    part_of_row = np.tile(np.concatenate(merged.part_of_windows), 3)
    row_parts = np.column_stack([part_of_row, np.full(len(part_of_row), -1)])
    kinds = {"bias": (np.ones(len(row_parts), dtype=bool), 3)}
    scalars = scalars_of(np.zeros((count, 0)), channels.temperature)
    numbers = range(len(space.candidates))
    for k in numbers:
        own = space.columns[:, list(space.candidates[k])]
        merged.evidence.add_pattern(k, own.reshape(3, count, -1).swapaxes(0, 1))

    def test(held_out, selected):
        others = [k for k in numbers if k not in selected]
        trials = Search(merged, held_out).tests((*base, *selected), others)
        log_p, number = min(((t.log_p, t.effect) for t in trials if t), default=(0.0, 0))
        return float(min(1.0, np.exp(log_p) * len(numbers))), number

    return SearchInput(problem, rows, space, row_parts, kinds, scalars, test=test)


def _noise_at_rest(records, values):
    """Return covariance and Components of means at rest, (3 N, 3 N), by their white noise."""
    ends, count = np.cumsum([len(r.windows) for r in records])[:-1], len(values)
    white = np.concatenate([np.diff(v, axis=0) for v in np.split(values, ends)]).var(axis=0) / 2
    length, parts = np.concatenate([r.length for r in records]), []
    for variance, axis in zip(white, np.eye(3), strict=True):
        for name in "NBK":
            own = block_diag(*(unit_noise(name).mean_covariance(r.windows) for r in records))
            # beside a level
            own = own * variance * count / (np.trace(own) - own.sum() / count)
            parts.append(Component(np.kron(np.diag(axis), own)))
    return np.diag(np.kron(white, FAINT * length.mean() / length)), tuple(parts)


def scalars_of(directions, temperature):
    """Return the scalars of a SearchInput, (n, m), of directions, (n, 3), and temperature, if any.

    The order in time, its half, temperature, a direction fixed in the world, products of two and of
    four of its components.
    """
    order = np.linspace(-1, 1, len(directions))
    size = np.linalg.norm(directions, axis=1, keepdims=True)
    u = directions / np.where(size > 0, size, 1.0)
    axes = range(u.shape[1])
    each = (c for degree in (2, 4) for c in combinations_with_replacement(axes, degree))
    products = [u[:, list(c)].prod(axis=1) for c in each]
    warmth = [] if temperature is None else [temperature - temperature.mean()]
    return np.column_stack([order, np.sign(order), u, *products, *warmth])


INPUTS = dict(poses=of_poses, static_record=of_static, motion=of_poses)
