"""A fit of a part of the poses, linear about the fit of all, is the fit of that part."""

from dataclasses import replace

import numpy as np
import pytest

from calibrate.devices import recording
from diagnose.models import pose_sensors
from diagnose.test_search import G_SENSITIVITY, MATRIX, problem_of, with_g_sensitivity
from imuloop.calibrate.pose_fits import residuals
from imuloop.core.effect import find_effect
from imuloop.diagnose.choice import Choices
from imuloop.simulate.truth import example_truth


@pytest.mark.parametrize(
    ("sensor", "effects"),
    [("accelerometer", ()), ("gyroscope", ()), ("gyroscope", (G_SENSITIVITY,))],
)
def test_it_is_the_fit_of_the_poses_that_are_kept(sensor, effects, monkeypatch):
    # by the same noise: that which the noise stage estimated
    as_estimated = "imuloop.diagnose.records.poses.likely_sizes"
    monkeypatch.setattr(
        as_estimated, lambda v, j, f, parts, *more: np.array([p.size for p in parts])
    )
    truth = with_g_sensitivity(example_truth(), MATRIX) if effects else example_truth()
    made = recording(truth, 7)
    model = pose_sensors(truth, made)[sensor]
    problem = problem_of(model, made, parts=5)
    problem.about(effects)
    for part in range(5):
        out = frozenset({part})
        solution = problem.fitted(effects, out)
        alone = model.fit(made.select(problem.fold_of_pose != part), effects)
        std = np.sqrt(np.diag(alone.fit.covariance))
        assert np.all(np.abs(solution.fit.x - alone.fit.x) < 2e-3 * std)
        assert solution.effects == effects
        # the residuals of all poses, those that were held out too
        values, _ = residuals(model.model(alone, made), alone.fit.x)
        left = problem.left(Choices(problem).search(out), effects)[:, 0]
        std = np.sqrt(np.diag(problem.about(effects).alternatives[0][1]))
        assert np.abs((left + values) / std).max() < 2e-3


def test_an_effect_that_one_part_alone_chose_is_fitted_about_the_fit_without():
    truth = with_g_sensitivity(example_truth(), MATRIX)
    made = recording(truth, 7)
    model = pose_sensors(truth, made)["gyroscope"]
    problem = problem_of(model, made, parts=5)
    for part in range(5):
        solution = problem.fitted((G_SENSITIVITY,), frozenset({part}))
        alone = model.fit(made.select(problem.fold_of_pose != part), (G_SENSITIVITY,)).fit
        std = np.sqrt(np.diag(alone.covariance))
        # as good as the same: a tenth of a standard error
        assert np.all(np.abs(solution.fit.x - alone.x) < 0.1 * std)
    assert list(problem._about) == [()]


def test_what_a_part_does_not_show_is_nothing_there():
    truth = example_truth()
    made = recording(truth, 7)
    # the second run is the poses of one part
    run = (np.arange(len(made.poses)) % 5 == 2).astype(int)
    made = replace(made, poses=replace(made.poses, run=run))
    jump = find_effect("turn_on_bias")(2)
    model = pose_sensors(truth, made)["accelerometer"]
    problem = problem_of(model, made, {type(jump): (jump,)}, parts=5)
    plain, solution = (problem.fitted(base, frozenset({2})) for base in ((), (jump,)))
    np.testing.assert_array_equal(solution.fit.x, [*plain.fit.x, 0, 0, 0])


def test_masks_are_judged_as_the_poses_alone_are():
    truth = example_truth()
    made = recording(truth, 8)
    n = np.arange(len(made.poses))
    keeps = [n % 5 != 2, n < 12, n < 8, n < 4]
    for model in pose_sensors(truth, made).values():
        alone = [model.untestable(made.select(keep)) is not None for keep in keeps]
        assert model.undetermined(made, keeps) == alone
        assert alone[0] is False and alone[-1] is True
