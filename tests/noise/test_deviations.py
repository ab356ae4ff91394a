"""Relatives of the Allan deviation against definitions, allantools and simulated records."""

import allantools
import numpy as np
import pytest

from imuloop.noise.allan import allan_variance, interval
from imuloop.noise.curve import NoiseOfCurve

# each with allantools' function
DEVIATIONS = {"total": "totdev", "modified": "mdev", "hadamard": "ohdev"}


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
    found = allan_variance([x + 1e3 * i for i, x in enumerate(stretches)], factors, name)
    for value, m in zip(found, factors, strict=True):
        used = [x for x in stretches if terms(len(x), m) > 1]
        weights = [terms(len(x), m) for x in used]
        each = [allan_variance([x], [m], name)[0] for x in used]
        assert value == pytest.approx(np.average(each, weights=weights), rel=1e-9)


def test_hadamard_is_blind_to_a_ramp_and_modified_sees_it():
    ramp, tau = np.arange(1000.0), np.array([1, 10, 100])
    assert allan_variance([ramp], tau, "hadamard") == pytest.approx(0, abs=1e-12)
    assert allan_variance([ramp], tau, "modified") == pytest.approx(tau**2 / 2)


@pytest.mark.parametrize("name", DEVIATIONS)
def test_one_stretch_is_what_allantools_gives(name):
    x = walk(np.random.default_rng(4), 2000) + 9.8
    factors = np.array([1, 2, 7, 60, 600])
    function = getattr(allantools, DEVIATIONS[name])
    deviation = function(x - x.mean(), rate=1.0, data_type="freq", taus=factors)[1]
    np.testing.assert_allclose(np.sqrt(allan_variance([x], factors, name)), deviation, rtol=1e-9)


@pytest.mark.parametrize("name", DEVIATIONS)
@pytest.mark.parametrize("noise", [white, walk, quantisation])
def test_intervals_cover(name, noise):
    """95 % of 300 records have an interval that holds the mean over all records."""
    rng = np.random.default_rng(2)
    lengths, factors = [900, 400], np.array([1, 2, 8, 16, 64, 110])
    theta = {white: [0, 1, 0, 0, 0], walk: [0, 0, 0, 1, 0], quantisation: [1, 0, 0, 0, 0]}[noise]
    edf = NoiseOfCurve.of(factors, lengths, 1.0, name).degrees_of_freedom(theta)
    found = [allan_variance([noise(rng, n) for n in lengths], factors, name) for _ in range(300)]
    truth, bounds = np.mean(found, axis=0), np.array([interval(each, edf) for each in found])
    covered = np.mean((bounds[:, 0] <= truth) & (truth <= bounds[:, 1]), axis=0)
    if name == "total":
        # of the Allan deviation: more at long averages, fewer where the ends hold quantisation
        assert np.all(covered[factors < 0.05 * 400] >= 0.91)
        assert noise is quantisation or np.all(covered >= 0.91)
    else:
        assert np.all((covered >= 0.91) & (covered <= 0.99))
