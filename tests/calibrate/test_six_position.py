"""Six-position calibration: faces by themselves, exact data exactly, honest intervals."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imuloop.calibrate.six_position import decompose, find_faces, fit_six_position, untestable_faces

G = 9.80665
T = np.array([[1, 0.01, -0.02], [0, 1, 0.015], [0, 0, 1]])
K = np.array([1.01, 0.98, 1.003])
B = np.array([0.1, -0.2, 0.3])
FACES = np.array([1, -1, 2, -2, 3, -3])
TRUTH = np.array([0.01, -0.02, 0.015, *K, *B])


def measured(faces, tilt=0.0, rng=None, turn=None):
    """Return raw specific force of faces, each tilted at random (rad), of a sensor turned."""
    x = np.sign(faces)[:, None] * G * np.eye(3)[np.abs(faces) - 1]
    if tilt:
        x = Rotation.from_rotvec(rng.normal(scale=tilt, size=(len(faces), 3))).apply(x)
    if turn is not None:
        x = x @ turn
    return np.linalg.solve(T, x.T).T / K + B


@pytest.mark.parametrize("turn", [[0, 0, 0], [0.02, -0.03, 0.05]])
def test_exact_faces_give_the_truth_exactly_and_how_the_sensor_sits_in_its_case(turn):
    turn = Rotation.from_rotvec(turn).as_matrix()
    fit = fit_six_position(measured(FACES, turn=turn), FACES, G)
    np.testing.assert_allclose(fit.x, TRUTH, atol=1e-10)
    np.testing.assert_allclose(fit.case, turn, atol=1e-10)


def test_faces_are_found_whatever_their_order_and_missing_ones_named():
    f = measured(FACES)[[3, 0, 5, 1, 4, 2]]
    np.testing.assert_array_equal(find_faces(f, 20), [-2, 1, -3, -1, 3, 2])
    assert find_faces([[G / 2**0.5, G / 2**0.5, 0]], 20)[0] == 0
    reason = untestable_faces(np.array([1, -1, 2, 3, -3, 0]))
    assert reason == "5 of 6 faces found; missing: -y"
    assert untestable_faces(FACES) is None


def test_the_decomposition_keeps_scale_factors_positive():
    x, case = decompose(-np.diag([2.0, 3.0, 4.0]), np.zeros(3))
    np.testing.assert_allclose(x[3:6], [2, 3, 4])
    np.testing.assert_allclose(case, -np.eye(3), atol=1e-15)


@pytest.mark.parametrize("rounds", [1, 4])
def test_intervals_cover_the_truth_where_faces_are_tilted(rounds):
    faces, z = np.tile(FACES, rounds), []
    for seed in range(300):
        rng = np.random.default_rng(seed)
        f = measured(faces, np.radians(0.2), rng) + rng.normal(scale=3e-4, size=(len(faces), 3))
        fit = fit_six_position(f, faces, G, 9e-8)
        z.append((fit.x - TRUTH) / np.sqrt(np.diag(fit.covariance)))
    covered = (np.abs(z) < 1.96).mean(axis=0)
    # the scatter across comes from six degrees of freedom in one round: Student, not normal
    assert np.all(covered[:3] > 0.86) and np.all(covered[:3] < 0.99)
    assert np.all(covered[3:] > 0.90), covered
