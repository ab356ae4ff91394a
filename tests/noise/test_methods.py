"""The compared estimators are what they are called: against dense matrices."""

import numpy as np
import pytest
from scipy.fft import dct, dctn, dst
from scipy.linalg import toeplitz
from scipy.optimize import minimize
from scipy.stats import multivariate_normal

from bench.noise.estimators import (
    blocks,
    bound,
    cosine,
    curve,
    diagonal_loss,
    differenced,
    estimate,
    expected_periodogram,
    fourier,
    sine,
    sine_taper,
    wavelet,
)
from imuloop.noise.processes import sample_covariances
from imuloop.simulate.noise import walk, white

N, RATE = 60, 10.0
# N^2, B^2, K^2
THETA = np.array([0.3, 0.05, 0.02])
COVARIANCES = [toeplitz(row) for row in sample_covariances(N, 1 / RATE)[1:]]
DIFFERENCE = np.diff(np.eye(N), axis=0)


@pytest.fixture
def record():
    rng = np.random.default_rng(3)
    return 5 + white(N, 1 / RATE, 0.5, rng) + walk(N, 1 / RATE, 0.1, rng)


def test_the_sine_transform_diagonalises_differences_of_white_noise_and_walk():
    basis = dst(np.eye(N - 1), type=1, norm="ortho", axis=0)
    expected = sine(N, RATE).expected
    for term in (0, 2):
        dense = DIFFERENCE @ COVARIANCES[term] @ DIFFERENCE.T
        assert basis @ dense @ basis.T == pytest.approx(np.diag(expected[:, term]), abs=1e-10)


def test_the_likelihood_in_sines_is_the_dense_gaussian_one(record):
    method = sine(N, RATE)
    eigenvalues = method.expected[:, [0, 2]] @ THETA[[0, 2]]
    found = -0.5 * np.sum(np.log(2 * np.pi * eigenvalues) + method.squares(record) / eigenvalues)
    dense = DIFFERENCE @ (THETA[0] * COVARIANCES[0] + THETA[2] * COVARIANCES[2]) @ DIFFERENCE.T
    expected = multivariate_normal(np.zeros(N - 1), dense).logpdf(np.diff(record))
    assert found == pytest.approx(expected, rel=1e-12)


def test_sines_of_differences_and_cosines_of_the_record_are_the_same_squares(record):
    """Singular vectors of the difference: the likelihoods differ by a constant."""
    sines, cosines = sine(N, RATE), cosine(N, RATE)
    gain = 2 - 2 * np.cos(np.pi * np.arange(1, N) / N)
    assert sines.squares(record) == pytest.approx(gain * cosines.squares(record), rel=1e-9)
    assert sines.expected[:, 2] == pytest.approx(gain * cosines.expected[:, 2], rel=1e-9)


def test_expected_squares_of_cosines_are_those_of_the_dense_covariance():
    basis = dct(np.eye(N), norm="ortho", axis=0)[1:]
    dense = np.array([np.diag(basis @ c @ basis.T) for c in COVARIANCES]).T
    assert cosine(N, RATE).expected == pytest.approx(dense, rel=1e-10, abs=1e-12)


@pytest.mark.parametrize("taper", [np.ones, sine_taper])
def test_the_expected_periodogram_is_that_of_the_dense_covariance(taper):
    weights = taper(N - 1) / np.linalg.norm(taper(N - 1))
    transform = np.fft.rfft(np.eye(N - 1), axis=0) * weights @ DIFFERENCE
    dense = [np.einsum("ki,ij,kj->k", transform, c, transform.conj()).real for c in COVARIANCES]
    found = expected_periodogram(differenced(N - 1, RATE), weights)
    assert found == pytest.approx(np.array(dense), rel=1e-10, abs=1e-12)
    assert fourier(N, RATE, taper=taper).expected == pytest.approx(found[:, 1 : N // 2].T)


@pytest.mark.parametrize("make", [wavelet, curve])
def test_expected_allan_variances_are_those_of_the_dense_covariance(make):
    dense = []
    for factor in (1, 2, 4, 8, 16):
        contrast = np.repeat([-1, 1, 0], [factor, factor, N - 2 * factor]) / factor
        dense.append([contrast @ c @ contrast / 2 for c in COVARIANCES])
    expected = make(N, RATE).expected
    rows = np.isin(np.round(1 / expected[:, 0] * RATE), [1, 2, 4, 8, 16])
    assert expected[rows] == pytest.approx(np.array(dense), rel=1e-10)


def test_scoring_ends_at_the_maximum_of_the_likelihood():
    n, rng = 4000, np.random.default_rng(8)
    x = white(n, 1 / RATE, 0.01, rng) + walk(n, 1 / RATE, 1e-3, rng)
    method = cosine(n, RATE)
    squares, units = method.squares(x), method.expected[:, [0, 2]]

    def loss(logarithm):
        model = units @ np.exp(2 * logarithm)
        return np.sum(np.log(model) + squares / model)

    best = minimize(loss, np.log([0.02, 3e-3]), method="Nelder-Mead", options={"xatol": 1e-7})
    assert estimate(method, x, "NK")[[0, 2]] == pytest.approx(np.exp(best.x), rel=1e-4)


def test_the_bound_of_cosines_is_the_published_one():
    """Cramér–Rao bounds of the handbook's records, 10 Hz and 3 h, in its digits."""
    method = cosine(108_000, RATE)
    strong, weak = (bound(method, {"N": 0.01, "K": k}) for k in (1e-4, 3e-5))
    assert strong["N"] == pytest.approx(0.0022, abs=5e-5)
    assert strong["K"] == pytest.approx(0.137, abs=5e-4)
    assert weak["K"] == pytest.approx(0.257, abs=5e-4)
    assert bound(blocks(108_000, RATE), {"N": 0.01, "K": 3e-5})["K"] == pytest.approx(
        weak["K"], rel=0.01
    )


@pytest.mark.parametrize("ratio", [1e-3, 0.1, 10.0], ids=["weak", "middle", "strong"])
def test_cosines_lose_next_to_nothing_where_flicker_correlates_them(ratio):
    """Variance of the estimate under the dense covariance against the exact bound."""
    units = np.stack([toeplitz(row) for row in sample_covariances(256, 1.0)[1:3]])
    cosines = dctn(units, norm="ortho", axes=(1, 2))[:, 1:, 1:]
    loss = diagonal_loss(cosines, np.array([1.0, ratio]))
    assert np.all(loss >= 1 - 1e-9)
    assert np.all(loss < 1.02), loss


def test_modes_that_are_uncorrelated_lose_nothing_and_others_do():
    units = np.stack([np.diag([1.0, 1, 1]), np.diag([4.0, 1, 0.1])])
    turn = np.linalg.qr(np.arange(9).reshape(3, 3) + np.eye(3))[0]
    theta = np.array([1.0, 2.0])
    assert diagonal_loss(units, theta) == pytest.approx(1)
    assert np.all(diagonal_loss(turn @ units @ turn.T, theta) > 1.05)
