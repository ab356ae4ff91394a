"""The least-squares fit against the standard library of the field, from near and from far."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from imuloop.calibrate.least_squares import SINGULAR, NotConverged, fit, why_no_fit

T = np.linspace(0, 4, 30)
TRUTH = np.array([2.0, 1.3, -0.4])


def decay(x):
    """A decay with an offset, and its derivative."""
    curve = np.exp(-x[1] * T)
    return x[0] * curve + x[2], np.column_stack([curve, -x[0] * T * curve, np.ones(len(T))])


def problem(seed):
    """Residuals of a noisy decay, and the full covariance of its noise."""
    rng = np.random.default_rng(seed)
    root = 0.1 * (np.eye(len(T)) + 0.3 * rng.normal(size=(len(T), len(T))))
    y = decay(TRUTH)[0] + root @ rng.normal(size=len(T))

    def residuals(x):
        value, jacobian = decay(x)
        return value - y, jacobian

    return residuals, root @ root.T


@pytest.mark.parametrize("start", [TRUTH, [30, 0.1, -20], [0.5, 4, 1]])
def test_the_minimum_is_that_of_scipy(start):
    residuals, covariance = problem(0)
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    theirs = least_squares(
        lambda x: whiten @ residuals(x)[0], TRUTH, xtol=1e-14, ftol=1e-14, gtol=1e-14
    )
    ours = fit(residuals, start, covariance)
    std = np.sqrt(np.diag(ours.covariance))
    np.testing.assert_allclose((ours.x - theirs.x) / std, 0, atol=1e-3)
    assert ours.chi2 == pytest.approx(2 * theirs.cost, rel=1e-8)
    assert ours.dof == len(T) - 3
    np.testing.assert_allclose(
        ours.covariance, np.linalg.inv(theirs.jac.T @ theirs.jac), rtol=1e-2, atol=1e-6
    )


def test_residuals_without_noise_are_fitted_to_rounding():
    found = fit(lambda x: (decay(x)[0] - decay(TRUTH)[0], decay(x)[1]), [1, 1, 0], np.eye(len(T)))
    np.testing.assert_allclose(found.x, TRUTH, rtol=1e-12)


def test_what_the_data_do_not_determine_is_an_error():
    def residuals(x):
        return x[0] * T - T, np.column_stack([T, np.zeros(len(T))])

    for covariance in (np.eye(len(T)), -np.eye(len(T))):
        with pytest.raises(np.linalg.LinAlgError):
            fit(residuals, [0, 0], covariance)


def test_a_fit_that_ends_before_its_minimum_is_none_and_says_so():
    def residuals(x):
        value = np.exp(-x[0]) * np.ones(3)
        return value, -value[:, None]

    with pytest.raises(NotConverged, match="does not converge in 200 steps") as raised:
        fit(residuals, [0.0], np.eye(3))
    assert why_no_fit(raised.value) == "the fit does not converge in 200 steps"
    assert why_no_fit(np.linalg.LinAlgError("singular")) == SINGULAR


@pytest.mark.parametrize("quiet", [1e-6, 1e-16, 1e-28, 1e-34])
def test_a_covariance_is_positive_and_weights_beyond_rounding_are_an_error(quiet):
    """Two residuals without noise beside 28 with: they alone would say three parameters."""
    variances = np.diag(np.where(np.arange(len(T)) < 2, quiet, 1.0))
    if quiet < 1e-20:
        with pytest.raises(np.linalg.LinAlgError):
            fit(problem(3)[0], TRUTH, variances)
        return
    found = fit(problem(3)[0], TRUTH, variances)
    np.testing.assert_array_equal(found.covariance, found.covariance.T)
    values = np.linalg.eigvalsh(found.covariance)
    assert values[0] > -1e-12 * values[-1] and np.all(np.diag(found.covariance) > 0)


def test_variances_are_those_of_independent_residuals():
    rng = np.random.default_rng(3)
    design, seen, variance = rng.normal(size=(20, 3)), rng.normal(size=20), rng.uniform(1, 9, 20)
    each = [fit(lambda x: (design @ x - seen, design), np.zeros(3), C)
            for C in (variance, np.diag(variance))]  # fmt: skip
    for name in ("x", "covariance", "white"):
        np.testing.assert_allclose(*(getattr(f, name) for f in each), rtol=1e-10)
