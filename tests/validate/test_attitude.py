"""Validation by attitude: gravity's direction by integration, on stretches that no fit saw."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest

import imuloop.effects  # noqa: F401  the library of effects
from bench.study.chain import LIMITS
from calibrate.devices import difference, recording
from diagnose.models import pose_result as pose_results
from diagnose.test_search import MATRIX, with_g_sensitivity
from imuloop.core.rotation import step_vectors
from imuloop.core.samples import SENSORS
from imuloop.diagnose.diagnose import Diagnosed
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.model.calibration import Calibration
from imuloop.model.state import NAMES
from imuloop.simulate.truth import example_truth
from imuloop.validate.attitude import METHODS, Stretch, blocks, held_out_models, validate_attitude

SETTINGS = DiagnoseSettings()


def diagnose_poses(log):
    """Return the Diagnosed of poses by the noise of the example, whatever effects they hold."""
    with patch(LIMITS, return_value={}):
        poses = pose_results(example_truth(), log)
    calibration = Calibration("d", 9.80665, *(poses.calibrations.get(s) for s in SENSORS))
    return Diagnosed({}, calibration, {}, poses.problem.joint_fit.noise, poses, log, ["turns"], {})


def test_the_filter_has_gravity_where_a_quarter_turn_brings_it():
    """Axes, signs and the direction of the quaternion are as VQF has them: closed form."""
    t = np.arange(1100) / 100
    # 90 degrees about x from 5 s to 6 s: up goes from z to y
    phase = np.clip(t - 5, 0, 1)
    rate = np.pi / 2 * (1 - np.cos(2 * np.pi * phase))
    turned = np.pi / 2 * (phase - np.sin(2 * np.pi * phase) / (2 * np.pi))
    w = np.column_stack([rate, 0 * t, 0 * t])
    up = np.column_stack([0 * t, np.sin(turned), np.cos(turned)])
    stretch = Stretch(
        np.arange(2), t, slice(0, len(t)), np.array([0, 600]), np.array([500, len(t) - 1])
    )
    arguments = step_vectors(w, np.diff(t)), 9.8 * up, stretch, np.array([[0, 0, 1.0], [0, 1.0, 0]])
    alone, filtered = (np.degrees(METHODS[m](*arguments)) for m in ("rotation", "filter"))
    assert alone.max() < 0.1
    assert filtered.shape == (1, 2) and filtered.max() < 0.1


@pytest.fixture(scope="module")
def sensitive_device():
    log = recording(with_g_sensitivity(example_truth(), MATRIX), 1)
    diagnosed = diagnose_poses(log)
    return log, diagnosed, validate_attitude("d", diagnosed, SETTINGS)


@pytest.fixture(scope="module")
def plain_device():
    log = recording(example_truth(), 2)
    return log, diagnose_poses(log)


def test_the_error_falls_to_that_of_the_truth(sensitive_device):
    log, _, (content, table) = sensitive_device
    rotation = content["methods"]["rotation"]
    errors = {m: e["rms_deg"] for m, e in rotation["models"].items()}
    assert errors["raw"] > 3 * errors["base"]
    assert errors["base"] > 2 * errors["final"]
    assert 0.7 < errors["final"] / rotation["floor_deg"] < 1.4
    low, high = rotation["ratio_ci95"]
    assert low < rotation["base_over_final"] == pytest.approx(errors["base"] / errors["final"])
    assert low > 1.5 and high > rotation["base_over_final"]
    assert rotation["n"] == len(log.rotations)
    # with the filter too, though it learns a bias itself; its rows are of arrival and departure
    filtered = content["methods"]["filter"]
    errors = {m: e["rms_deg"] for m, e in filtered["models"].items()}
    assert errors["raw"] > 3 * errors["base"] and errors["base"] > 2 * errors["final"]
    assert filtered["ratio_ci95"][0] > 1.5
    assert set(table["method"]) == {"rotation", "filter"}
    drawn = table[(table["method"] == "filter") & (table["model"] == "final")]
    assert filtered["n"] == rotation["n"] == (drawn["at"] == "arrival").sum() == len(drawn) / 2
    arrivals = drawn[drawn["at"] == "arrival"]["error_deg"]
    assert errors["final"] == pytest.approx(np.sqrt((arrivals**2).mean()))


def test_models_do_not_see_what_they_are_judged_by(sensitive_device):
    log, diagnosed, _ = sensitive_device
    block = blocks(len(log.poses), SETTINGS)
    out = block == 1
    # with two others, by which effects are chosen without it
    parts = np.where(out, 1, 2 * (block % 2))
    # some fifty standard errors of a pose
    poses = replace(
        log.poses, w=log.poses.w + 0.004 * out[:, None], f=log.poses.f * (1 + 0.004 * out)[:, None]
    )
    touched = out[log.rotations.first] | out[log.rotations.first + 1]
    rotations = replace(log.rotations, w=log.rotations.w + 0.004 * touched[:, None, None])
    spoiled = replace(log, poses=poses, rotations=rotations)
    pair, models = diagnosed.poses.problem.joint_fit, []
    for log_of in (log, spoiled):
        problem = replace(diagnosed.poses.choices.problem, recording=log_of, _fits={}, _columns={})
        models.append(held_out_models(diagnosed, problem.with_folds(parts))[1])
    (effect,) = (e for e in diagnosed.poses.choices.choice().effects if e.name == "g_sensitivity")
    one, other = (log_of["final"] for log_of in models)
    # effects that a model lacks count as noise by all rows, so the base model's weights do too
    alone = pair.calibrations(pair.fit(log.select(~out), (effect,)))
    for sensor, names in NAMES.items():
        a, b = (getattr(log_of, sensor) for log_of in (one, other))
        assert [e.name for e in a.effects] == [e.name for e in b.effects]
        # their influence on the noise, and on the point of linearisation
        moved = difference(a, b, names) / [alone[sensor].std[p] for p in names]
        assert np.abs(moved).max() < 0.1


def test_without_an_effect_the_final_model_is_the_base_model(plain_device):
    content, table = validate_attitude("d", plain_device[1], SETTINGS)
    for method in content["methods"].values():
        assert method["models"]["base"] == method["models"]["final"]
        assert (method["base_over_final"], method["ratio_ci95"]) == (1, [1, 1])
    rotation = content["methods"]["rotation"]
    assert 0.7 < rotation["models"]["base"]["rms_deg"] / rotation["floor_deg"] < 1.4
    # near the noise with the filter too, once a rest has brought it back from its lag in the turn
    settled = table[(table["method"] == "filter") & (table["at"] == "departure")]
    filtered = settled.groupby("model")["error_deg"].apply(lambda e: np.sqrt(np.mean(e**2)))
    assert filtered["base"] < 4 * rotation["floor_deg"] and filtered["raw"] > 1


def test_without_the_package_of_the_filter_there_is_the_gyroscope_alone(plain_device, monkeypatch):
    """Not each Python and processor has a wheel of it: the rest of a device's results is there."""
    monkeypatch.delitem(METHODS, "filter")
    content, table = validate_attitude("d", plain_device[1], SETTINGS)
    assert content["status"] == "ok" and set(table["method"]) == {"rotation"}
    assert set(content["methods"]) == {"rotation"}


def test_too_few_poses_are_not_testable(plain_device):
    few = plain_device[0].select(np.arange(len(plain_device[0].poses)) < 11)
    content, table = validate_attitude("d", diagnose_poses(few), SETTINGS)
    assert content["status"] == "not_testable"
    assert "poses" in content["why"]
    assert not len(table["error_deg"])
