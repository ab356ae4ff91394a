"""Rotation and lever arm of each device of a simulated board."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from board.boards import ARMS, NAMES, TURNS
from imuloop.board.board import relate
from seeds import least

SEEDS = range(3)


@pytest.fixture(scope="module")
def found(board):
    return [relate("wing", board(seed)[1]) for seed in SEEDS]


def scores(found):
    """Return (estimate − truth)/σ of arms and turns of two devices, (2, seeds, 2, 3)."""
    arms, turns = [], []
    for content in found:
        for k, name in enumerate(NAMES[1:], 1):
            device = content["devices"][name]
            arms.append((device["arm"] - ARMS[k]) / device["arm_std"])
            turn = Rotation.from_matrix(device["rotation"] @ TURNS[k].T).as_rotvec()
            turns.append(turn / device["rotation_std"])
    return np.array([arms, turns]).reshape(2, len(found), 2, 3)


def test_arms_and_turns_come_back_within_their_errors(found):
    z = scores(found)
    # 18 of each, those of a seed not independent
    assert np.abs(z).max() < 4
    for each in z:
        assert np.sum(np.abs(each) < 1) >= least(each.size, 0.683, 1e-3)
    # σ that says nothing would pass
    assert np.all((z**2).mean(axis=(1, 2, 3)) > 0.4)
    for device in (content["devices"][name] for content in found for name in NAMES[1:]):
        assert np.all(device["arm_std"] < 0.15e-3) and np.all(device["rotation_std"] < 0.1e-3)


def test_the_first_is_the_reference_and_where_nothing_differs_nothing_is_said_to(found):
    for content in found:
        first = content["devices"][content["reference"]]
        assert content["reference"] == NAMES[0]
        np.testing.assert_array_equal(first["rotation"], np.eye(3))
        assert not np.any(first["arm"]) and not np.any(first["arm_std"])
        tests = [d[kind] for d in content["devices"].values() for kind in ("turn", "gravity_norm")]
        verdicts = {test["verdict"] for test in (*tests, *content["common"].values())}
        # noise that the rests do not bound leaves doubt
        assert verdicts <= {"consistent", "undecided"}
        assert content["common"]["closure"]["verdict"] == "consistent"
