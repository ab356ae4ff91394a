import numpy as np
import pytest

from imuloop.noise.allan import allan_variance, averaging_factors
from imuloop.noise.curve_covariance import curve_covariance
from imuloop.noise.fit import TERMS, design, fit_curve
from imuloop.noise.settings import NoiseSettings
from imuloop.simulate.noise import quantisation, walk, white

FACTORS = averaging_factors(20_000, NoiseSettings())
SPREAD = curve_covariance(FACTORS, [20_000], 10.0, reach=1.0)


@pytest.mark.parametrize("term", range(5))
def test_the_model_curve_itself_gives_the_model_back(term):
    tau, theta = FACTORS / 10.0, np.eye(5)[term] * 4.0
    assert fit_curve(tau, design(tau) @ theta, SPREAD) == pytest.approx(np.sqrt(theta), abs=1e-4)


def test_coefficients_of_a_record():
    rng = np.random.default_rng(1)
    x = white(20_000, 0.1, 0.01, rng) + walk(20_000, 0.1, 1e-3, rng)
    x += quantisation(20_000, 0.1, 0.01, rng)
    found = dict(
        zip(TERMS, fit_curve(FACTORS / 10, allan_variance([x], FACTORS), SPREAD), strict=True)
    )
    assert found["Q"] == pytest.approx(0.01, rel=0.05)
    assert found["N"] == pytest.approx(0.01, rel=0.2)
    assert found["K"] == pytest.approx(1e-3, rel=0.4)


@pytest.mark.parametrize("curve", [np.zeros(20), np.r_[np.ones(19), 0.0], np.ones(5)])
def test_a_curve_that_carries_no_fit_gives_zeros(curve):
    spread = curve_covariance(np.arange(1, len(curve) + 1), [100], 1.0, reach=1.0)
    assert fit_curve(np.arange(1.0, len(curve) + 1), curve, spread) == [0.0] * 5
