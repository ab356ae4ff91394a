"""Trials: p-value of a candidate, and which of two candidates goes first."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.stats import f as f_distribution
from scipy.stats import kstest

from diagnose.rows import FOLDS, Column, N, Other, T, rows, search
from imuloop.estimate.axis_fit import log_f_tail
from imuloop.estimate.search import Search

LINE = np.column_stack([np.ones(N), T])
FIRST, SECOND = Column(), Other()


@dataclass(frozen=True)
class Drift(Column):
    name, after_temperature, needs = "drift", True, ()


@dataclass(frozen=True)
class Warm(Column):
    name, needs = "warm", ("temperature",)


@dataclass(frozen=True)
class Late(Warm):
    price = 3.0


@pytest.mark.parametrize("size", [1.6, 0.5], ids=["above the noise", "below it"])
@pytest.mark.parametrize("base", [(), (SECOND,)], ids=["alone", "beside"])
@pytest.mark.parametrize("held_out", [(), (2,)], ids=["all", "held out"])
def test_the_p_value_is_that_of_generalised_least_squares(size, base, held_out):
    """With chi-square without and with q columns, and ν degrees of freedom in the second,

        F = (χ²_without - χ²_with) / (q s),   s = max(1, χ²_with / ν):

    the size of the noise is known, so that smaller residuals prove nothing.
    """
    rng, covariance = np.random.default_rng(11), np.eye(N) + 40 * np.exp(-np.abs(T[:, None] - T))
    root = np.linalg.cholesky(covariance)
    values = size * root @ rng.normal(size=N)
    columns = {FIRST: root @ rng.normal(size=N), SECOND: root @ rng.normal(size=N)}
    seen = ~np.isin(np.arange(N) % FOLDS, held_out)
    seen_root = np.linalg.cholesky(covariance[np.ix_(seen, seen)])
    design = np.column_stack([LINE, *(columns[e] for e in (*base, FIRST))])[seen]
    y, x = np.linalg.solve(seen_root, values[seen]), np.linalg.solve(seen_root, design)
    before, after = (
        np.sum((y - part @ np.linalg.lstsq(part, y)[0]) ** 2) for part in (x[:, :-1], x)
    )
    dof = x.shape[0] - x.shape[1]
    expected = f_distribution.sf((before - after) / max(1.0, after / dof), 1, dof)
    trials = Search(rows(values, LINE, columns, [covariance]), frozenset(held_out))
    assert trials.test(base, FIRST).p_value == pytest.approx(expected, rel=1e-9)


def test_tail_of_f_below_the_smallest_double():
    # with two degrees of freedom the tail is (1 + 2F/ν)^(-ν/2)
    for dof, statistic in ((100, 1e9), (4000, 50.0), (4000, 3e3)):
        exact = -dof / 2 * np.log1p(2 * statistic / dof)
        assert log_f_tail(statistic, 2, dof) == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize(("like", "first"), [(0.999, Warm), (0.6, Drift)])
def test_a_logged_cause_goes_before_time_where_it_explains_as_much(like, first):
    drift, other = np.sin(9 * T), np.cos(23 * T)
    columns = {Drift(): drift, Warm(): like * drift + np.sqrt(1 - like**2) * other}
    problem = search(20 * drift + np.random.default_rng(1).normal(size=N), LINE, columns)
    trials = [problem.trial((), cls) for cls in (Drift, Warm)]
    assert trials[0].log_p < trials[1].log_p < problem.threshold(0)
    assert problem.best_trial((), problem.kinds).effect.kind is first


@pytest.mark.parametrize(("like", "chosen"), [(0.999, Warm), (0.6, Late)])
def test_a_constant_more_has_to_gain_its_price(like, chosen):
    true, other = np.sin(9 * T), np.cos(23 * T)
    problem = search(
        5 * true + np.random.default_rng(1).normal(size=N),
        LINE,
        {Warm(): like * true + np.sqrt(1 - like**2) * other, Late(): true},
    )
    tried = problem.tests((), (Warm(), Late()))
    assert (tried[1].log_p < tried[0].log_p - 3.0) == (chosen is Late)
    assert type(problem.best_variant((), (Warm(), Late()), 0.0).effect) is chosen


def test_p_values_are_uniform_without_an_effect():
    """Two hypotheses of the noise, of which the data do not tell which is right."""
    rng, noises, wave = np.random.default_rng(2), [np.eye(N), 1.3 * np.eye(N)], np.sin(9 * T)
    searches = [search(rng.normal(size=N), LINE, {FIRST: wave}, noises) for _ in range(200)]
    # conservative by a little: the scale is never below the noise model's
    assert kstest([one.trial((), Column).p_value for one in searches], "uniform").pvalue > 1e-3
