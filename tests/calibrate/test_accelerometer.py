"""Multi-position accelerometer: exact data, what poses cannot determine."""

import numpy as np
import pytest

from calibrate.devices import UNKNOWN_NOISE, at_rest, calibrate_recording, known_noise
from imuloop.simulate.truth import example_truth

G = 9.80665
TRUTH = np.array([0.01, -0.02, 0.015, 1.01, 0.98, 1.003, 0.1, -0.2, 0.3])


def poses_at(directions, truth=TRUTH):
    """Return specific force of a device of known errors at given upward directions."""
    u = np.asarray(directions, dtype=float)
    u = u / np.linalg.norm(u, axis=1, keepdims=True)
    T = np.eye(3)
    T[(0, 0, 1), (1, 2, 2)] = truth[:3]
    return np.linalg.solve(T, G * u.T).T / truth[3:6] + truth[6:]


def spread(n=30, seed=0):
    return np.random.default_rng(seed).normal(size=(n, 3))


def calibrated_by(f, error=1e-4, noise=UNKNOWN_NOISE):
    return calibrate_recording(at_rest(f, error), noise, G)[0]


def test_poses_without_noise_weigh_no_more_than_their_residual():
    """Three poses of a deaf channel and 13 others; measured of 14 poses of a fuzzed log."""
    f = poses_at(spread(16))
    f = f + np.random.default_rng(1).normal(0, 0.1, f.shape)
    made = calibrated_by(f, np.where(np.arange(16) < 3, 1e-17, 1e-3))
    x = np.concatenate([made.T[np.triu_indices(3, 1)], made.K, made.b])
    assert np.abs((x - TRUTH) / [*made.std.values()]).max() < 3.5


@pytest.mark.parametrize(
    ("directions", "of_data_sheet"),
    [
        (spread(9)[:1], "T01 T02 T12 K0 K1 K2 b0 b1"),
        (spread(40) * [1, 1, 0], "T02 T12 K2 b2"),
        (spread(40) * [1, 1, 1e-3], "T02 T12 K2"),
        (np.tile([[0, 0, 1], [0, 0, -1]], (10, 1)), "T01 T02 T12 K0 K1 b0 b1"),
        (spread(12), ""),
    ],
)
def test_what_poses_do_not_determine_is_the_data_sheets(directions, of_data_sheet):
    found = calibrated_by(poses_at(directions), noise=known_noise(example_truth()))
    assert found.method == "multi_position" and found.not_testable is None
    assert found.unimproved == tuple(of_data_sheet.split())


@pytest.mark.parametrize("unit", [1.0, 9.8])
def test_poses_that_contradict_each_other_are_refused(unit):
    f = poses_at(spread())
    midway, in_turn = (
        f + 5.0 * offset[:, None] for offset in (np.arange(30) > 15, np.arange(30) % 2)
    )
    reasons = "", "the accelerometer changed at about 157.5 s", "its poses contradict each other"
    for made, reason in zip((f, midway, in_turn), reasons, strict=True):
        found = calibrated_by(made / unit, 1e-4 / unit)
        assert reason in (found.not_testable or "")
        assert found.method == ("nominal" if reason else "multi_position")
