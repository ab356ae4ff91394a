"""Multi-position accelerometer: exact data, what poses cannot determine."""

import numpy as np
import pytest

from calibrate.devices import UNKNOWN_NOISE, at_rest, calibrated, known_noise
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
    return calibrated(at_rest(f, error), noise, G)[0]


@pytest.mark.parametrize("truth", [TRUTH, np.repeat([0.0, 1.0, 0.0], 3)])
def test_exact_poses_give_the_truth_exactly(truth):
    found = calibrated_by(poses_at(spread(), truth))
    x = np.concatenate([found.T[np.triu_indices(3, 1)], found.K, found.b])
    np.testing.assert_allclose(x, truth, atol=1e-10)


def test_poses_without_noise_weigh_no_more_than_their_residual():
    """Three poses of a deaf channel and 13 others; measured of 14 poses of a fuzzed log."""
    f = poses_at(spread(16))
    f = f + np.random.default_rng(1).normal(0, 0.1, f.shape)
    made = calibrated_by(f, np.where(np.arange(16) < 3, 1e-17, 1e-3))
    x = np.concatenate([made.T[np.triu_indices(3, 1)], made.K, made.b])
    assert np.abs((x - TRUTH) / [*made.std.values()]).max() < 3.5


@pytest.mark.parametrize(
    ("directions", "reason"),
    [
        (spread(9), "9 poses found, at least 10 needed"),
        (spread(9)[:1], "1 pose found, at least 10 needed"),
        (spread(40) * [1, 1, 0.01], "scale factor to 7.5 %, a data sheet to 0.02 rad and 3 %"),
        (spread(40) * [1, 1, 1e-3], "do not determine 9 parameters: condition number"),
        (np.tile([[0, 0, 1], [0, 0, -1]], (10, 1)), "do not determine 9 parameters"),
        (spread(40) * [1, 1, 0], "condition number beyond 1e9, at most 10000 allowed"),
    ],
)
def test_poses_that_determine_too_little_are_refused_with_the_reason(directions, reason):
    noise = known_noise(example_truth())
    found = calibrated_by(poses_at(directions), noise=noise)
    assert found.method == "nominal" and reason in found.not_testable
    known = calibrated_by(poses_at(spread(12)), noise=noise)
    assert known.not_testable is None


@pytest.mark.parametrize("unit", [1.0, 9.8])
def test_poses_that_lie_on_no_ellipsoid_are_refused(unit):
    f = poses_at(spread())
    midway, in_turn = (
        f + 5.0 * offset[:, None] for offset in (np.arange(30) > 15, np.arange(30) % 2)
    )
    reasons = "", "the accelerometer changed at about 157.5 s", "lies on no ellipsoid"
    for made, reason in zip((f, midway, in_turn), reasons, strict=True):
        found = calibrated_by(made / unit, 1e-4 / unit)
        assert reason in (found.not_testable or "")
        assert found.method == ("nominal" if reason else "multi_position")
