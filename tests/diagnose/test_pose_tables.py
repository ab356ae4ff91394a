"""The tables of poses and moves: their rows, what was measured, and the errors that are left."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from calibrate.devices import ACCELERATION_UNIT, RATE_UNIT, recording
from diagnose.models import pose_sensors
from imuloop.calibrate.force import calibrated_force
from imuloop.calibrate.recording import record
from imuloop.core.effect import FittedEffect
from imuloop.core.model import SensorCalibration
from imuloop.core.samples import CHANNELS
from imuloop.core.segments import segment_table
from imuloop.core.units import DEGREE
from imuloop.diagnose.records.pose_diagnosis import diagnose_poses
from imuloop.diagnose.records.pose_tables import moves_table, no_tables, poses_table
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.effects.g_sensitivity import GSensitivity
from imuloop.simulate.truth import example_truth

RATE, G = 100.0, 9.8
SETTINGS = DiagnoseSettings(folds=3, draws=100)
# the gyroscope that logs what `session` turns: scale, bias and what acceleration adds
K, B, GAIN = np.array([1.02, 0.97, 1.01]), np.array([0.02, -0.01, 0.03]), 2e-3


def session(turns, warm=True):
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
    if warm:
        samples["temperature"] = 20 + t / 10
    n = len(turns)
    kinds = ["static", "motion"] * n + ["static"]
    poses = [k // 2 if k % 2 == 0 else -1 for k in range(2 * n + 1)]
    return samples, segment_table(samples, edges, [*edges[1:], t[-1] + 1 / RATE], kinds, poses)


def moves(made, names, residuals):
    """Return the table of moves of the gyroscope that logged them."""
    gain = {f"G{i}{j}": GAIN * (i == j) for i in range(3) for j in range(3)}
    effect = FittedEffect(GSensitivity(), gain, dict.fromkeys(gain, 0.0))
    force = calibrated_force(SensorCalibration.nominal(ACCELERATION_UNIT, ""), made, None)
    turn = SensorCalibration(RATE_UNIT, np.eye(3), K, B, (), None, (effect,))
    return moves_table(made, names, turn, force, residuals)


@pytest.fixture(scope="module")
def two():
    """A recording of two sessions, of three and two poses."""
    slanted = np.array([0.0, 0.6, 0.8])
    logs = [session([((0, 0, 1), 90), ((1, 0, 0), -40)]), session([(slanted, 200)])]
    return record(*zip(*logs, strict=True), 30.0)


def test_a_row_a_pose_with_its_session_and_what_was_measured(two):
    table = poses_table(two.poses, ["morning", "evening"], {})
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


def test_no_temperature_is_no_number():
    cold = record(*zip(session([((0, 0, 1), 90)], warm=False), strict=True), 30.0)
    assert np.isnan(poses_table(cold.poses, ["s"], {})["temperature"]).all()


def test_a_move_is_told_by_the_turn_that_was_made(two):
    table = moves(two, ["morning", "evening"], {})
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


def test_without_a_pose_the_columns_are_the_same(two):
    full = {
        "poses": poses_table(two.poses, ["morning", "evening"], {}),
        "moves": moves(two, ["morning", "evening"], {}),
    }
    for name, table in no_tables().items():
        assert {n: x.dtype for n, x in table.items()} == {n: x.dtype for n, x in full[name].items()}
        assert not any(map(len, table.values()))


@pytest.fixture(scope="module")
def diagnosed():
    """Both sensors of a device whose gyroscope is g-sensitive, diagnosed."""
    truth = example_truth()
    plan = replace(truth.sessions["multi_position"], poses=20)
    truth = replace(truth, sessions={"multi_position": plan})
    made = recording(truth, 1)
    gain = 4e-4 * np.array([[1, 0.2, 0], [0, -1, 0], [0.3, 0, 1]])
    w = made.poses.w + made.poses.f @ gain.T
    along = made.rotations.w + made.rotations.f @ gain.T
    made = replace(made, poses=replace(made.poses, w=w), rotations=replace(made.rotations, w=along))
    sensors = pose_sensors(truth, made)
    results = {name: diagnose_poses(own, made, SETTINGS) for name, own in sensors.items()}
    return made, sensors, results


def test_the_errors_of_the_table_are_those_of_the_diagnosis(diagnosed):
    made, _, results = diagnosed
    assert [type(e).name for e in results["gyroscope"].effects] == ["g_sensitivity"]
    errors = results["accelerometer"].residuals | results["gyroscope"].residuals
    tables = (
        poses_table(made.poses, ["s"], errors),
        moves(made, ["s"], errors),
    )
    told = results["accelerometer"].content["residuals"] | results["gyroscope"].content["residuals"]
    assert set(told) == {"gravity_norm", "pose_rate", "rotation"}
    for kind, residual in told.items():
        table = tables[kind == "rotation"]
        for when in ("before", "after", "in_sample_before", "in_sample_after", "floor"):
            values = table[f"{kind}_{when}"]
            assert np.sqrt(np.mean(values**2)) == pytest.approx(residual[when], rel=1e-9)
            parts = [table[n] for n in table if n.startswith(f"{kind}_{when}_")]
            if parts:
                np.testing.assert_allclose(np.linalg.norm(parts, axis=0), values)
        assert residual["n"] == len(values)


def test_the_sign_of_an_error_is_what_is_left(diagnosed):
    made, sensors, results = diagnosed
    table = poses_table(
        made.poses, ["s"], results["accelerometer"].residuals | results["gyroscope"].residuals
    )
    force, turn = sensors["accelerometer"], results["gyroscope"]
    # too large a norm is above zero, in the fit and held out
    fitted = results["accelerometer"].solution.calibration
    left = np.linalg.norm(fitted.apply(made.poses.f), axis=1) - force.gravity
    np.testing.assert_allclose(table["gravity_norm_in_sample_after"], left, atol=1e-9)
    assert np.corrcoef(table["gravity_norm_after"], left)[0, 1] > 0.5
    # a rate that the model lacks, with its sign: without effects g-sensitivity is all of it
    rate = np.column_stack([table[f"pose_rate_before_{x}"] for x in "xyz"])
    effect = turn.solution.calibration.effects[0]
    channels = made.pose_channels("gyroscope", turn.solution.calibration.output, made.poses.f)
    added = effect.output(channels)
    assert np.corrcoef((rate - rate.mean(0)).ravel(), (added - added.mean(0)).ravel())[0, 1] > 0.9
