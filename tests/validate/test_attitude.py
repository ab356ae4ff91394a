"""Validation by attitude: what carries gravity's direction, and on stretches that nobody saw."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import imuloop.effects  # noqa: F401  the library of effects
from calibrate.devices import difference, recording
from diagnose.models import pose_sensors
from diagnose.test_search import G_SENSITIVITY, MATRIX, with_g_sensitivity
from imuloop.core.rotation import matrix
from imuloop.diagnose.diagnose import Diagnosed
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.simulate.truth import example_truth
from imuloop.validate.attitude import validate_attitude
from imuloop.validate.attitude_errors import (
    K_I,
    K_P,
    Stretch,
    angle,
    attitudes,
    filter_errors,
    gyroscope_errors,
    stretches,
)
from imuloop.validate.attitude_models import blocks, held_out_models

SETTINGS = DiagnoseSettings()
NOTHING = {"accelerometer": (), "gyroscope": ()}
FOUND = {"accelerometer": (), "gyroscope": (G_SENSITIVITY,)}
# of what other records tell
TOLD = dict.fromkeys(NOTHING, ((), None))


def diagnosed(sensors, made, whole, effects=NOTHING):
    solutions = {"gyroscope": whole}
    return Diagnosed({}, None, {}, sensors, made, solutions, effects, TOLD, ["turns"], 20, {})


def validated(*given):
    return validate_attitude("d", 9.80665, diagnosed(*given), SETTINGS)


def course(turns=3, rate=100.0, seed=0):
    """Return a stretch of rests of 2 s and turns of 3 s, its rates and gravity at all samples."""
    rng = np.random.default_rng(seed)
    w, arrive, leave = [np.zeros((200, 3))], [0], [199]
    for _ in range(turns):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        w.append(np.outer(np.sin(np.linspace(0, np.pi, 300)) ** 2, axis))
        arrive.append(leave[-1] + 301)
        leave.append(arrive[-1] + 199)
        w.append(np.zeros((200, 3)))
    w = np.concatenate(w)
    t = np.arange(len(w)) / rate
    stretch = Stretch(np.arange(turns + 1), t, slice(0, len(t)), np.array(arrive), np.array(leave))
    C = matrix(attitudes(w, t))
    g = np.einsum("kji,j->ki", C, np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8]))
    return stretch, w, g


def test_the_gyroscope_carries_gravity_as_scipy_does():
    stretch, w, g = course()
    fine = Rotation.identity()
    for k in range(len(w) - 1):
        fine = fine * Rotation.from_rotvec((w[k] + w[k + 1]) / 2 * 0.01)
    assert np.allclose(fine.inv().apply(g[0]), g[-1], atol=1e-6)
    once, through = gyroscope_errors(attitudes(w, stretch.t), stretch, g[stretch.arrive])
    assert once.max() < 1e-9
    assert through.max() < 1e-9


def test_the_filter_is_that_of_the_article():
    stretch, w, g = course()
    rng = np.random.default_rng(1)
    w, f = w + np.array([0.02, -0.01, 0.03]), 9.8 * g + rng.normal(0, 0.3, g.shape)
    run = attitudes(w, stretch.t)[None], f[None], stretch, g[stretch.arrive]
    found = filter_errors([run])[0][0]
    # the quaternion form, sample by sample
    start = Rotation.align_vectors([[0, 0, 1.0]], f[1:2] / np.linalg.norm(f[1]))[0]
    bias, expected = np.zeros(3), []
    for k in range(len(w) - 1):
        a = f[k + 1] / np.linalg.norm(f[k + 1])
        v = start.inv().apply([0, 0, 1.0])
        sigma = np.cross(a, v)
        bias -= K_I * 0.01 * sigma
        rate = (w[k] + w[k + 1]) / 2 - bias + K_P * sigma
        start = start * Rotation.from_rotvec(0.01 * rate)
        expected.append(start.inv().apply([0, 0, 1.0]))
    at = np.column_stack([stretch.arrive, stretch.leave])[1:] - 1
    wanted = angle(np.array(expected)[at], g[stretch.arrive][1:, None])
    assert found == pytest.approx(wanted, abs=3e-3) and found.max() > 0.01


def test_a_stretch_in_which_the_accelerometer_was_not_read_corrects_nothing():
    stretch, w, g = course()
    unread = 9.8 * g
    unread[600:650] = 0.0
    q = attitudes(w, stretch.t)[None]
    given = g[stretch.arrive]
    errors = filter_errors([(q, f[None], stretch, given) for f in (9.8 * g, unread)])
    assert errors[1] == pytest.approx(errors[0], abs=1e-3)


@pytest.fixture(scope="module")
def sensitive():
    made = recording(with_g_sensitivity(example_truth(), MATRIX), 1)
    sensors = pose_sensors(example_truth(), made)
    whole = sensors["gyroscope"].fit(made, FOUND["gyroscope"])
    return made, sensors, validated(sensors, made, whole, FOUND)


def test_each_rotation_is_in_one_stretch_of_its_block(sensitive):
    made, _, _ = sensitive
    block = blocks(len(made.poses), SETTINGS)
    found = stretches(made, block)
    firsts = np.concatenate([s.poses[:-1] for s in found])
    assert (firsts == made.rotations.first).all()
    assert all(len(set(block[s.poses[:-1]])) == 1 for s in found)
    for s in found:
        assert s.t[s.leave] == pytest.approx(made.poses.end_s[s.poses], abs=0.011)


def test_the_error_falls_to_that_of_the_truth(sensitive):
    made, _, (content, table) = sensitive
    rotation = content["methods"]["rotation"]
    errors = {m: e["rms_deg"] for m, e in rotation["models"].items()}
    assert errors["raw"] > 3 * errors["base"]
    assert errors["base"] > 2 * errors["final"]
    assert 0.7 < errors["final"] / rotation["floor_deg"] < 1.4
    low, high = rotation["ratio_ci95"]
    assert low < rotation["base_over_final"] == pytest.approx(errors["base"] / errors["final"])
    assert low > 1.5 and high > rotation["base_over_final"]
    assert rotation["n"] == len(made.rotations)
    assert all("g_sensitivity" in e["gyroscope"] for e in content["effects"])
    assert set(table["method"]) == {"rotation", "stretch", "mahony"}
    # through a stretch the error counts at its end
    drawn = table[(table["method"] == "stretch") & (table["model"] == "final")]
    ends = drawn[drawn["at"] == "arrival"].groupby("stretch")["error_deg"].last()
    stretch = content["methods"]["stretch"]
    assert stretch["n"] == len(ends) < rotation["n"]
    assert stretch["models"]["final"]["rms_deg"] == pytest.approx(np.sqrt((ends**2).mean()))


def test_models_do_not_see_what_they_are_judged_by(sensitive):
    made, sensors, _ = sensitive
    block = blocks(len(made.poses), SETTINGS)
    held = block == 1
    # some fifty standard errors of a pose
    poses = replace(
        made.poses,
        w=made.poses.w + 0.004 * held[:, None],
        f=made.poses.f * (1 + 0.004 * held)[:, None],
    )
    touched = held[made.rotations.first] | held[made.rotations.first + 1]
    rotations = replace(made.rotations, w=made.rotations.w + 0.004 * touched[:, None, None])
    spoiled = replace(made, poses=poses, rotations=rotations)
    one, other = (
        held_out_models(diagnosed(sensors, m, None, FOUND), block, 9.80665, SETTINGS)[1]
        for m in (made, spoiled)
    )
    for sensor, model in sensors.items():
        for name, effects in (("raw", ()), ("base", ()), ("final", FOUND[sensor])):
            a, b = (getattr(m[name], sensor) for m in (one, other))
            assert [e.name for e in a.effects] == [e.name for e in b.effects]
            fit = model.fit(made.select(~held), effects).fit
            std = dict(zip(model.names, np.sqrt(np.diag(fit.scaled_covariance)), strict=False))
            # what they say of the noise, and where the fit is linear about
            moved = difference(a, b, model.names) / [std[p] for p in model.names]
            assert np.abs(moved).max() < 0.1


def test_without_an_effect_the_final_model_is_the_base_model():
    made = recording(example_truth(), 2)
    sensors = pose_sensors(example_truth(), made)
    content, _ = validated(sensors, made, sensors["gyroscope"].fit(made))
    for method in content["methods"].values():
        assert method["models"]["base"] == method["models"]["final"]
        assert (method["base_over_final"], method["ratio_ci95"]) == (1, [1, 1])
    rotation = content["methods"]["rotation"]
    assert 0.7 < rotation["models"]["base"]["rms_deg"] / rotation["floor_deg"] < 1.4


def test_too_few_poses_are_not_testable():
    made = recording(example_truth(), 2)
    sensors = pose_sensors(example_truth(), made)
    few = made.select(np.arange(len(made.poses)) < 11)
    content, table = validated(sensors, few, sensors["gyroscope"].fit(few))
    assert content["status"] == "not_testable"
    assert "poses" in content["why"]
    assert not len(table["error_deg"])
