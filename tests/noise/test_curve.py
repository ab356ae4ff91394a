"""The plain fit to the Allan curve and the variance of its points."""

import allantools
import numpy as np
import pytest

from imuloop.noise.allan import allan_variance, averaging_factors
from imuloop.noise.curve import NoiseOfCurve, fit_curve
from imuloop.noise.settings import NoiseSettings

FACTORS = averaging_factors(20_000, NoiseSettings())
CURVE = NoiseOfCurve.of(FACTORS, [20_000], 10.0)
LENGTH = 10_000


@pytest.mark.parametrize("term", range(5))
def test_the_model_curve_itself_gives_the_model_back(term):
    tau, theta = FACTORS / 10.0, np.eye(5)[term] * 4.0
    flicker = 2 * np.log(2) / np.pi + 0 * tau
    model = np.column_stack([3 / tau**2, 1 / tau, flicker, tau / 3, tau**2 / 2])
    assert fit_curve(model @ theta, CURVE) == pytest.approx(np.sqrt(theta), abs=1e-4)


@pytest.mark.parametrize("curve", [np.zeros(20), np.r_[np.ones(19), 0.0], np.ones(5)])
def test_a_curve_that_carries_no_fit_gives_zeros(curve):
    assert fit_curve(curve, NoiseOfCurve.of(np.arange(1, len(curve) + 1), [100], 1.0)) == [0.0] * 5


@pytest.mark.parametrize(("term", "alpha"), [(0, 2), (1, 0), (2, -1), (3, -2)])
def test_degrees_of_freedom_agree_with_greenhall_and_riley(term, alpha):
    """Their closed approximations, as allantools has them, hold for many samples an average."""
    factors = np.array([40, 100, 300, 1000, 2500])
    edf = NoiseOfCurve.of(factors, [LENGTH], 1.0).degrees_of_freedom(np.eye(5)[term])
    expected = [
        allantools.edf_greenhall(alpha, 2, int(m), LENGTH + 1, True, False) for m in factors
    ]
    assert edf == pytest.approx(expected, rel=0.025)


@pytest.mark.parametrize("theta", [[0.2, 1, 0, 3e-3, 0], [0, 1, 0, 0, 4e-5]], ids=["QNK", "NR"])
def test_variance_of_a_pooled_curve_agrees_with_simulation(theta):
    rng = np.random.default_rng(5)
    q, n, _, k, r = np.sqrt(theta)
    lengths, rate, factors = [400, 150, 400], 2.0, np.array([1, 3, 10, 40, 120])

    def record(length):
        x = n * np.sqrt(rate) * rng.standard_normal(length)
        x += q * rate * np.diff(rng.standard_normal(length + 1))
        x += k / np.sqrt(rate) * np.cumsum(rng.standard_normal(length))
        return x + r * np.arange(length) / rate

    curves = [allan_variance([record(length) for length in lengths], factors) for _ in range(1000)]
    expected = NoiseOfCurve.of(factors, lengths, rate).variance(np.array(theta))
    assert np.std(curves, axis=0) == pytest.approx(np.sqrt(expected), rel=0.06)
