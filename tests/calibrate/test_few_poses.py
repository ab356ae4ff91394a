"""Few poses: all that was measured is used, the rest is the data sheet's and named."""

from functools import cache

import numpy as np
import pytest

from bench.realistic.plain import fit_accelerometer
from calibrate.devices import (
    UNKNOWN_NOISE,
    at_rest,
    calibrate_recording,
    known_noise,
    recording,
    true_parameters,
)
from imuloop.model.prior_remarks import remarks
from imuloop.simulate.truth import example_truth

TRUTH = example_truth()
NOISE = known_noise(TRUTH)
SEEDS = range(6)
ATTITUDES = np.random.default_rng(0).normal(size=(200, 3))
UP = TRUTH.gravity * ATTITUDES / np.linalg.norm(ATTITUDES, axis=1)[:, None]


@cache
def whole_recording(seed):
    return recording(TRUTH, seed)


def poses(seed, count):
    """Return the first poses of a simulated recording and the turns between them."""
    recording_of_all = whole_recording(6300 + seed)
    return recording_of_all.select(np.arange(len(recording_of_all.poses)) < count)


def error(calibration):
    """Return the root-mean-square error of specific force over attitudes that no fit saw, m/s²."""
    true = TRUTH.accelerometer
    raw = UP @ np.linalg.inv(true.T).T / true.K + true.b
    return np.sqrt(np.mean(np.sum((calibration.aligned(raw) - UP) ** 2, axis=1)))


def plain_error(recording):
    """Return the calibration's error by the plain fit of the accelerometer with the same prior."""
    fit = fit_accelerometer(recording.poses.f, prior=True)
    true = TRUTH.accelerometer
    raw = UP @ np.linalg.inv(true.T).T / true.K + true.b
    return np.sqrt(np.mean(np.sum((fit.corrected(raw) - UP) ** 2, axis=1)))


@pytest.mark.parametrize(("count", "most"), [(1, 1.05), (2, 1.05), (4, 1.05), (6, 0.6), (8, 0.3)])
def test_no_number_of_poses_is_refused_and_turns_help(count, most):
    ratios = []
    for seed in SEEDS:
        recording = poses(seed, count)
        force, turn = calibrate_recording(recording, NOISE, TRUTH.gravity)
        assert force.method == turn.method == "multi_position"
        assert force.not_testable is turn.not_testable is None
        ratios.append(error(force) / plain_error(recording))
    assert np.median(ratios) <= most


def test_intervals_cover_the_truth_however_few_poses_there_are():
    true, scores = true_parameters(TRUTH), []
    for seed in SEEDS:
        for count in (1, 4, 8):
            for sensor, part in zip(
                calibrate_recording(poses(seed, count), NOISE, TRUTH.gravity),
                (true[:9], true[9:]),
                strict=True,
            ):
                values = [sensor.T[int(n[1]), int(n[2])] for n in sensor.names if n[0] == "T"]
                values = np.concatenate([values, sensor.K, sensor.b])
                scores.append((values - part) / np.sqrt(np.diag(sensor.covariance)))
    inside = np.mean(np.abs(np.concatenate(scores)) < 1.96)
    assert 0.92 < inside < 0.99


LEVEL = np.array([[1.0, 1.0, 0.0], [1.0, -1.0, 0.0]]) / np.sqrt(2)
FACES = np.vstack([np.eye(3), -np.eye(3)])
BETWEEN = np.array([[1.0, 0, 1], [-1, 0, 1], [0, 1, 1], [0, -1, 1]]) / np.sqrt(2)
SPREAD = ATTITUDES[:40] / np.linalg.norm(ATTITUDES[:40], axis=1)[:, None]


@pytest.mark.parametrize(
    ("attitudes", "named", "of_data_sheet"),
    [
        (
            FACES,
            "No pose lies between x and y, x and z and y and z: misalignment xy, xz and yz",
            "T01 T02 T12",
        ),
        (
            np.vstack([FACES, BETWEEN]),
            "No pose lies between x and y: misalignment xy is the data",
            "T01",
        ),
        (
            FACES[[0, 1, 3, 4]],
            "Too few poses: misalignment xy, xz and yz, scale factor z and bias",
            "T01 T02 T12 K2 b2",
        ),
        (FACES[[2, 5] * 10], "Too few poses", "T01 T02 T12 K0 K1 b0 b1"),
        (SPREAD[:1], "Too few poses", "T01 T02 T12 K0 K1 K2 b0 b1"),
        (np.vstack([FACES, BETWEEN, LEVEL]), None, ""),
        (SPREAD, None, ""),
    ],
)
def test_what_the_poses_did_not_show_is_named_with_the_poses_to_add(
    attitudes, named, of_data_sheet
):
    force, _ = calibrate_recording(at_rest(9.80665 * attitudes, 1e-3), UNKNOWN_NOISE, 9.80665)
    assert (force.method, force.not_testable) == ("multi_position", None)
    lines = remarks("accelerometer", force)
    assert lines == [] if named is None else lines[0].startswith(named)
    assert force.unimproved == tuple(of_data_sheet.split())
    listed = {row[0] for row in force.parameters("accelerometer") if row[4] == "data sheet"}
    assert listed == set(force.unimproved)


@pytest.mark.parametrize("unit", [1.0, 9.8])
def test_poses_that_contradict_each_other_are_refused(unit):
    f, k = 9.80665 * SPREAD[:30], np.arange(30)
    for offset, reason in (
        (0 * k, ""),
        (k > 15, "the accelerometer changed at about 157.5 s"),
        (k % 2, "its poses contradict each other"),
    ):
        recording = at_rest((f + 5.0 * offset[:, None]) / unit, 1e-4 / unit)
        force, _ = calibrate_recording(recording, UNKNOWN_NOISE, 9.80665)
        assert reason in (force.not_testable or "")
        assert force.method == ("nominal" if reason else "multi_position")


def test_poses_without_noise_weigh_no_more_than_their_residual():
    """Three poses of a deaf channel and 13 others; measured of 14 poses of a fuzzed log."""
    f = 9.80665 * SPREAD[:16] + np.random.default_rng(1).normal(0, 0.1, (16, 3))
    recording = at_rest(f, np.where(np.arange(16) < 3, 1e-17, 1e-3))
    force, _ = calibrate_recording(recording, UNKNOWN_NOISE, 9.80665)
    off = np.concatenate([force.T[np.triu_indices(3, 1)], force.K - 1, force.b])
    assert np.abs(off / [*force.std.values()]).max() < 3.5


def test_a_board_with_half_a_g_of_offset_is_calibrated_and_reported():
    f = 9.80665 * UP[:20] / TRUTH.gravity + [0.0, 0.0, 0.5 * 9.80665]
    force, _ = calibrate_recording(at_rest(f, 1e-3), UNKNOWN_NOISE, 9.80665)
    assert force.not_testable is None
    np.testing.assert_allclose(force.b, [0, 0, 0.5 * 9.80665], atol=0.02)
    assert [*force.far_off] == ["b2"]
    (remark,) = remarks("accelerometer", force)
    assert "bias z (9.8 σ)" in remark and remark.endswith("?")


@pytest.mark.parametrize("count", [1, 2, 4])
def test_an_offset_within_three_standard_deviations_contradicts_nothing(count):
    """Protects few poses: their residual is the prior's, and no chance of one device in fifty."""
    f = 9.80665 * UP[:count] / TRUTH.gravity * (1 + 3 * 0.5 / 9.80665)
    force, _ = calibrate_recording(at_rest(f, 1e-3), UNKNOWN_NOISE, 9.80665)
    assert (force.method, force.not_testable) == ("multi_position", None)
