"""Random effects with known errors: published numbers, the likelihood, simulated families."""

import numpy as np
import pytest

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
    result = fit(y, squares)
    assert result.mean[0] == pytest.approx(-0.7145, abs=5e-5)
    assert np.sqrt(result.mean_variance[0]) == pytest.approx(0.1798, abs=5e-5)
    assert result.variance[0] == pytest.approx(0.3132, abs=5e-5)
    assert np.square(spread_interval(y, squares)) == pytest.approx([0.1197, 1.1115], abs=5e-5)


def test_several_fits_at_once_are_those_of_their_devices():
    rng = np.random.default_rng(0)
    y, std = rng.normal(size=9), rng.lognormal(-1, 0.5, 9)
    counted = ~np.eye(9, dtype=bool)
    together = fit(y, std**2, counted=counted)
    for k, rows in enumerate(counted):
        alone = fit(y[rows], std[rows] ** 2)
        assert together.variance[k] == pytest.approx(alone.variance[0], rel=1e-6, abs=1e-12)
        assert together.mean[k] == pytest.approx(alone.mean[0])
        assert together.dof[k] == 7


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
