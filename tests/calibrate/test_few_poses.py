"""Few poses: all that was measured is used, the rest is the data sheet's and named."""

from dataclasses import replace
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
    made = whole_recording(6300 + seed)
    return made.select(np.arange(len(made.poses)) < count)


def error(calibration):
    """Return the root-mean-square error of specific force over attitudes that no fit saw, m/s²."""
    true = TRUTH.accelerometer
    raw = UP @ np.linalg.inv(true.T).T / true.K + true.b
    return np.sqrt(np.mean(np.sum((calibration.aligned(raw) - UP) ** 2, axis=1)))


def plain_error(made):
    """Return the calibration's error by the plain fit of the accelerometer with the same prior."""
    fit = fit_accelerometer(made.poses.f, prior=True)
    true = TRUTH.accelerometer
    raw = UP @ np.linalg.inv(true.T).T / true.K + true.b
    return np.sqrt(np.mean(np.sum((fit.corrected(raw) - UP) ** 2, axis=1)))


@pytest.mark.parametrize(("count", "most"), [(1, 1.05), (2, 1.05), (4, 1.05), (6, 0.6), (8, 0.3)])
def test_no_number_of_poses_is_refused_and_turns_help(count, most):
    ratios = []
    for seed in SEEDS:
        made = poses(seed, count)
        force, turn = calibrate_recording(made, NOISE, TRUTH.gravity)
        assert force.method == turn.method == "multi_position"
        assert force.not_testable is turn.not_testable is None
        ratios.append(error(force) / plain_error(made))
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
                found = [sensor.T[int(n[1]), int(n[2])] for n in sensor.names if n[0] == "T"]
                found = np.concatenate([found, sensor.K, sensor.b])
                scores.append((found - part) / np.sqrt(np.diag(sensor.covariance)))
    inside = np.mean(np.abs(np.concatenate(scores)) < 1.96)
    assert 0.92 < inside < 0.99


LEVEL = np.array([[1.0, 1.0, 0.0], [1.0, -1.0, 0.0]]) / np.sqrt(2)
FACES = np.vstack([np.eye(3), -np.eye(3)])
BETWEEN = np.array([[1.0, 0, 1], [-1, 0, 1], [0, 1, 1], [0, -1, 1]]) / np.sqrt(2)


@pytest.mark.parametrize(
    ("attitudes", "named"),
    [
        (FACES, "No pose lies between x and y, x and z and y and z: misalignment xy, xz and yz"),
        (np.vstack([FACES, BETWEEN]), "No pose lies between x and y: misalignment xy is the data"),
        (FACES[[0, 1, 3, 4]], "Too few poses: misalignment xy, xz and yz, scale factor z and bias"),
        (np.vstack([FACES, BETWEEN, LEVEL]), None),
    ],
)
def test_what_the_poses_did_not_show_is_named_with_the_poses_to_add(attitudes, named):
    force, _ = calibrate_recording(at_rest(9.80665 * attitudes, 1e-3), UNKNOWN_NOISE, 9.80665)
    found = remarks("accelerometer", force)
    assert found == [] if named is None else found[0].startswith(named)
    of_data_sheet = {row[0] for row in force.parameters("accelerometer") if row[4] == "data sheet"}
    assert of_data_sheet == set(force.unimproved)


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


def test_an_accelerometer_alone_is_calibrated():
    made = poses(0, 8)
    silent = replace(
        made.poses,
        w=np.zeros_like(made.poses.w),
        variance=np.where(np.arange(6) < 3, made.poses.variance, 0.0),
    )
    force, turn = calibrate_recording(replace(made, poses=silent), UNKNOWN_NOISE, TRUTH.gravity)
    assert force.method == "multi_position"
    assert turn.not_testable
