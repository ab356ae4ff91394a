"""Random effects with known errors: published numbers, the likelihood, simulated families."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from family.members import EVERY, Family
from imuloop.family.random_effects import fit, spread_interval
from seeds import least_count, seeds

# trials of the vaccine BCG: cases and others, vaccinated and not
BCG = np.array(
    [
        [4, 119, 11, 128], [6, 300, 29, 274], [3, 228, 11, 209], [62, 13536, 248, 12619],
        [33, 5036, 47, 5761], [180, 1361, 372, 1079], [8, 2537, 10, 619],
        [505, 87886, 499, 87892], [29, 7470, 45, 7232], [17, 1699, 65, 1600],
        [186, 50448, 141, 27197], [5, 2493, 3, 2338], [27, 16886, 29, 17825],
    ],
    dtype=float,
)  # fmt: skip


def risks():
    """Return log relative risk of the trials, and its variance."""
    cases, others, without, rest = BCG.T
    value = np.log(cases / (cases + others)) - np.log(without / (without + rest))
    return value, 1 / cases - 1 / (cases + others) + 1 / without - 1 / (without + rest)


def test_the_published_example():
    # W. Viechtbauer, "Conducting meta-analyses in R with the metafor package", J. Stat. Softw. 36
    # (3), 2010, section 3, and the interval by metafor's confint
    y, squares = risks()
    found = fit(y, squares)
    assert found.mean[0] == pytest.approx(-0.7145, abs=5e-5)
    assert np.sqrt(found.mean_variance[0]) == pytest.approx(0.1798, abs=5e-5)
    assert found.variance[0] == pytest.approx(0.3132, abs=5e-5)
    assert np.square(spread_interval(y, squares)) == pytest.approx([0.1197, 1.1115], abs=5e-5)


def restricted_likelihood(variance, y, squares, X):
    """Return -2 times the restricted likelihood, from its definition, without a constant."""
    V = np.diag(variance + squares)
    W = np.linalg.inv(V)
    XWX = X.T @ W @ X
    left = y - X @ np.linalg.solve(XWX, X.T @ W @ y)
    return np.linalg.slogdet(V)[1] + np.linalg.slogdet(XWX)[1] + left @ W @ left


@pytest.mark.parametrize("count", [3, 4, 8, 50])
def test_the_variance_is_where_the_restricted_likelihood_is_largest(count):
    rng, X = np.random.default_rng(count), np.ones((count, 1))
    for _ in range(20):
        std = 0.7 * rng.lognormal(0, 0.8, count)
        y = 3 + rng.normal(0, rng.choice([0, 0.3, 2]), count) + std * rng.normal(size=count)
        found = fit(y, std**2).variance[0]
        grid = np.append(0, np.geomspace(1e-4, 100, 300))
        best = grid[np.argmin([restricted_likelihood(v, y, std**2, X) for v in grid])]
        ends = (0.5 * best, 2 * best + 1e-4)
        exact = minimize_scalar(
            restricted_likelihood,
            bounds=ends,
            args=(y, std**2, X),
            method="bounded",
            options={"xatol": 1e-9},
        )
        least_of_all = min(exact.fun, restricted_likelihood(0, y, std**2, X))
        assert restricted_likelihood(found, y, std**2, X) <= least_of_all + 1e-6


def test_several_fits_at_once_are_those_of_their_devices():
    rng = np.random.default_rng(0)
    y, std = rng.normal(size=9), rng.lognormal(-1, 0.5, 9)
    counted = ~np.eye(9, dtype=bool)
    together = fit(y, std**2, counted=counted)
    for k, own in enumerate(counted):
        alone = fit(y[own], std[own] ** 2)
        assert together.variance[k] == pytest.approx(alone.variance[0], rel=1e-6, abs=1e-12)
        assert together.mean[k] == pytest.approx(alone.mean[0])
        assert together.dof[k] == 7


def test_units_do_not_matter():
    rng = np.random.default_rng(1)
    y, std = rng.normal(size=20), rng.lognormal(-1, 0.5, 20)
    whole, small = fit(y, std**2), fit(1e-9 * y, 1e-18 * std**2)
    assert small.variance[0] == pytest.approx(1e-18 * whole.variance[0])
    intervals = spread_interval(y, std**2), spread_interval(1e-9 * y, 1e-18 * std**2)
    assert np.array(intervals[1]) == pytest.approx(1e-9 * np.array(intervals[0]))


@seeds(5, 40)
def test_the_spread_lies_within_its_interval(seeds):
    inside = []
    for seed in range(seeds):
        family = Family(seed)
        for k in range(len(EVERY)):
            low, high = spread_interval(family.y[:, k], family.std[:, k] ** 2)
            inside.append(low <= family.spread[k] <= high)
    # the bound is 90 to 98 %: the truth is 95 %
    count = len(inside)
    assert least_count(count, 0.95, 0.005) <= sum(inside) <= least_count(count, 0.95, 0.995)
    assert 0.90 <= np.mean(inside) <= 0.98
