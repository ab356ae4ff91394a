"""Noise with a correlation time in window means: found where it is, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.fft import dct

from calibrate.devices import known
from imuloop.core.noise_model import AxisNoise, GaussMarkovTerm, NoiseModel
from imuloop.core.samples import CHANNELS
from imuloop.noise.coloured import (
    WindowSpectrum,
    coefficients,
    coloured,
    held_out_ratio,
    limits,
    most_likely,
)
from imuloop.noise.likelihood import log_likelihood
from imuloop.noise.processes import gauss_markov_mean_spectrum, mean_spectra
from imuloop.simulate.noise import flicker, gauss_markov, walk, white

LENGTH, PER_WINDOW = 2.0, 10


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
    process = GaussMarkovTerm(known(np.sqrt(2 / tc)), known(tc))
    theta, variance = transformed(AxisNoise(gauss_markov=(process,)))
    np.testing.assert_allclose(gauss_markov_mean_spectrum(theta, tc)[5:], variance[5:], rtol=0.07)


def test_a_fit_of_its_own_spectrum_is_exact():
    units = mean_spectra(np.pi * np.arange(1, 500) / 500)
    true = np.array([0.3, 2.0, 0.5, 1e-3])
    found = most_likely(units @ true, np.full(499, 10), units)
    np.testing.assert_allclose(found, true, rtol=0.05, atol=1e-3)


@pytest.mark.parametrize("share", [0.0, 1e-9, 1e-3])
def test_a_coefficient_that_happens_to_be_as_good_as_zero_does_not_count_alone(share):
    """Each unit is the same in that bin: by it alone they cannot be distinguished."""
    rng = np.random.default_rng(2)
    frequency, times = np.geomspace(1e-3, 1, 30), np.array([3.0, 30, 300])
    red = 1 / (1 + (2 * np.pi * frequency[:, None] * times) ** 2)
    units, truth = np.column_stack([np.ones(30), red]), [1.0, 0, 50, 0]
    count = np.geomspace(1, 300, 30).round()
    power = (units @ truth) * rng.chisquare(count, size=(100, 30)) / count
    power[:, 0] *= share
    found = np.array([most_likely(each, count, units) for each in power])
    assert np.all(np.isfinite(found)) and np.all(found >= 0)
    value = log_likelihood(power, count, found @ units.T)
    assert np.all(value >= log_likelihood(power, count, units @ truth) - 0.05)
    np.testing.assert_allclose(np.median(found[:, 0]), 1.0, rtol=0.03)


def means(seed, n=1500, B=0.3, K=0.01, q=0.0, tc=1.0):
    rng, dt = np.random.default_rng(seed), LENGTH / PER_WINDOW
    count = n * PER_WINDOW
    axes = [
        white(count, dt, 1.0, rng)
        + flicker(count, dt, B, rng)
        + walk(count, dt, K, rng)
        + gauss_markov(count, dt, q, tc, rng)
        for _ in range(3)
    ]
    return np.array(axes).T.reshape(n, PER_WINDOW, 3).mean(axis=1)


def judged(values):
    spectrum = WindowSpectrum.of([coefficients(values)])
    return coloured(spectrum, LENGTH), spectrum


def test_white_flicker_and_walk_are_no_process():
    kinds = ((0.0, 0.0), (0.5, 0.0), (0.0, 0.02), (0.3, 0.01))
    found = [judged(means(k, B=kinds[k % 4][0], K=kinds[k % 4][1]))[0].p_value for k in range(24)]
    assert np.sum(np.array(found) < 0.05) <= 4
    assert np.sum(np.array(found) < 0.005) <= 1


def test_a_process_of_its_detection_limit_is_found_and_three_of_it_measured():
    threshold, tc = np.log(0.002), 30.0
    plain, spectrum = judged(means(1))
    _, limit = limits(replace(plain, tc=tc), spectrum, LENGTH, threshold, 0.9)
    assert all(limit)
    hits = [judged(means(10 + k, q=limit[0], tc=tc))[0].log_p < threshold for k in range(10)]
    # three axes have it, the limit is that of one
    assert np.mean(hits) >= 0.9
    q = 3 * limit[0]
    found, _ = judged(means(50, q=q, tc=tc))
    assert 0.5 < found.tc / tc < 2
    assert np.all(np.abs(found.drive[0] / q - 1) < 0.35)


def test_held_out_blocks_tell_a_process_from_none():
    def ratio(values):
        blocks = [coefficients(b) for b in np.array_split(values, 8)]
        folds = [(blocks[:k] + blocks[k + 1 :], blocks[k : k + 1]) for k in range(8)]
        return held_out_ratio(folds, 2000, 0)

    value, (low, high) = ratio(means(3, q=2.0, tc=30.0))
    assert low <= value <= high < 1
    # a term more that is not there predicts nothing better
    plain = means(4)
    assert ratio(plain)[1][1] > 0.999
    # seven blocks that never change say of the eighth that it cannot be
    early = np.arange(len(plain)) < len(plain) * 7 // 8
    assert np.all(np.isfinite(ratio(np.where(early[:, None], 1e-200, plain))[1]))
    # and of an axis that is stuck they know nothing at all
    stuck = plain * np.where(early[:, None], [1, 1, 0], 1)
    assert np.all(np.isfinite(ratio(stuck)[1]))
