"""Fits of many spectra at once against those of one problem after the other."""

import numpy as np
import pytest
from scipy.optimize import nnls

from imuloop.diagnose.records.spectrum_fit import likeliest, log_likelihood, nonnegative


@pytest.mark.parametrize("guess", [True, False])
def test_the_same_as_least_squares_without_negative_parts(guess):
    rng = np.random.default_rng(0)
    a, y = rng.normal(size=(50, 20, 4)), rng.normal(size=(50, 20))
    transposed = a.swapaxes(1, 2)
    moment = (transposed @ y[..., None])[..., 0]
    found = nonnegative(transposed @ a, moment, np.full((50, 4), guess))
    expected = [nnls(one, values)[0] for one, values in zip(a, y, strict=True)]
    np.testing.assert_allclose(found, expected, atol=1e-13)
    assert np.any(found == 0) and np.any(found > 0)


def test_many_fits_at_once_are_those_of_each_and_no_other_is_likelier():
    rng = np.random.default_rng(1)
    units = rng.uniform(0.1, 2, size=(3, 1, 30, 3)) ** 4
    count = rng.integers(2, 40, size=30)
    power = rng.chisquare(count, size=(4, 30)) / count
    found = likeliest(power, count, units)
    assert found.shape == (3, 4, 3) and np.all(found >= 0)
    value = log_likelihood(power, count, (units @ found[..., None])[..., 0])
    for i in range(3):
        for j in range(4):
            alone = likeliest(power[j], count, units[i, 0])
            np.testing.assert_allclose(found[i, j], alone, rtol=1e-9, atol=1e-12)
    for _ in range(20):
        other = found * rng.uniform(0.8, 1.25, size=found.shape)
        expected = (units @ other[..., None])[..., 0]
        assert np.all(log_likelihood(power, count, expected) <= value + 0.05)


@pytest.mark.parametrize("share", [0.0, 1e-9, 1e-3])
def test_a_coefficient_that_happens_to_be_as_good_as_zero_does_not_count_alone(share):
    """Each unit is the same in that bin: by it alone they cannot be told apart."""
    rng = np.random.default_rng(2)
    frequency = np.geomspace(1e-3, 1, 30)
    times = np.array([3.0, 30, 300])
    red = 1 / (1 + (2 * np.pi * frequency[:, None] * times) ** 2)
    units = np.column_stack([np.ones(30), red])
    count = np.geomspace(1, 300, 30).round()
    power = (units @ [1.0, 0, 50, 0]) * rng.chisquare(count, size=(200, 30)) / count
    power[:, 0] *= share
    found = likeliest(power, count, units)
    assert np.all(np.isfinite(found)) and np.all(found >= 0)
    value = log_likelihood(power, count, (units @ found[..., None])[..., 0])
    truth = log_likelihood(power, count, units @ [1.0, 0, 50, 0])
    assert np.all(value >= truth - 0.05)
    np.testing.assert_allclose(np.median(found[:, 0]), 1.0, rtol=0.03)
