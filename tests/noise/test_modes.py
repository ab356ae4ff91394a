import numpy as np
import pytest
from scipy.linalg import block_diag, toeplitz

from imuloop.noise.modes import expected_squares, modes
from imuloop.noise.processes import (
    block_mean_covariances,
    densities,
    gauss_markov_density,
    gauss_markov_means,
    gauss_markov_samples,
    sample_covariances,
)
from imuloop.noise.sampling import Sampling


def distances(starts):
    return np.abs(np.subtract.outer(starts, starts))


BROKEN = Sampling(10.0, *np.array([[0, 700, 1500], [500, 600, 400], [0, 0, 1]]))


def broken(x):
    """Return the Signal of what BROKEN keeps of 1900 samples."""
    ends = zip(BROKEN.starts, BROKEN.lengths, strict=True)
    return BROKEN.with_values(np.concatenate([x[start : start + n] for start, n in ends]))


@pytest.mark.parametrize("n", [2, 63, 64])
def test_expected_squares_are_those_of_the_dense_transform(n):
    omega = np.pi * np.arange(1, n) / n
    cosine = np.sqrt(2 / n) * np.cos(np.outer(omega, np.arange(n) + 0.5))
    for row in (*sample_covariances(n, 0.1), gauss_markov_samples(n, 0.1, 0.7)):
        dense = np.einsum("ki,ij,kj->k", cosine, toeplitz(row), cosine)
        assert expected_squares(row) == pytest.approx(dense, rel=1e-9, abs=1e-9 * abs(row).max())


def test_covariance_of_means_is_that_of_samples_averaged():
    """All processes exactly; contrasts, since flicker and walk have no level."""
    starts, m, dt = np.array([0, 5, 10, 40]), 5, 0.2
    place, contrast = np.arange(45), np.eye(4) - 0.25
    # takes samples to means of blocks
    average = ((place >= starts[:, None]) & (place < starts[:, None] + m)) / m
    samples = sample_covariances(45, dt)
    means = block_mean_covariances(distances(starts), m, dt)
    for process in range(4):
        dense = average @ toeplitz(samples[process]) @ average.T
        assert contrast @ means[process] @ contrast == pytest.approx(
            contrast @ dense @ contrast, rel=1e-9, abs=1e-9
        )
    dense = average @ toeplitz(gauss_markov_samples(45, dt, 1.3)) @ average.T
    assert gauss_markov_means(distances(starts), m, dt, 1.3) == pytest.approx(dense, rel=1e-9)


@pytest.mark.parametrize("m", [63, 64])
def test_flicker_of_long_means_is_scale_free(m):
    """Flicker has no time of its own: contrasts of means do not depend on their length."""
    starts, contrast = np.array([0, 1, 2, 40]), np.eye(4) - 0.25
    one = contrast @ block_mean_covariances(distances(starts * m), m, 1.0)[2] @ contrast
    ten = contrast @ block_mean_covariances(distances(starts * 10 * m), 10 * m, 0.3)[2] @ contrast
    assert one == pytest.approx(ten, rel=1e-3)
    # half the variance of the difference of neighbours is the Allan variance
    allan = (one[0, 0] + one[1, 1] - 2 * one[0, 1]) / 2
    assert allan == pytest.approx(2 * np.log(2) / np.pi, rel=3e-4)


def test_flicker_of_samples_has_its_density_up_to_half_the_rate():
    """Half the variance of the difference of two samples, from the density B^2/(2 pi f)."""
    f = np.geomspace(1e-12, 0.5, 200_000)
    for d in (1, 2, 7):
        integral = np.trapezoid(2 * (1 - np.cos(2 * np.pi * f * d)) / (2 * np.pi * f), f)
        found = sample_covariances(d + 1, 1.0)[2]
        assert found[0] - found[d] == pytest.approx(integral, rel=1e-6)


def test_white_and_walk_are_diagonal_in_a_broken_record():
    basis = modes([BROKEN])
    (piece,) = basis._pieces
    white, walk = block_mean_covariances(distances(piece.start), basis.m, basis.dt)[[1, 3]]
    contrasts = block_diag(*(level.basis for level in piece.levels))
    for covariance in (white, walk):
        inside = contrasts.T @ covariance @ contrasts
        off = inside - np.diag(np.diag(inside))
        assert np.abs(off).max() < 1e-9 * np.diag(inside).max()


def test_levels_do_not_enter_and_gaps_keep_their_place():
    rng = np.random.default_rng(0)
    basis = modes([BROKEN])
    x = rng.standard_normal(sum(BROKEN.lengths))
    slow, fast = basis.amplitudes([BROKEN.with_values(x)])
    moved = BROKEN.with_values(x + np.repeat([3.0, 3.0, -5.0], BROKEN.lengths))
    for found, expected in zip(basis.amplitudes([moved]), (slow, fast), strict=True):
        assert found == pytest.approx(expected, abs=1e-9)
    slow, fast = basis.amplitudes([broken(0.3 * 0.1 * np.arange(1900))])
    assert slow == pytest.approx(0.3 * basis.ramp, abs=1e-9)
    assert fast == pytest.approx(0, abs=1e-12)


def test_mean_squares_of_a_broken_record_are_as_expected():
    rng = np.random.default_rng(1)
    basis = modes([BROKEN])
    total = np.zeros(len(basis.count))
    for _ in range(150):
        x = np.cumsum(rng.standard_normal(1900)) * np.sqrt(0.1)
        slow, fast = basis.amplitudes([broken(x)])
        total += np.concatenate([slow**2, fast]) / basis.units[:, 3] / 150
    assert np.mean(total) == pytest.approx(1, abs=0.015)
    assert np.std(total[:-1]) == pytest.approx(np.sqrt(2 / 150), rel=0.15)


def test_densities_are_the_transform_of_the_covariance():
    n, dt = 4000, 0.1
    frequency = np.arange(200, 2000, 100) / (n * dt)
    for place in (0, 1):
        row = sample_covariances(n, dt)[place]
        spectrum = dt * (2 * np.fft.rfft(row).real - row[0])[200:2000:100]
        assert densities(frequency, dt)[:, place] == pytest.approx(spectrum, rel=1e-6)
    row = gauss_markov_samples(n, dt, 2.0)
    spectrum = dt * (2 * np.fft.rfft(row).real - row[0])[200:2000:100]
    assert gauss_markov_density(frequency, dt, 2.0) == pytest.approx(spectrum, rel=1e-6)


def test_bursts_of_two_samples_have_the_contrasts_of_their_samples():
    bursts = [Sampling.unbroken(10.0, 2)] * 500
    basis = modes(bursts)
    assert (basis.m, basis.count.sum()) == (1, 500)
    values = np.random.default_rng(0).normal(size=(500, 2))
    slow, fast = basis.amplitudes([s.with_values(x) for s, x in zip(bursts, values, strict=True)])
    np.testing.assert_allclose(
        np.sort(np.abs(slow)), np.sort(np.abs(np.diff(values)[:, 0])) / 2**0.5
    )
    assert len(fast) == 0


def test_a_session_of_stretches_shorter_than_a_block_adds_nothing():
    long = Sampling.unbroken(100.0, 100_000)
    shreds = Sampling(100.0, *np.array([[0, 9000], [5, 7], [0, 0]]))
    basis, alone = modes([long, shreds]), modes([long])
    assert basis.m > 7
    np.testing.assert_array_equal(basis.count, alone.count)
