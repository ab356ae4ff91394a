"""Roots of many functions at once, against scipy's of one."""

import numpy as np
import pytest
from scipy.optimize import brentq

from imuloop.core.root import root


def test_roots_of_many_functions_are_those_of_each():
    level = np.linspace(0.01, 30, 60)
    found = root(lambda x: np.exp(x) * x - level, 0.0, np.full(60, 10.0))
    expected = [brentq(lambda x, k=k: np.exp(x) * x - k, 0, 10) for k in level]
    np.testing.assert_allclose(found, expected, atol=2e-12)


def test_an_end_may_be_the_root_and_one_sign_is_refused():
    np.testing.assert_allclose(root(lambda x: x, 0.0, 1.0), 0, atol=1e-12)
    with pytest.raises(ValueError, match="same sign"):
        root(lambda x: x + 1, 0.0, 1.0)
