"""A fit made again for a part of the poses is the fit of that part."""

import numpy as np
import pytest

from calibrate.devices import recording
from diagnose.test_search import G_SENSITIVITY, models
from imuloop.diagnose.refit import refit
from imuloop.simulate.truth import example_truth


@pytest.mark.parametrize("effects", [(), (G_SENSITIVITY,)])
def test_it_is_the_fit_of_the_poses_that_are_kept(effects):
    truth = example_truth()
    made = recording(truth, 7)
    keep = np.arange(len(made.poses)) % 5 != 2
    for model in models(truth)[1:] if effects else models(truth):
        start = model.fit(made).fit.x
        solution, found = model.refit(made, keep, effects, start)
        whole = model.fit(made.select(keep), effects)
        std = np.sqrt(np.diag(found.fit.covariance))
        assert np.all(np.abs(solution.fit.x - whole.fit.x) < 2e-3 * std)
        assert solution.fit.chi2 == pytest.approx(whole.fit.chi2, rel=1e-4)
        np.testing.assert_allclose(solution.covariance, whole.covariance, rtol=1e-3, atol=1e-16)
        # the residuals of all poses, those that were held out too
        linear = model.linearise(solution, made)
        size = np.abs(linear.values).max()
        np.testing.assert_allclose(found.values, linear.values, atol=1e-5 * size)
        assert len(solution.fit.jacobian) == found.seen.sum() < len(found.values)


def test_masks_are_judged_as_the_poses_alone_are():
    truth = example_truth()
    made = recording(truth, 8)
    n = np.arange(len(made.poses))
    keeps = [n % 5 != 2, n < 12, n < 8, n < 4]
    for model in models(truth):
        alone = [model.untestable(made.select(keep)) is not None for keep in keeps]
        assert model.undetermined(made, keeps) == alone
        assert alone[0] is False and alone[-1] is True


def test_a_start_that_leads_nowhere_gives_none():
    def evaluate(x):
        return np.array([1.0, 2.0, x[0] ** 2 + 1]), np.array([[0.0], [0], [2 * x[0]]]), np.eye(3)

    assert refit(evaluate, np.ones(3, bool), np.array([0.3])) is None


def test_steps_that_grow_lead_nowhere():
    calls = []

    def evaluate(x):
        calls.append(x)
        # the root of arctan, from where Newton's steps diverge
        return np.arctan(x) * 1e3, np.diag(1e3 / (1 + x**2)), np.eye(1)

    assert refit(evaluate, np.ones(1, bool), np.array([1.5])) is None
    assert len(calls) == 2
    assert refit(evaluate, np.ones(1, bool), np.array([0.5])) is not None


@pytest.mark.parametrize("covariance", [-np.eye(2), np.full((2, 2), np.nan)])
def test_weights_that_are_none_lead_nowhere(covariance):
    def evaluate(x):
        return np.array([x[0], 1.0]), np.ones((2, 1)), covariance

    assert refit(evaluate, np.ones(2, bool), np.zeros(1)) is None
