"""Rests in the hand: where they begin and end, and which rests they take the place of."""

import numpy as np

from imuloop.segment.attitudes import expected_error
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from segment.logs import G, frame

RATE = 100
BIAS = np.array([0.01, -0.02, 0.005])


def in_the_hand(seed, poses=14, seconds=5.0, turn_s=1.5):
    """Return angular rate and true rests of turns of 1.5 rad, and sway and tremor in between."""
    rng = np.random.default_rng(seed)
    pieces, rests, t = [], [], np.arange(round(seconds * RATE)) / RATE
    x = np.arange(round(turn_s * RATE)) / round(turn_s * RATE)
    for _ in range(poses):
        first = sum(map(len, pieces))
        f = rng.uniform([0.1, 8], [0.4, 10])
        rate = 2 * np.pi * f * np.array([0.004, 4e-4])
        wave = rate * np.cos(2 * np.pi * (f * t[:, None] + rng.uniform(size=2)))
        axis, about = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
        pieces += [
            np.outer(wave.sum(axis=1), axis),
            np.outer(45 / turn_s * (x - x * x) ** 2, about),
        ]
        rests.append([first, first + len(t)])
    w = np.concatenate(pieces) + BIAS
    return (w + rng.normal(size=w.shape) * 1e-3).T, np.array(rests)


def test_a_session_of_table_and_hand_has_the_rests_of_both():
    w, true = in_the_hand(1, poses=24)
    rng, held = np.random.default_rng(2), np.arange(24) % 3 == 1
    up = rng.normal(size=(24, 3))
    up /= np.linalg.norm(up, axis=1)[:, None]
    f = rng.normal(size=w.T.shape) * 0.01
    for k, (i, j) in enumerate(true):
        sway = np.cumsum(w[:, i:j].T - BIAS, axis=0) / RATE
        if not held[k]:
            w[:, i:j] = BIAS[:, None] + rng.normal(size=(3, j - i)) * 1e-3
            sway *= 0
        f[i:j] += G * (up[k] + np.cross(up[k], sway - sway.mean(axis=0)))
        f[j : j + 150] += np.outer(np.sin(np.arange(150) / 5), [3, 2, 1]) + G * up[k]
    segments, metadata = segment_session(
        frame(np.arange(len(f)) / RATE, f, w.T), "multi_position", SegmentSettings()
    )
    rests = segments[segments["kind"] == "static"]
    assert metadata["hand_held"] and len(rests) == 24
    np.testing.assert_array_equal(rests["tilt_rad"].to_numpy() > 0, held)
    means = rests[["ax_mean", "ay_mean", "az_mean"]].to_numpy()
    assert expected_error(means) < 0.9 * expected_error(means[~held])
