"""What the report says of the motion between the rests."""

import csv

import numpy as np
import pytest

import imuloop.effects  # noqa: F401  loads the library
from imuloop.core.effect import FittedEffect, find_effect
from imuloop.core.model import Calibration, SensorCalibration
from imuloop.core.units import RawUnit
from imuloop.report.advice import what_next
from imuloop.report.figures.arms import arm_pictures
from imuloop.report.results import DeviceResults
from imuloop.report.verdict import BOTH, answers, motion_of, sentence
from report.plausible_diagnosis import residual

RESIDUAL = residual("m/s", 20e-3, 6e-3, 4e-3, 20)


def diagnosis(verdict, left_out=0, **effects):
    common = {
        "verdict": verdict,
        "residuals": {"velocity_vertical": RESIDUAL},
        "confounded": [],
        "moves": {"all": 37, "left_out": left_out},
    }
    late = {"name": "time_offset", "status": "confounded", "why": "the accelerometer's"}
    own = {"accelerometer": [late | {"status": "added"}], "gyroscope": [late]}
    return {
        "sensors": {
            sensor: {
                "motion": common
                | {"effects": [{"name": n} for n in effects.get(sensor, ())]}
                | {"candidates": own[sensor]}
            }
            for sensor in own
        }
    }


def test_effects_of_both_sensors_are_one_answer():
    found = diagnosis(
        "partly_explained", accelerometer=["lever_arm"], gyroscope=["gyro_axis_delay"]
    )
    effects = "lever arm and delays between the gyroscope's axes"
    words = f"better with {effects} corrected, but something is still missing"
    assert answers(found)[2:] == [("both in motion", "partly_explained", words)]
    # what is given to one sensor is none of the other's
    assert [c["status"] for c in motion_of(found)["candidates"]] == ["added"]
    # at its floor, or without a test, motion is no answer
    assert len(answers(diagnosis("consistent"))) == len(answers({})) == 2


def test_moves_that_a_knock_spoiled_are_counted_and_what_to_do_is_said():
    block = motion_of(diagnosis("unexplained", left_out=17))
    why = "a knock between two samples, lost samples, a tilt at the rest beside it or clipping"
    assert f"Left out, for {why}: 17 of 37 moves." in sentence(BOTH, block)
    assert "Low-pass the accelerometer" in what_next(block)
    # one knock in 37 moves is none of the others
    assert "Low-pass" not in what_next(motion_of(diagnosis("unexplained", left_out=1)))


@pytest.fixture
def with_arms(tmp_path):
    """A device whose x axis sits 6 mm from its z axis, and the covariance of all six components."""
    effect, unit = find_effect("lever_arm")(), RawUnit("m/s^2", 1.0)
    values = dict(zip(effect.parameters, (6e-3, 0.0, -2e-3, 1e-3, -4e-3, 0.0), strict=True))
    root = np.random.default_rng(0).normal(0, 5e-4, (6, 6))
    names = ("K0", *(f"lever_arm.{name}" for name in values))
    covariance = np.zeros((7, 7))
    covariance[1:, 1:] = root @ root.T
    force = SensorCalibration(
        unit, np.eye(3), np.ones(3), np.zeros(3), names, covariance,
        (FittedEffect(effect, values, {}),),
    )  # fmt: skip
    turn = SensorCalibration.nominal(RawUnit("rad/s", 1.0), "")
    folder = tmp_path / "imu"
    (folder / "figures").mkdir(parents=True)
    return DeviceResults(
        "imu", "IMU", folder, calibrations={"final": Calibration("imu", 9.8, force, turn)}
    )


def test_the_arms_are_drawn_with_their_sigma(with_arms):
    block = motion_of(diagnosis("explained", accelerometer=["lever_arm"]))
    [drawn] = arm_pictures(with_arms, block)
    words = drawn.caption.replace("\u202f", " ")
    assert ": x at (6.0, 0, −2.0) mm, σ" in words and "y at (1.0, −4.0, 0) mm, σ" in words
    rows = list(csv.DictReader((with_arms.figures / "lever_arm.csv").open()))
    std = np.sqrt(np.diag(with_arms.calibrations["final"].accelerometer.covariance)[1:]) * 1e3
    found = [[float(row[f"{axis}_std_mm"]) for axis in "xyz"] for row in rows[:2]]
    np.testing.assert_allclose(found, std.reshape(2, 3))
    assert arm_pictures(with_arms, motion_of(diagnosis("explained"))) == []
