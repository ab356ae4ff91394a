from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import toeplitz

from imuloop.noise.modes import expected_squares, modes
from imuloop.noise.processes import covariances
from imuloop.noise.signal import Signal

BROKEN = Signal(10.0, *np.array([[0, 700, 1500], [500, 600, 400], [0, 0, 1]]))


def broken(x):
    """Return the Signal of what BROKEN keeps of 1900 samples."""
    ends = zip(BROKEN.starts, BROKEN.lengths, strict=True)
    return replace(BROKEN, values=np.concatenate([x[start : start + n] for start, n in ends]))


@pytest.mark.parametrize("n", [2, 63, 64])
def test_expected_squares_are_those_of_the_dense_transform(n):
    omega = np.pi * np.arange(1, n) / n
    cosine = np.sqrt(2 / n) * np.cos(np.outer(omega, np.arange(n) + 0.5))
    for row in covariances(np.arange(n), 1, 0.1, [0.7]):
        dense = np.einsum("ki,ij,kj->k", cosine, toeplitz(row), cosine)
        assert expected_squares(row) == pytest.approx(dense, rel=1e-9, abs=1e-9 * abs(row).max())


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
