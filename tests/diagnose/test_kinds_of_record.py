"""A linear problem has the p-value of the book in every kind of record."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.stats import f as f_distribution

from diagnose import rows
from diagnose.records import LENGTH, windows
from imuloop.diagnose.pose_problem import PoseProblem
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.diagnose.static_means import StaticRecord
from imuloop.diagnose.static_problem import StaticProblem, ratios
from imuloop.estimate import least_squares
from imuloop.estimate.evidence import Hypotheses
from imuloop.estimate.noise_components import Component
from imuloop.estimate.search import Search
from imuloop.model.effect import Channels

SETTINGS, TESTS = DiagnoseSettings(), 20
# rows of each group, whose noise is independent of the other's
ROWS = (30, 45)
LEVEL = np.repeat([0, 1], ROWS)


class Column(rows.Column):
    """A candidate: one column of the problem, on the first axis."""

    def in_session(self, channels, session, windows):
        return channels.other[:, [self.number], None] * np.eye(3)[0][:, None]


class Beside(Column):
    pass


BESIDE, CANDIDATE, LIKE_IT = Beside(0), Column(1), Column(2)
OF_CLASS = {Beside: (BESIDE,), Column: (CANDIDATE, LIKE_IT)}


@dataclass(frozen=True)
class Linear:
    """``y = A β + D θ + v``, group by group: A the level of each, D (n, 3), v of known covariance.

    `part` is the part that each row is held out with.
    """

    y: np.ndarray
    columns: np.ndarray
    covariances: list
    part: np.ndarray

    def design(self, effects):
        return np.column_stack([np.eye(2)[LEVEL], self.columns[:, [e.number for e in effects]]])

    def squares(self, base, candidate, held_out=()):
        """Return χ² without and with a candidate, and the degrees of freedom with it."""
        seen = ~np.isin(self.part, list(held_out))
        root = np.linalg.cholesky(block_diag(*self.covariances)[np.ix_(seen, seen)])
        x = np.column_stack([self.y, self.design((*base, candidate))])
        white = np.linalg.solve(root, x[seen])
        y, fit = white[:, 0], white[:, 1:]
        left = [
            np.sum((y - x @ np.linalg.lstsq(x, y, rcond=None)[0]) ** 2) for x in (fit[:, :-1], fit)
        ]
        return *left, len(fit) - fit.shape[1]

    def p_value(self, base, candidate, held_out, least):
        before, after, dof = self.squares(base, candidate, held_out)
        return f_distribution.sf((before - after) / max(least, after / dof), 1, dof)


def linear_problem(size):
    """Return a problem whose residual has about `size` squared times the variance of its noise.

    The columns and the noise beyond its variance change slowly, as its covariance does:
    white noise added to it makes nothing likelier, so that the covariance is the only hypothesis.
    """
    rng = np.random.default_rng(11)
    y, covariances, columns, parts = [], [], [], []
    for n, shift in zip(ROWS, (0, SETTINGS.blocks // 2), strict=True):
        t = np.arange(n)
        covariance = np.eye(n) + 40 * np.exp(-np.abs(t[:, None] - t) / 15)
        values, axes = np.linalg.eigh(covariance)
        slow = np.where(values > np.quantile(values, 2 / 3), np.sqrt(3.0), 0.2)
        own = axes @ (np.sqrt(values)[:, None] * slow[:, None] * rng.normal(size=(n, 4)))
        columns.append(own[:, 1:])
        y.append(size * own[:, 0] + own[:, 1:] @ [0.3, 0.4, 0.3] * size + 5 * rng.normal())
        covariances.append(covariance)
        parts.append((((t + 0.5) / n * SETTINGS.blocks).astype(int) + shift) % SETTINGS.blocks)
    return Linear(np.concatenate(y), np.concatenate(columns), covariances, np.concatenate(parts))


class LinearSensor:
    """A sensor whose residuals at the poses, ``A β + D θ - y``, are straight in the parameters."""

    names, kinds = ("level 1", "level 2"), {"gravity_norm": ("m/s^2", 1)}
    known = np.zeros((0, 2)), np.zeros(0)

    def rows(self, problem):
        poses = np.arange(len(problem.y))
        return np.column_stack([poses, poses]), np.full(len(poses), "gravity_norm")

    def fit(self, problem, effects=(), start=None, prior=None):
        x, covariance = np.zeros(problem.design(effects).shape[1]), block_diag(*problem.covariances)
        found = least_squares.fit(lambda x: self.at(problem, effects, x), x, covariance)
        return replace(found, effects=tuple(effects))

    def at(self, problem, effects, x):
        """Return the problem with some effects, straight in the parameters."""
        count, design = len(self.names), problem.design(effects)
        return SimpleNamespace(
            residual=design @ x - problem.y,
            jacobian=design,
            columns=lambda more: problem.design(more)[:, count:],
            problem=problem,
        )

    def linearise(self, found, problem):
        return self.at(problem, found.effects, found.x)

    def noise_components(self, at, prior_rows):
        """Return the noise, whose size is known, without flicker and walk, and an even excess."""
        covariance = block_diag(*at.problem.covariances)
        even = np.median(np.diag(covariance)) * np.eye(len(covariance))
        return covariance, [], [Component(even)]


def poses(problem):
    """Return the problem as poses: one group of rows, its nuisances the sensor's parameters."""
    return PoseProblem(LinearSensor(), problem, OF_CLASS, SETTINGS, TESTS, problem.part)


def static_problem(problem):
    """Return the problem as static records: groups of rows with levels; candidates on an axis."""
    values, columns = (np.split(each, [ROWS[0]]) for each in (problem.y, problem.columns))
    records = []
    for number, (y, d) in enumerate(zip(values, columns, strict=True)):
        n = len(y)
        channels = Channels(windows(n).mean(axis=1), np.zeros((n, 3)), d)
        still = windows(n), np.zeros(n, dtype=int)
        records.append(StaticRecord(f"s{number}", *still, np.tile(y[:, None], 3), channels))
    # every hypothesis of the grid is the same
    count = len(ratios(LENGTH * max(ROWS), LENGTH)[0])
    noise = tuple(Hypotheses.of([c] * count) for c in problem.covariances)
    return StaticProblem(tuple(records), OF_CLASS, SETTINGS, TESTS, noise)


# each kind of record, and the least share of the noise's variance that a residual can have: 1 where
# the size of the noise is known, 0 where the residual alone shows it
KINDS = {"poses": (poses, 1.0), "static": (static_problem, 0.0)}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("size", [1.6, 0.5], ids=["above the noise", "below it"])
@pytest.mark.parametrize("base", [(), (BESIDE,)], ids=["alone", "beside"])
@pytest.mark.parametrize("held_out", [(), (2,)], ids=["all", "held out"])
def test_the_p_value_is_that_of_generalised_least_squares(kind, size, base, held_out):
    """With the covariance Σ of the rows seen, and χ² = min (y - X β)ᵀ Σ⁻¹ (y - X β) without and
    with the q columns of a candidate, ν degrees of freedom in the second,

        F = (χ²_without - χ²_with) / (q s),   s = max(least, χ²_with / ν),

    and p is the upper tail of F with q and ν degrees of freedom. The excess s is estimated; it is
    never less than 1 where the size of the noise is known, so smaller residuals prove nothing.
    For an effect in several variants, p is the least times their number.
    """
    make, least = KINDS[kind]
    problem = linear_problem(size)
    search = Search(make(problem), frozenset(held_out))
    expected = [problem.p_value(base, e, held_out, least) for e in (CANDIDATE, LIKE_IT)]
    found = [search.test(base, e).p_value for e in (CANDIDATE, LIKE_IT)]
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    assert search.trial(base, Column).p_value == pytest.approx(2 * min(expected), rel=1e-9)


def test_poses_average_over_how_much_they_are_above_their_noise():
    """Under white noise of variance 1, with χ² above ν, a variance c = 1 is as possible as the
    likeliest one, c = χ²/ν of the fit without the candidate. The p-values of the F test with χ²/c
    are averaged, in part by the restricted likelihood of the fit without the candidate and in part
    by that with it:

        -(ν log c + ν log s + χ²/(c s))/2,   s = max(1, χ²/(c ν)).

    The parts are as the probabilities of the two by Schwarz' criterion under each c, averaged, that
    without the candidate half at most.
    """
    problem = linear_problem(1.0)
    y = 2.5 * np.random.default_rng(4).normal(size=sum(ROWS)) + 0.11 * problem.columns[:, 1]
    problem = replace(problem, y=y, covariances=[np.eye(n) for n in ROWS])
    before, after, dof = problem.squares((), CANDIDATE)
    c = np.array([1.0, before / (dof + 1)])
    shares, lost = [], []
    for square, freedom in ((before, dof + 1), (after, dof)):
        s = np.maximum(1.0, square / c / freedom)
        log = -(freedom * np.log(c * s) + square / (c * s)) / 2
        shares.append(np.exp(log - log.max()) / np.exp(log - log.max()).sum())
        lost.append((freedom * np.log(s) + square / (c * s)) / 2)
    gain = np.log(shares[0] @ np.exp(lost[0] - lost[1])) - np.log(dof + 1) / 2
    half = 1 / (1 + np.exp(max(gain, 0.0)))
    assert 0.01 < half < 0.49
    expected = np.average(shares, axis=0, weights=[half, 1 - half]) @ f_distribution.sf(
        (before - after) / c / s, 1, dof
    )
    found = Search(poses(problem), frozenset()).test((), CANDIDATE).p_value
    assert 1e-9 < expected < 1e-2
    # the likeliest c is found to the square root of the digits of the likelihood
    assert found == pytest.approx(expected, rel=1e-6)
