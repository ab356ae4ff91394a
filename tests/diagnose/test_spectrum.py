"""The spectrum of window means against covariances, and noise with a correlation time in it."""

import numpy as np
import pytest
from scipy.fft import dct

from diagnose.records import windows
from imuloop.core.noise_model import AxisNoise, Coefficient, GaussMarkov
from imuloop.diagnose.records.slow_noise import mean_covariance, unit_noise
from imuloop.diagnose.records.spectrum import (
    Spectrum,
    coefficients,
    coloured,
    held_out_ratio,
    limits,
    process_spectrum,
    spectra,
    unit_spectra,
)
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.simulate.noise import flicker, gauss_markov, walk, white

LENGTH, PER_WINDOW = 2.0, 10


def transformed(noise, n=400):
    """Return θ and the diagonal of the covariance of cosine coefficients, windows of length 1."""
    transform = dct(np.eye(n), type=2, norm="ortho", axis=0)
    covariance = mean_covariance(noise, windows(n, 1.0))
    return np.pi * np.arange(1, n) / n, np.diag(transform @ covariance @ transform.T)[1:]


@pytest.mark.parametrize("name, tolerance", [("N", 1e-9), ("K", 1e-6), ("B", 0.05)])
def test_unit_spectra_are_the_variances_of_the_coefficients(name, tolerance):
    theta, variance = transformed(unit_noise(name))
    expected = unit_spectra(theta)[:, "QNBK".index(name)]
    # flicker: the ends of the record count in the first few
    inner = slice(8, None) if name == "B" else slice(None)
    np.testing.assert_allclose(expected[inner], variance[inner], rtol=tolerance)


@pytest.mark.parametrize("tc", [2.0, 8.0])
def test_the_spectrum_of_a_process(tc):
    known = Coefficient(tc, None, None, True)
    q = Coefficient(np.sqrt(2 / tc), None, None, True)
    theta, variance = transformed(AxisNoise(gauss_markov=(GaussMarkov(q, known),)))
    np.testing.assert_allclose(process_spectrum(theta, tc)[5:], variance[5:], rtol=0.07)
    # all of the variance of means, 2 (Tc/τ)² (τ/Tc - 1 + exp(-τ/Tc)), is in the spectrum
    fine = (np.arange(20000) + 0.5) * np.pi / 20000
    mean = 2 * tc**2 * (1 / tc - 1 + np.exp(-1 / tc))
    assert process_spectrum(fine, tc).mean() == pytest.approx(mean, rel=1e-6)


def test_a_fit_of_its_own_spectrum_is_exact():
    theta = np.pi * np.arange(1, 500) / 500
    units = unit_spectra(theta)
    true = np.array([0.3, 2.0, 0.5, 1e-3])
    found = Spectrum(theta, units @ true, np.full(499, 10)).fit(units)
    np.testing.assert_allclose(found, true, rtol=0.05, atol=1e-3)


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
    axes = spectra([coefficients(values)])
    return coloured(axes, LENGTH), axes


def test_white_flicker_and_walk_are_no_process():
    kinds = ((0.0, 0.0), (0.5, 0.0), (0.0, 0.02), (0.3, 0.01))
    found = [judged(means(k, B=kinds[k % 4][0], K=kinds[k % 4][1]))[0].p_value for k in range(24)]
    assert np.sum(np.array(found) < 0.05) <= 4
    assert np.sum(np.array(found) < 0.005) <= 1


def test_a_process_of_its_detection_limit_is_found_and_three_of_it_measured():
    threshold, tc = np.log(0.002), 30.0
    plain, axes = judged(means(1))
    near, limit = limits(plain, axes, LENGTH, threshold, 0.9)
    assert near == plain.tc or plain.p_value > 0.002
    q = limits(type(plain)(0.0, tc, plain.tries, plain.variances, plain.std), axes,
               LENGTH, threshold, 0.9)[1][0]  # fmt: skip
    assert all(limit)
    hits = [judged(means(10 + k, q=q, tc=tc))[0].log_p < threshold for k in range(10)]
    # three axes have it, the limit is that of one
    assert np.mean(hits) >= 0.9
    found, _ = judged(means(50, q=3 * q, tc=tc))
    assert 0.5 < found.tc / tc < 2
    density = np.sqrt(2 * found.variances[:, 4] / found.tc)
    assert np.all(np.abs(density / (3 * q) - 1) < 0.35)


def test_held_out_blocks_tell_a_process_from_none():
    settings = DiagnoseSettings()

    def ratio(values):
        blocks = [coefficients(b) for b in np.array_split(values, 8)]
        folds = [(blocks[:k] + blocks[k + 1 :], blocks[k : k + 1]) for k in range(8)]
        return held_out_ratio(folds, settings)

    value, (low, high) = ratio(means(3, q=2.0, tc=30.0))
    assert low <= value <= high < 1
    # a term more that is not there predicts nothing better
    assert ratio(means(4))[1][1] > 0.999
    # seven blocks that never change say of the eighth that it cannot be
    stuck = np.where(np.arange(len(means(4)))[:, None] < len(means(4)) * 7 // 8, 1e-200, means(4))
    assert np.all(np.isfinite(ratio(stuck)[1]))
    # and of an axis that is stuck they know nothing at all
    alive = len(np.array_split(stuck, 8)[-1])
    stuck = means(4) * np.where(np.arange(len(stuck))[:, None] < len(stuck) - alive, [1, 1, 0], 1)
    assert np.all(np.isfinite(ratio(stuck)[1]))
