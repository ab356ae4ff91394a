import allantools
import numpy as np
import pytest

from imuloop.noise.allan import allan_variance
from imuloop.noise.curve_covariance import curve_covariance
from imuloop.noise.fit import design

LENGTH = 10_000


@pytest.mark.parametrize(("term", "alpha"), [(0, 2), (1, 0), (2, -1), (3, -2)])
def test_degrees_of_freedom_agree_with_greenhall_and_riley(term, alpha):
    """Their closed approximations, as allantools has them, hold for many samples an average."""
    factors = np.array([40, 100, 300, 1000, 2500])
    theta = np.eye(5)[term]
    variance = curve_covariance(factors, [LENGTH], 1.0).variance(theta)
    edf = 2 * (design(factors) @ theta) ** 2 / variance
    expected = [
        allantools.edf_greenhall(alpha, 2, int(m), LENGTH + 1, overlapping=True) for m in factors
    ]
    assert edf == pytest.approx(expected, rel=0.025)


def test_white_noise_sample_by_sample_is_exact():
    """Squared first differences of white noise: variance 2 + 2 (1/2)^2 2 (M-1)/M over M."""
    count = LENGTH - 1
    found = curve_covariance([1], [LENGTH], 1.0).variance(np.array([0, 1.0, 0, 0, 0]))
    assert found == pytest.approx([(2 + (count - 1) / count) / count])


@pytest.mark.parametrize(
    "theta", [[0.2, 1, 0, 0, 0], [0, 1, 0, 3e-3, 0], [0, 1, 0, 0, 4e-5]], ids=["QN", "NK", "NR"]
)
def test_covariance_of_a_pooled_curve_agrees_with_simulation(theta):
    rng = np.random.default_rng(5)
    q, n, _, k, r = np.sqrt(theta)
    lengths, rate = [400, 150, 400], 2.0
    factors = np.array([1, 3, 10, 40, 120])

    def record(length):
        x = n * np.sqrt(rate) * rng.standard_normal(length)
        x += q * rate * np.diff(rng.standard_normal(length + 1))
        x += k / np.sqrt(rate) * np.cumsum(rng.standard_normal(length))
        return x + r * np.arange(length) / rate

    curves = np.array(
        [allan_variance([record(length) for length in lengths], factors) for _ in range(2000)]
    )
    found = np.cov(curves.T)
    expected = curve_covariance(factors, lengths, rate).matrix(np.array(theta))
    scale = np.sqrt(np.diag(expected))
    assert np.sqrt(np.diag(found)) == pytest.approx(scale, rel=0.06)
    assert found / (scale[:, None] * scale) == pytest.approx(
        expected / (scale[:, None] * scale), abs=0.1
    )


def test_diagonal_alone_is_the_same_diagonal():
    factors, theta = np.array([1, 7, 50]), np.array([0.1, 1, 0.01, 1e-3, 1e-4])
    full = curve_covariance(factors, [300, 200], 5.0)
    diagonal = curve_covariance(factors, [300, 200], 5.0, reach=1.0)
    assert diagonal.variance(theta) == pytest.approx(full.variance(theta))
    assert np.diag(full.matrix(theta)) == pytest.approx(full.variance(theta))
    assert np.count_nonzero(diagonal.matrix(theta)) == 3
