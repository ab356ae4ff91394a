"""Spectra of window means against covariances, and fits of many at once against each alone."""

import numpy as np
import pytest
from scipy.fft import dct

from imuloop.core.noise_model import AxisNoise, Coefficient, GaussMarkov, NoiseModel
from imuloop.core.samples import CHANNELS
from imuloop.noise.likelihood import log_likelihood
from imuloop.noise.processes import gauss_markov_mean_spectrum, mean_spectra
from imuloop.noise.spectrum import likeliest


def known(value):
    return Coefficient(value, None, None, True)


def transformed(noise, n=400):
    """Return θ and the diagonal of the covariance of cosine coefficients, windows of length 1."""
    transform, start = dct(np.eye(n), norm="ortho", axis=0), np.arange(n)
    model = NoiseModel("d", dict.fromkeys(CHANNELS, noise))
    covariance = model.pose_mean_covariance(np.column_stack([start, start + 1]))[0]
    return np.pi * np.arange(1, n) / n, np.diag(transform @ covariance @ transform.T)[1:]


@pytest.mark.parametrize("name, tolerance", [("N", 1e-9), ("K", 1e-6), ("B", 0.05)])
def test_unit_spectra_are_the_variances_of_the_coefficients(name, tolerance):
    theta, variance = transformed(AxisNoise(**{name: known(1.0)}))
    expected = mean_spectra(theta)[:, "QNBK".index(name)]
    # flicker: the ends of the record count in the first few
    inner = slice(8, None) if name == "B" else slice(None)
    np.testing.assert_allclose(expected[inner], variance[inner], rtol=tolerance)


@pytest.mark.parametrize("tc", [2.0, 8.0])
def test_the_spectrum_of_a_process(tc):
    process = GaussMarkov(known(np.sqrt(2 / tc)), known(tc))
    theta, variance = transformed(AxisNoise(gauss_markov=(process,)))
    np.testing.assert_allclose(gauss_markov_mean_spectrum(theta, tc)[5:], variance[5:], rtol=0.07)
    # all of the variance of means, 2 (Tc/τ)² (τ/Tc - 1 + exp(-τ/Tc)), is in the spectrum
    fine = (np.arange(20000) + 0.5) * np.pi / 20000
    mean = 2 * tc**2 * (1 / tc - 1 + np.exp(-1 / tc))
    assert gauss_markov_mean_spectrum(fine, tc).mean() == pytest.approx(mean, rel=1e-6)


def test_a_fit_of_its_own_spectrum_is_exact():
    theta = np.pi * np.arange(1, 500) / 500
    units = mean_spectra(theta)
    true = np.array([0.3, 2.0, 0.5, 1e-3])
    found = likeliest(units @ true, np.full(499, 10), units)
    np.testing.assert_allclose(found, true, rtol=0.05, atol=1e-3)


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
