"""Turns that show what motion has not: about the axis that was not turned about, as expected."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibrate.devices import recorded
from imuloop.calibrate.sensor_pair import OfSensor
from imuloop.core.effect import FittedEffect
from imuloop.effects.other_sensor import LeverArm, RateSensitivity
from imuloop.plan.next_recording import next_recording
from imuloop.plan.session import Plan, level_turns
from imuloop.report.recording import turns_in_motion
from imuloop.report.results import DeviceResults
from plan.planned_log import simulate_plan
from plan.test_next_recording import HOLD_S, TRUTH, fitted

SLOW_S, FAST_S = 15.0, 1.5
UP = np.array([0.6, 0.0, 0.8])


def turned(seed, slowly=(), never=(), count=48):
    """Return a log of turns about single axes, about some of them slowly or never."""
    rng, fast = np.random.default_rng(seed), sorted({0, 1, 2} - {*slowly, *never})
    about = rng.choice(fast, count)
    about[rng.choice(count, 10 * len(slowly), replace=False)] = np.repeat(slowly, 10)
    turns = np.zeros((count, 3))
    turns[np.arange(count), about] = rng.uniform(0.7, 2.6, count) * rng.choice([-1, 1], count)
    seconds = np.where(np.isin(about, slowly), SLOW_S, FAST_S)
    return simulate_plan(TRUTH, Plan(UP, turns), seed, HOLD_S, seconds)


def in_motion(recording):
    """Return the Diagnosed of a recording all of whose moves count."""
    found = fitted(recording)
    pair = replace(found.poses.pair, quiet=np.ones(len(recording.rotations), dtype=bool))
    pair = pair.given_rotation(recording, (), found.poses.solution.fit.x)
    return replace(found, motion=(pair, pair.fit(recording)))


def asked(log):
    return next_recording(in_motion(recorded(log)))["motion"]


@pytest.fixture(scope="module")
def fast():
    """The Diagnosed of turns that were all fast."""
    return in_motion(recorded(turned(1)))


@pytest.mark.parametrize("axis", [0, pytest.param(2, marks=pytest.mark.study)])
def test_the_axis_is_the_one_that_was_turned_about_slowly(axis):
    found = asked(turned(1 + axis, slowly=(axis,)))
    assert found["axes"] == ["xyz"[axis]]
    # of its axis an arm acts along the others
    assert found["parameter"][:11] == "lever_arm.r" and found["parameter"][11] != "xyz"[axis]
    assert found["std_after"] < found["level"] < 0.1 * found["std"]
    device = DeviceResults("imu", "IMU", Path(), diagnosis={"next_recording": {"motion": found}})
    [(gain, text)] = turns_in_motion(device)
    words = text.replace("\u202f", " ")
    assert gain > 0.9 and f"Turn about {'xyz'[axis]}: 8 quarter and half turns about it" in words
    assert f"would lower σ of the accelerometer's {found['parameter'].replace('.', ' ')}" in words
    assert "in 2.0 s each (90° at 45 °/s)" in words


def test_an_arm_that_the_calibration_holds_is_known_as_well_as_there(fast):
    """Protects σ now of what other records show: it was that of these moves alone."""
    arm, calibration = LeverArm(), fast.calibration
    every = dict.fromkeys(arm.parameters, 0.0), dict.fromkeys(arm.parameters, 1.0)
    force = replace(calibration.accelerometer, effects=(FittedEffect(arm, *every),))
    calibration = replace(calibration, accelerometer=force)
    found = next_recording(replace(fast, calibration=calibration))["motion"]
    assert found["parameter"].startswith("lever_arm.") and found["std"] == 1.0
    assert found["std_after"] < found["level"]


def test_nothing_is_asked_where_every_move_was_fast(fast):
    assert next_recording(fast)["motion"] == {}


def test_expected_errors_are_those_of_a_fit_with_the_turns_added():
    log = turned(4, slowly=(1,))
    found = asked(log)
    axis = "xyz".index(found["axes"][0])
    effects = [OfSensor(effect, "accelerometer") for effect in (LeverArm(), RateSensitivity())]
    plan = level_turns(axis, found["seconds"], initial_rest_s=50.0, rest_s=HOLD_S)
    more = simulate_plan(TRUTH, plan, 4, HOLD_S, np.full(len(plan.turns), found["seconds"]))
    both = recorded(log, more)
    fit = in_motion(both).motion[0].fit(both, effects).fit
    at = list(effects[0].parameters).index(found["parameter"].partition(".")[2])
    # not by what chance makes of the residuals
    std = np.sqrt(np.diag(fit.covariance))[at - 15]
    assert found["axes"] == ["y"] and found["std_after"] == pytest.approx(std, rel=0.2)
