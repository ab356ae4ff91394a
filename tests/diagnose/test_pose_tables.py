"""The tables of poses and moves: their rows, measured values, and remaining errors."""

import numpy as np
import pandas as pd
import pytest

from calibrate.devices import RATE_UNIT, plan_session, recording
from diagnose.models import pose_result
from diagnose.test_search import with_g_sensitivity
from imuloop.calibrate.recording import record
from imuloop.core.samples import CHANNELS
from imuloop.core.segments import segment_table
from imuloop.core.units import DEGREE
from imuloop.diagnose.tables import moves_table, no_tables, poses_table
from imuloop.effects.other_sensor import GSensitivity
from imuloop.model.effect import FittedEffect
from imuloop.model.sensor_calibration import SensorCalibration
from imuloop.simulate.truth import example_truth

RATE, G = 100.0, 9.8
# the gyroscope that logs what `session` turns: scale, bias and what acceleration adds
K, B, GAIN = np.array([1.02, 0.97, 1.01]), np.array([0.02, -0.01, 0.03]), 2e-3
NAMES = ["morning", "evening"]


def session(turns):
    """Return samples and segments of rests of 8 s and turns of 2 s: (axis, degrees) each."""
    t = np.arange(0, 10 * len(turns) + 8, 1 / RATE)
    rate, edges = np.zeros((len(t), 3)), [0.0]
    for k, (axis, angle) in enumerate(turns):
        start = 10 * k + 8
        inside = (t >= start) & (t <= start + 2)
        bump = (1 - np.cos(np.pi * (t[inside] - start))) / 2
        rate[inside] += angle * DEGREE * bump[:, None] * np.asarray(axis, float)
        edges += [start, start + 2 + 1 / RATE]
    force = np.tile([0.0, 0.0, G], (len(t), 1))
    logged = (rate + GAIN * force) / K + B
    samples = pd.DataFrame(np.column_stack([t, force, logged]), columns=["t", *CHANNELS])
    samples["temperature"] = 20 + t / 10
    n = len(turns)
    kinds = ["static", "motion"] * n + ["static"]
    poses = [k // 2 if k % 2 == 0 else -1 for k in range(2 * n + 1)]
    return samples, segment_table(samples, edges, [*edges[1:], t[-1] + 1 / RATE], kinds, poses)


def moves(made, names, residuals):
    gain = {f"G{i}{j}": GAIN * (i == j) for i in range(3) for j in range(3)}
    effect = FittedEffect(GSensitivity(), gain, dict.fromkeys(gain, 0.0))
    turn = SensorCalibration(RATE_UNIT, np.eye(3), K, B, (), None, (effect,))
    return moves_table(made, names, turn, made.rotations.f, residuals)


@pytest.fixture(scope="module")
def two_sessions():
    slanted = np.array([0.0, 0.6, 0.8])
    logs = [session([((0, 0, 1), 90), ((1, 0, 0), -40)]), session([(slanted, 200)])]
    return record(*zip(*logs, strict=True), 30.0)


def test_a_row_per_pose_with_its_session_and_what_was_measured(two_sessions):
    table = poses_table(two_sessions.poses, NAMES, {})
    assert table["session"].tolist() == ["morning"] * 3 + ["evening"] * 2
    assert table["pose"].tolist() == [0, 1, 2, 0, 1]
    np.testing.assert_allclose(table["start_s"], [0, 10.01, 20.01, 0, 10.01])
    np.testing.assert_allclose(table["end_s"], [8, 18, 28, 8, 18])
    np.testing.assert_allclose(table["az"], G)
    np.testing.assert_allclose(table["gz"], GAIN * G / K[2] + B[2])
    np.testing.assert_allclose(
        table["temperature"], 20 + (table["start_s"] + table["end_s"]) / 20, atol=2e-3
    )
    assert np.isnan(table["gravity_norm_after"]).all() and np.isnan(table["pose_rate_floor"]).all()


def test_a_move_has_the_angle_speed_and_axis_of_the_turn_that_was_made(two_sessions):
    table = moves(two_sessions, NAMES, {})
    assert table["session"].tolist() == ["morning", "morning", "evening"]
    # the pose that it starts from
    assert table["pose"].tolist() == [0, 1, 0]
    np.testing.assert_allclose(table["angle_rad"] / DEGREE, [90, 40, 200], rtol=1e-4)
    np.testing.assert_allclose(table["speed_rad_s"] / DEGREE, [90, 40, 200], rtol=1e-4)
    axis = np.column_stack([table[f"axis_{x}"] for x in "xyz"])
    np.testing.assert_allclose(axis, [[0, 0, 1], [-1, 0, 0], [0, 0.6, 0.8]], atol=1e-4)
    # from the last sample at rest to the first
    np.testing.assert_allclose(table["start_s"], [7.99, 17.99, 7.99])
    np.testing.assert_allclose(table["end_s"], [10.01, 20.01, 10.01])


def test_without_a_pose_the_columns_are_the_same(two_sessions):
    full = {
        "poses": poses_table(two_sessions.poses, NAMES, {}),
        "moves": moves(two_sessions, NAMES, {}),
    }
    for name, table in ((name, no_tables()[name]) for name in full):
        assert {n: x.dtype for n, x in table.items()} == {n: x.dtype for n, x in full[name].items()}
        assert not any(map(len, table.values()))


def test_the_errors_of_the_tables_are_those_of_the_diagnosis(no_limits):
    truth = with_g_sensitivity(plan_session(example_truth(), poses=20), np.eye(3) * 4e-4)
    made = recording(truth, 1)
    found = pose_result(truth, made, folds=3)
    assert [e.name for e in found.solution.effects] == ["g_sensitivity"]
    tables = poses_table(made.poses, ["s"], found.residuals), moves(made, ["s"], found.residuals)
    content = {k: r for own in found.contents.values() for k, r in own["residuals"].items()}
    assert set(content) == {"gravity_norm", "pose_rate", "rotation"}
    for kind, residual in content.items():
        table = tables[kind == "rotation"]
        for when in ("before", "after", "in_sample_before", "in_sample_after", "floor"):
            values = table[f"{kind}_{when}"]
            assert np.sqrt(np.mean(values**2)) == pytest.approx(residual[when], rel=1e-9)
            parts = [table[n] for n in table if n.startswith(f"{kind}_{when}_")]
            if parts:
                np.testing.assert_allclose(np.linalg.norm(parts, axis=0), values)
        assert residual["n"] == len(values)
    # too large a norm is above zero
    calibrated = found.calibrations["accelerometer"].apply(made.poses.f)
    left = np.linalg.norm(calibrated, axis=1) - truth.gravity
    np.testing.assert_allclose(tables[0]["gravity_norm_in_sample_after"], left, atol=1e-9)
