"""The least-squares fit against the standard library of the field, from near and from far."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import least_squares

from imuloop.estimate.least_squares import SINGULAR, NotConverged, fit, why_no_fit

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

    def linearise(x):
        value, jacobian = decay(x)
        return SimpleNamespace(residual=value - y, jacobian=jacobian)

    return linearise, root @ root.T


@pytest.mark.parametrize("start", [TRUTH, [30, 0.1, -20], [0.5, 4, 1]])
def test_the_minimum_is_that_of_scipy(start):
    linearise, covariance = problem(0)
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    theirs = least_squares(
        lambda x: whiten @ linearise(x).residual, TRUTH, xtol=1e-14, ftol=1e-14, gtol=1e-14
    )
    ours = fit(linearise, start, covariance)
    std = np.sqrt(np.diag(ours.covariance))
    np.testing.assert_allclose((ours.x - theirs.x) / std, 0, atol=1e-3)
    assert ours.chi2 == pytest.approx(2 * theirs.cost, rel=1e-8)
    assert ours.dof == len(T) - 3
    np.testing.assert_allclose(
        ours.covariance, np.linalg.inv(theirs.jac.T @ theirs.jac), rtol=1e-2, atol=1e-6
    )


def test_what_the_data_do_not_determine_is_an_error():
    def linearise(x):
        jacobian = np.column_stack([T, np.zeros(len(T))])
        return SimpleNamespace(residual=x[0] * T - T, jacobian=jacobian)

    for covariance in (np.eye(len(T)), -np.eye(len(T))):
        with pytest.raises(np.linalg.LinAlgError):
            fit(linearise, [0, 0], covariance)


def test_a_fit_that_ends_before_its_minimum_is_none_and_says_so():
    def linearise(x):
        value = np.exp(-x[0]) * np.ones(3)
        return SimpleNamespace(residual=value, jacobian=-value[:, None])

    with pytest.raises(NotConverged, match="does not converge in 200 steps") as raised:
        fit(linearise, [0.0], np.eye(3))
    assert why_no_fit(raised.value) == "the fit does not converge in 200 steps"
    assert why_no_fit(np.linalg.LinAlgError("singular")) == SINGULAR
