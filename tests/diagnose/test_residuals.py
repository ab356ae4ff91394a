"""Residuals and their floor."""

from dataclasses import replace

import numpy as np
import pytest

from calibrate.devices import ACCELERATION_UNIT, RATE_UNIT, known_noise, recording
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.effect import find_effect
from imuloop.diagnose.pose_models import AccelerometerPoses, GyroscopePoses
from imuloop.diagnose.residuals import held_out_variance, judge, size
from imuloop.diagnose.search import Search, floor_variance, folds, held_out
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.diagnose.verdict import above_floor, unseen
from imuloop.simulate.truth import example_truth


def test_a_linear_fit_has_its_textbook_degrees_of_freedom():
    rng = np.random.default_rng(0)
    design = rng.normal(size=(50, 4))
    root = rng.normal(size=(50, 50)) / 7
    covariance = root @ root.T + np.eye(50)
    noise = np.linalg.cholesky(covariance) @ rng.normal(size=50)
    weight = np.linalg.inv(covariance)
    parameters = np.linalg.inv(design.T @ weight @ design)
    left = noise - design @ (parameters @ design.T @ weight @ noise)
    judged = judge("m/s^2", left[:, None], covariance, design, parameters)
    assert judged.dof == pytest.approx(46)
    assert judged.reduced_chi2 * judged.dof == pytest.approx(left @ weight @ left)


def test_parts_of_a_fit_share_its_parameters():
    truth = example_truth()
    made = recording(truth, 2)
    force = AccelerometerPoses(
        known_noise(truth), truth.gravity, ACCELERATION_UNIT, CalibrateSettings()
    )
    solution = GyroscopePoses(force, None, (), RATE_UNIT).fit(made)
    total = sum(r.dof for r in solution.residuals.values())
    assert total == pytest.approx(3 * len(made.poses) + 2 * len(made.rotations) - 12, abs=1e-6)


def test_weights_that_moved_with_the_last_step_cost_no_degree_of_freedom():
    truth = example_truth()
    made, settings = recording(truth, 2), CalibrateSettings()
    force = AccelerometerPoses(known_noise(truth), truth.gravity, ACCELERATION_UNIT, settings)
    solution = force.fit(made)
    moved = replace(solution, covariance=solution.covariance / 100)
    (left,) = moved.residuals.values()
    assert left.dof == pytest.approx(len(made.poses) - 9)


def test_the_variance_of_held_out_errors_is_that_of_simulated_ones():
    rng = np.random.default_rng(4)
    t = np.arange(40.0)
    # white noise, and slow noise with a common part much larger than what is left of it
    covariance = np.eye(40) + 200 * np.exp(-np.abs(t[:, None] - t) / 80)
    design = np.column_stack([np.ones(40), rng.normal(size=40)])
    held = (t >= 12) & (t < 20)
    seen = ~held & (t != 20)
    predicted = held_out_variance(covariance, design, seen, held)
    drawn = np.linalg.cholesky(covariance) @ rng.normal(size=(40, 20000))
    weight = np.linalg.inv(covariance[np.ix_(seen, seen)])
    normal = design[seen].T @ weight
    fitted = np.linalg.solve(normal @ design[seen], normal @ drawn[seen])
    errors = drawn[held] - design[held] @ fitted
    np.testing.assert_allclose(predicted, errors.var(axis=1), rtol=0.05)
    assert predicted.max() < 60


def test_held_out_errors_of_a_good_model_are_at_their_floor():
    truth = example_truth()
    force = AccelerometerPoses(
        known_noise(truth), truth.gravity, ACCELERATION_UNIT, CalibrateSettings()
    )
    turn = GyroscopePoses(force, None, (), RATE_UNIT)
    settings = DiagnoseSettings(folds=5)
    ratios = {"gravity_norm": [], "pose_rate": [], "rotation": []}
    for seed in range(8):
        made = recording(truth, seed)
        for model in (force, turn):
            everything = np.ones(len(made.poses), dtype=bool)
            whole = Search(model, made, everything, {}, settings, 1).step()
            parts = folds([model] * settings.folds, made, {}, settings, 1)
            errors = [part.errors() for part in parts]
            variance = floor_variance(whole, parts)
            for kind, h in held_out(errors, errors).items():
                ratios[kind].append(size(h.before) / size(np.sqrt(variance[kind])))
    for kind, values in ratios.items():
        assert np.mean(values) == pytest.approx(1, abs=0.12), kind


@pytest.mark.parametrize(
    ("in_sample", "heldout", "interval", "above"),
    [
        (False, 0.9, (0.8, 1.0), False),
        (True, 0.9, (0.8, 1.0), False),  # patterns in what is smaller than the noise
        (True, 1.1, (0.9, 1.3), True),
        (False, 1.1, (1.02, 1.2), False),  # within what an interval of few parts may be wrong by
        (False, 1.7, (1.2, 2.4), True),  # a wrong effect, which fits what it saw
        (False, 1.7, (0.8, 3.0), False),
    ],
)
def test_a_residual_is_above_its_floor_in_the_fit_and_held_out(in_sample, heldout, interval, above):
    assert above_floor(in_sample, heldout, 1.0, interval) == above


def test_data_that_show_an_effect_beyond_all_physics_alone_cannot_show_it():
    effect = find_effect("vibration_rectification")
    assert "0.002 is the most possible" in unseen(effect, dict.fromkeys("xyz", 6.0))
    assert unseen(effect, {"vx": 6.0, "vy": 1e-3, "vz": 6.0}) is None
    assert unseen(find_effect("bias_drift"), {"dx": 1e9}) is None
