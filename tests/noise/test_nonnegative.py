"""The non-negative least squares against scipy's."""

import numpy as np
import pytest
from scipy.optimize import nnls

from imuloop.noise.nonnegative import nonnegative


@pytest.mark.parametrize("seed", range(100))
def test_it_is_that_of_scipy_from_any_likely_set(seed):
    rng = np.random.default_rng(seed)
    p = rng.integers(1, 7)
    scale = 10 ** rng.uniform(-6, 6, p)
    a, truth = np.abs(rng.standard_normal((30, p))) * scale, rng.standard_normal(p) / scale
    b = a @ truth + 0.1 * rng.standard_normal(30)
    likely = None if seed % 3 == 0 else rng.random(p) < 0.6
    found = nonnegative(a.T @ a, a.T @ b, likely)
    assert found * scale == pytest.approx(nnls(a, b)[0] * scale, rel=1e-9, abs=1e-12)


def test_of_equal_columns_one_is_taken():
    a = np.column_stack([np.ones(9), np.arange(9.0), np.ones(9)])
    found = nonnegative(a.T @ a, a.T @ (a @ [1.0, 2.0, 3.0]))
    assert found == pytest.approx([4, 2, 0])


def test_nothing_has_no_unknown():
    assert nonnegative(np.zeros((0, 0)), np.zeros(0)).size == 0
