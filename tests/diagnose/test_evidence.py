"""Fits of evidence against plain generalised least squares; p-values averaged over the noise."""

import numpy as np
import pytest
from scipy.stats import f as f_distribution

from diagnose.records import LENGTH, record, root, search
from imuloop.diagnose.evidence import Block, Evidence, Hypotheses
from imuloop.diagnose.p_values import log_f_tail
from imuloop.diagnose.records.slow_noise import ratios, unit_noise
from imuloop.effects.bias_temperature import BiasTemperature
from imuloop.effects.ramp import Ramp
from imuloop.effects.steps import Steps


def plain(parts, k):
    """Return θ of the last k columns, their covariance, χ², and restricted log-likelihood.

    By the book, for noise of a size that is given.

    Parameters
    ----------
    parts : sequence of (ndarray, ndarray, ndarray, ndarray)
        Of independent blocks the values, nuisances, further columns and covariance.
    k : int
        Number of further columns.
    """
    rows = np.cumsum([0, *(len(values) for values, *_ in parts)])
    sides = np.cumsum([0, *(side.shape[1] for _, side, *_ in parts)])
    x, sigma = np.zeros((rows[-1], sides[-1] + k)), np.zeros((rows[-1], rows[-1]))
    for i, (_, side, columns, covariance) in enumerate(parts):
        own = slice(*rows[i : i + 2])
        x[own, slice(*sides[i : i + 2])], x[own, sides[-1] :] = side, columns
        sigma[own, own] = covariance
    y = np.concatenate([values for values, *_ in parts])
    inverse = np.linalg.inv(sigma)
    information = x.T @ inverse @ x
    theta = np.linalg.solve(information, x.T @ inverse @ y)
    left = y - x @ theta
    log = -(np.linalg.slogdet(sigma)[1] + np.linalg.slogdet(information)[1]) / 2
    return theta[sides[-1] :], np.linalg.inv(information)[-k:, -k:], left @ inverse @ left, log


@pytest.mark.parametrize("held", [(), (3,), (2, 5), "one"])
def test_a_fit_is_that_of_generalised_least_squares(held):
    rng = np.random.default_rng(1)
    records = [
        record(root(n, 5, 5) @ rng.standard_normal((n, 3)), session=name)
        for n, name in ((40, "a"), (64, "b"))
    ]
    effects = [Ramp(), BiasTemperature(2, 20.0)]
    problem = search(records, effects).problem
    out, only = (frozenset(), frozenset({1})) if held == "one" else (frozenset(held), None)
    sight, evidence = problem.sight((), out, only), problem.evidence
    patterns = evidence.patterns(effects)
    found = sight.fit(sum((p.columns[1] for p in patterns), ()), 1)
    scale = np.concatenate([p.scale[1] for p in patterns])
    grid, prior = ratios(64 * LENGTH, LENGTH)
    log = []
    for point in (0, 7, len(grid) - 1):
        parts = []
        for rec, fold in zip(records, problem.folds, strict=True):
            if held == "one" and rec.session == "a":
                continue
            rows = np.flatnonzero(~np.isin(fold, list(out)))
            own = np.concatenate(
                [
                    e.design(rec.channels)[:, 1, [1, 4][: 1 + (i > 0)]]
                    for i, e in enumerate(effects)
                ],
                axis=1,
            )
            covariance = sum(
                f * unit_noise(name).mean_covariance(rec.windows[rows])
                for f, name in zip((1, *grid[point]), "NBK", strict=True)
            )
            parts.append((rec.values[rows, 1], np.ones((len(rows), 1)), own[rows], covariance))
        theta, spread, square, value = plain(parts, 3)
        np.testing.assert_allclose(found.theta[point] / scale, theta, rtol=1e-5)
        assert found.square[point] == pytest.approx(square, rel=1e-6)
        assert found.dof == sum(len(values) for values, *_ in parts) - len(parts) - 3
        expected = spread * square / found.dof
        np.testing.assert_allclose(
            found.covariance[point] / np.outer(scale, scale), expected, rtol=1e-5
        )
        value -= found.dof / 2 * np.log(square)
        log.append(found.log_weight[point] - prior[point] - value)
    # the likelihood up to one constant
    np.testing.assert_allclose(log, log[0], atol=1e-5)


@pytest.mark.parametrize("out", [(), (1,), (0, 2)])
@pytest.mark.parametrize("size", [0.3, 3.0])
def test_a_fit_to_noise_of_known_size_with_many_nuisances(out, size):
    """Whole rows are held out with either end; the noise is no smaller than what is known."""
    rng, n = np.random.default_rng(2), 60
    t = np.arange(n)
    covariances = [np.eye(n), np.eye(n) + 4 * np.exp(-np.abs(t[:, None] - t) / 10)]
    folds = np.column_stack([t * 4 // n, np.minimum(t + 1, n - 1) * 4 // n])
    side, columns = rng.normal(size=(n, 5)), rng.normal(size=(n, 1, 2))
    values = size * rng.normal(size=n) + side @ rng.normal(size=5) + columns[:, 0] @ [1.0, 2.0]
    # nuisances have units of their own
    side *= 10.0 ** np.arange(-6, 4, 2)
    block = Block(values[:, None], side, Hypotheses.of(covariances), folds)
    prior = np.log([0.4, 0.6])
    evidence = Evidence([block], prior, lambda effect: columns, least=1.0)
    (pattern,) = evidence.patterns(["any"])
    sight = evidence.sight(frozenset(out))
    found, seen = sight.fit(pattern.columns[0], 0), ~np.isin(folds, out).any(axis=1)
    log = []
    for point, covariance in enumerate(covariances):
        own = values[seen], side[seen], columns[seen, 0], covariance[np.ix_(seen, seen)]
        theta, spread, square, value = plain([own], 2)
        np.testing.assert_allclose(found.theta[point] / pattern.scale[0], theta, rtol=1e-6)
        assert found.dof == seen.sum() - 7
        assert found.square[point] == pytest.approx(square, rel=1e-6)
        grown = max(1.0, square / found.dof)
        np.testing.assert_allclose(
            found.covariance[point] / np.outer(pattern.scale[0], pattern.scale[0]),
            grown * spread,
            rtol=1e-6,
        )
        value -= (found.dof * np.log(grown) + square / grown) / 2
        log.append(found.log_weight[point] - prior[point] - value)
    assert log[1] == pytest.approx(log[0], abs=1e-6)


def test_columns_that_are_not_independent_give_no_fit():
    shapes = [Steps((600.0,), ("s",)), Steps((-5.0,), ("s",))]
    problem = search([record(np.random.default_rng(2).normal(size=(50, 3)))], shapes).problem
    one, two = problem.evidence.patterns(shapes)
    sight = problem.sight((), frozenset())
    assert sight.fit(one.columns[0], 0)
    # a step before the record is a level, and a column twice is one
    assert sight.fit(two.columns[0], 0) is None
    assert sight.fit(one.columns[0] + one.columns[0], 0) is None


def test_tail_of_f_against_scipy_and_below_the_smallest_double():
    for q, dof, statistic in ((1, 40, 3.0), (3, 700, 5.0), (9, 60, 20.0)):
        expected = f_distribution.logsf(statistic, q, dof)
        assert log_f_tail(statistic, q, dof) == pytest.approx(expected, rel=1e-9)
    # with two degrees of freedom the tail is (1 + 2F/ν)^(-ν/2)
    for dof, statistic in ((100, 1e9), (4000, 50.0), (4000, 3e3)):
        exact = -dof / 2 * np.log1p(2 * statistic / dof)
        assert log_f_tail(statistic, 2, dof) == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("flicker, walk", [(0, 0), (20, 0), (0, 5), (0, 300), (20, 30)])
def test_slow_noise_is_not_taken_for_a_smooth_effect(flicker, walk):
    rng, n = np.random.default_rng(3), 120
    made, effects = root(n, flicker, walk), [Ramp(), BiasTemperature(2, 20.0)]
    found = []
    for _ in range(25):
        one = search([record(made @ rng.standard_normal((n, 3)))], effects)
        found += [one.test((), effect).p_value for effect in effects]
    # 50 tests of three axes each; at 1 % half a one is expected, five would be one in 1e3 runs
    assert np.sum(np.array(found) < 0.01) <= 4
    assert np.sum(np.array(found) < 1e-3) <= 1


def test_known_noise_is_tested_as_by_f():
    """White noise that is certain: the p-values are uniform or, slow noise not excluded, larger."""
    rng, n = np.random.default_rng(5), 60
    found = []
    for _ in range(100):
        one = search([record(rng.standard_normal((n, 3)) / np.sqrt(60))], [Ramp()])
        found.append(one.test((), Ramp()).p_value)
    for level in (0.05, 0.2, 0.5):
        # three standard deviations of a binomial share
        assert np.mean(np.array(found) < level) <= level + 3 * np.sqrt(level * (1 - level) / 100)
