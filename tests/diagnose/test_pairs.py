"""Two effects of like size, each of which hides the other."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.stats import f

from imuloop.diagnose.pairs import best_pair
from imuloop.diagnose.trial import Linear, White

N = 40
T = np.linspace(0, 1, N)
COLUMNS = (np.sin(7 * T), np.cos(23 * T), T**2)


@dataclass(frozen=True)
class A:
    """A candidate."""

    limit = np.inf


@dataclass(frozen=True)
class B:
    """Another."""

    limit = np.inf


@dataclass(frozen=True)
class C:
    """One more."""

    limit = np.inf


SHAPES = (A(), B(), C())


def white(values, columns=COLUMNS):
    kinds = {"kind": np.arange(N)[:, None].repeat(2, axis=1)}
    jacobian, columns = np.column_stack([np.ones(N), T]), tuple(c[:, None] for c in columns)
    linear = Linear(values, jacobian, SHAPES, columns, kinds, {"kind": 1})
    return White.of(linear, np.ones(N, dtype=bool), np.eye(N))


def chi2(values, *columns):
    design = np.column_stack([np.ones(N), T, *columns])
    left = values - design @ np.linalg.lstsq(design, values, rcond=None)[0]
    return left @ left


def test_both_are_found_and_tested_beside_each_other():
    rng = np.random.default_rng(0)
    values = 4 * COLUMNS[0] - 4 * COLUMNS[1] + rng.normal(size=N)
    pair = best_pair(white(values), (), SHAPES, (), np.log(1e-3))
    assert pair.effects == (A(), B())
    drop = chi2(values) - chi2(values, *COLUMNS[:2])
    scale = max(1, chi2(values, *COLUMNS[:2]) / (N - 4))
    expected = f.logsf(drop / 2 / scale, 2, N - 4) + np.log(3)
    assert pair.log_p == pytest.approx(expected)
    design = np.column_stack([np.ones(N), T, *COLUMNS[:2]])
    fitted = np.linalg.lstsq(design, values, rcond=None)[0][2:]
    np.testing.assert_allclose(pair.values, -fitted, rtol=1e-9)
    assert best_pair(white(values), (), SHAPES, {(A, B)}, np.log(1e-3)) is None


def test_no_pair_where_one_of_the_two_adds_nothing():
    rng = np.random.default_rng(1)
    values = 6 * COLUMNS[0] + rng.normal(size=N)
    assert best_pair(white(values), (), SHAPES, (), np.log(1e-3)) is None


@pytest.mark.parametrize(("step", "made"), [(0.1, False), (0.7, True)])
def test_twins_are_no_pair_for_what_tells_them_apart(step, made):
    twins = COLUMNS[0], COLUMNS[0] + step * COLUMNS[1], COLUMNS[2]
    rng = np.random.default_rng(3)
    values = 12 * COLUMNS[1] + rng.normal(size=N)
    pair = best_pair(white(values, twins), (), SHAPES, (), np.log(1e-3))
    assert (pair is not None) == made


def test_noise_alone_makes_no_pair():
    rng = np.random.default_rng(2)
    found = [best_pair(white(rng.normal(size=N)), (), SHAPES, (), np.log(0.05)) for _ in range(300)]
    assert sum(pair is not None for pair in found) <= 0.05 * 300
