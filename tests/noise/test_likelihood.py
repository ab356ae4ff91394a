"""The likelihood against dense Gaussians."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.optimize import minimize

from imuloop.noise.likelihood import Likelihood, weighted_nnls

# two unit spectra, one flat and one that falls
K = np.arange(1, 40)
UNITS = np.column_stack([np.ones(39), 50.0 / K**2])
RHO = 3.0 / K**1.5
TRUTH = np.array([2.0, 1.0])


def draw(seed=0, ramp=1.5):
    rng = np.random.default_rng(seed)
    amplitudes = np.sqrt(UNITS @ TRUTH) * rng.standard_normal(39) + ramp * RHO
    return Likelihood(amplitudes, np.zeros(0), np.ones(39), RHO)


def contrasts_value(likelihood, theta):
    """The log-likelihood of all contrasts that do not see the ramp, from their dense covariance."""
    q = null_space(RHO[None, :])
    y, covariance = q.T @ likelihood.slow, q.T @ np.diag(UNITS @ theta) @ q
    return -(np.linalg.slogdet(covariance)[1] + y @ np.linalg.solve(covariance, y)) / 2


def test_restricted_likelihood_is_that_of_the_contrasts_without_the_ramp():
    likelihood, other = draw(), np.array([0.7, 3.0])

    def restricted(theta):
        expected = UNITS @ theta
        return likelihood.value(likelihood.power(likelihood.slope(expected)), expected, True)

    dense = contrasts_value(likelihood, TRUTH) - contrasts_value(likelihood, other)
    assert restricted(TRUTH) - restricted(other) == pytest.approx(dense, abs=1e-9)


def test_fit_is_its_maximum():
    likelihood = draw()
    fit = likelihood.fit(UNITS, True, restricted=True)
    best = minimize(
        lambda u: -contrasts_value(likelihood, np.exp(u)),
        np.log(TRUTH),
        method="Nelder-Mead",
        options={"xatol": 1e-8, "fatol": 1e-10},
    )
    # the scoring ends where the likelihood grows by less than 1e-6
    assert fit.theta == pytest.approx(np.exp(best.x), rel=1e-2)
    assert contrasts_value(likelihood, fit.theta) == pytest.approx(-best.fun, abs=1e-5)
    half = replace(likelihood, count=0.5 * likelihood.count).fit(UNITS, True, restricted=True)
    assert half.theta == pytest.approx(fit.theta, rel=1e-3)


def test_a_fitted_ramp_takes_no_power_from_the_falling_term():
    plain, restricted = (
        np.mean([draw(seed).fit(UNITS, True, restricted=r).theta for seed in range(400)], axis=0)
        for r in (False, True)
    )
    assert restricted[1] == pytest.approx(TRUTH[1], rel=0.1)
    assert plain[1] < 0.9 * restricted[1]


def test_least_squares_take_columns_of_any_size_and_number():
    rng = np.random.default_rng(3)
    truth, scale = np.array([1.0, 0.0, 2.0]), np.array([1e-60, 1.0, 1e60])
    units = rng.uniform(1, 2, (30, 3))
    found = weighted_nnls(units * scale, units @ truth, rng.uniform(1, 2, 30))
    assert found * scale == pytest.approx(truth, abs=1e-9)
    assert weighted_nnls(units[:, :0], units @ truth, np.ones(30)).size == 0
