"""The motion between the rests of measured recordings: its effects, and where knocks rule."""

import numpy as np
import pytest

import imuloop.effects  # noqa: F401  loads the library
from imuloop.core.samples import SENSORS
from published.conftest import BOARDS

FOUND = ("time_offset", "lever_arm", "rate_sensitivity")
# by an independent prototype, with σ: m, s, m/s² per rad/s
PROTOTYPE = {
    "lever_arm": {
        "rxx": (-5.1e-3, 0.6e-3), "rxy": (1.4e-3, 1.0e-3), "rxz": (-5.3e-3, 0.7e-3),
        "ryx": (-4.8e-3, 0.7e-3), "ryy": (0.6e-3, 0.7e-3), "ryz": (-3.6e-3, 0.4e-3),
    },
    "time_offset": {"dt": (-1.00e-3, 0.17e-3)},
    "rate_sensitivity": {"M02": (15.0e-3, 1.5e-3)},
}  # fmt: skip


@pytest.fixture(scope="module")
def xsens(measured_results):
    return measured_results.json("xsens_mti", "diagnosis")["sensors"]["accelerometer"]["motion"]


def test_the_moves_show_three_effects_that_gravity_cannot(xsens):
    residuals = xsens["residuals"]
    assert [e["name"] for e in xsens["effects"]] == [*FOUND]
    vertical = residuals["velocity_vertical"]
    # the choice of effects is nested in the folds
    assert vertical["before"] >= 16e-3 and vertical["after"] <= 8e-3
    both = [np.hypot(*(r[when] for r in residuals.values())) for when in ("before", "after")]
    assert both[1] / both[0] <= 0.75
    assert all(e["ratio_ci95"][1] < 1 for e in xsens["effects"])


def test_their_sizes_are_those_of_a_prototype(xsens):
    for effect in xsens["effects"]:
        for name, (value, std) in PROTOTYPE[effect["name"]].items():
            assert abs(effect["parameters"][name] - value) < 2 * np.hypot(effect["std"][name], std)


@pytest.mark.parametrize("board", BOARDS)
def test_where_knocks_rule_nothing_is_said_of_motion(measured_results, board):
    for sensor in SENSORS:
        block = measured_results.json(f"mpu9150_{board}", "diagnosis")["sensors"][sensor]["motion"]
        assert block["verdict"] == "not_testable" and "knock" in block["why"]
