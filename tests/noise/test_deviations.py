"""Relatives of the Allan deviation against definitions, allantools and simulated records."""

import numpy as np
import pytest

from imuloop.noise.allan import interval
from imuloop.noise.deviations import DEVIATIONS, deviation_variance


def white(rng, n):
    return rng.standard_normal(n)


def walk(rng, n):
    return np.cumsum(rng.standard_normal(n))


def quantisation(rng, n):
    return np.diff(rng.standard_normal(n + 1))


@pytest.mark.parametrize("name", DEVIATIONS)
def test_stretches_pool_by_their_number_of_terms_whatever_their_levels(name):
    rng = np.random.default_rng(1)
    stretches = [rng.standard_normal(n) for n in (50, 400, 7)]
    factors = np.array([1, 3, 12, 100])
    terms = {
        "hadamard": lambda n, m: n + 1 - 3 * m,
        "modified": lambda n, m: n + 2 - 3 * m,
        "total": lambda n, m: n - 1 if m < n else 0,
    }[name]
    found, _ = deviation_variance(name, [x + 1e3 * i for i, x in enumerate(stretches)], factors)
    for value, m in zip(found, factors, strict=True):
        used = [x for x in stretches if terms(len(x), m) > 1]
        weights = [terms(len(x), m) for x in used]
        each = [deviation_variance(name, [x], [m])[0][0] for x in used]
        assert value == pytest.approx(np.average(each, weights=weights), rel=1e-9)


def test_hadamard_is_blind_to_a_ramp_and_modified_sees_it():
    ramp, tau = np.arange(1000.0), np.array([1, 10, 100])
    assert deviation_variance("hadamard", [ramp], tau)[0] == pytest.approx(0, abs=1e-12)
    assert deviation_variance("modified", [ramp], tau)[0] == pytest.approx(tau**2 / 2)


@pytest.mark.parametrize("name", DEVIATIONS)
@pytest.mark.parametrize("noise", [white, walk, quantisation])
def test_intervals_cover(name, noise):
    """95 % of 300 records have an interval that holds the mean over all records."""
    rng = np.random.default_rng(2)
    lengths, factors = [900, 400], np.array([1, 2, 8, 16, 64, 110])
    found = [
        deviation_variance(name, [noise(rng, n) for n in lengths], factors) for _ in range(300)
    ]
    truth = np.mean([variance for variance, _ in found], axis=0)
    bounds = np.array([interval(*each) for each in found])
    covered = np.mean((bounds[:, 0] <= truth) & (truth <= bounds[:, 1]), axis=0)
    known = np.isfinite(bounds).all(axis=(0, 1))
    # the curve of quantisation does not tell its exponent 2 from 1: wider than need be
    wide = noise is quantisation and name != "modified"
    assert np.all(covered[known] >= 0.91) and (wide or np.all(covered[known] <= 0.99))
    # no table for the total variance of quantisation where the ends count
    assert known.all() or (wide and name == "total" and known[factors < 0.05 * 400].all())


@pytest.mark.parametrize("name", DEVIATIONS)
@pytest.mark.parametrize("noise", [white, walk, quantisation])
def test_records_of_any_length_have_intervals(name, noise):
    """The tables of allantools raise where they have no entry."""
    for length in (10, 300, 20_000):
        factors = np.unique(np.geomspace(1, (length - 1) // 3, 25).astype(int))
        stretch = noise(np.random.default_rng(4), length)
        variance, edf = deviation_variance(name, [stretch], factors)
        known = np.isfinite(edf)
        assert np.all(variance > 0) and np.all(edf[known] > 0)
        assert known.all() or (name == "total" and noise is not walk)
