"""The advice names the parameters that limit a calibration, and a fit keeps its promise."""

from dataclasses import replace

import numpy as np
import pytest

from calibrate.devices import UNITS, known_noise, record_samples
from imuloop.calibrate.calibrate import calibrate_sensors
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.noise_model import AxisNoise, NoiseModel
from imuloop.core.samples import CHANNELS
from imuloop.core.sphere import fibonacci_lattice
from imuloop.core.units import DEGREE
from imuloop.model.calibration import Calibration
from imuloop.plan.advice import next_pose_or_turn, next_step
from imuloop.simulate.truth import example_truth
from plan.planned_log import simulate_plan, turns_between

TRUTH = example_truth(rate=50.0)
NOISE = known_noise(TRUTH)
ENOUGH = np.sqrt(NOISE.mean_covariance(np.array([[0.0, 1.0]]))[:, 0, 0])
ANGLES = np.cumsum(np.resize([100.0, 70.0, -45.0, 130.0], 16)) * DEGREE
PLANE = np.column_stack([np.cos(ANGLES), np.sin(ANGLES), np.zeros(16)])
SPREAD = np.random.default_rng(3).permutation(fibonacci_lattice(14))


def fit_log(up, turns, seed=1, **how):
    """Return the Calibration by a planned log, and its Recording."""
    recording = record_samples(simulate_plan(TRUTH, up, turns, seed, 50.0, **how))
    sensors = calibrate_sensors(recording, NOISE, TRUTH.gravity, UNITS, CalibrateSettings())
    return Calibration("example", TRUTH.gravity, **sensors), recording


@pytest.mark.parametrize("up", [PLANE, SPREAD], ids=["plane", "spread"])
@pytest.mark.parametrize("sensor", ["accelerometer", "gyroscope"])
def test_following_the_advice_lowers_the_standard_error_as_promised(up, sensor):
    turns = turns_between(up)
    calibration, recording = fit_log(up[0], turns)
    # of one sensor alone: the other is good enough
    other = np.repeat([sensor != name for name in UNITS], 3)
    advice = next_pose_or_turn(calibration, NOISE, recording, np.where(other, np.inf, ENOUGH))
    assert advice.sensor == sensor and advice.std_after < 0.95 * advice.std
    _, turn, seconds = advice.step.turn(up[-1])
    move_s = np.append(np.full(len(turns), 2.0), seconds)
    again, _ = fit_log(up[0], [*turns, turn], move_s=move_s)
    # reduced χ² of a few poses is mostly chance
    chance = [max(1.0, getattr(c, sensor).reduced_chi2 or 1.0) ** 0.5 for c in (calibration, again)]
    std = getattr(again, sensor).std[advice.parameter] / chance[1]
    assert std == pytest.approx(advice.std_after / chance[0], rel=0.2)


def test_the_missing_region_is_asked_for_where_all_rests_lie_in_one_plane():
    calibration, noise, recording = calibrated_with_noise(PLANE)
    of_force = np.repeat([1.0, np.inf], 3)
    advice = next_pose_or_turn(calibration, noise, recording, ENOUGH * of_force)
    assert advice.parameter in ("K2", "b2")
    assert abs(advice.step.up[2]) > 0.5 and "z is up, and let go for 4 s" in str(advice.step)
    # g times the standard error of the scale factor, over the noise of a mean of one second
    size = {"K2": TRUTH.gravity, "b2": 1.0}[advice.parameter]
    assert advice.error == pytest.approx(size * advice.std)
    assert advice.ratio == pytest.approx(advice.error / ENOUGH[2])
    # nor does any turn about z show the gyroscope's other axes
    both = next_step(calibration, noise, recording)
    assert (both["sensor"], both["parameter"][1]) == ("gyroscope", "1") and "z" in both["step"]


def calibrated_with_noise(up):
    calibration, recording = fit_log(up[0], turns_between(up))
    return calibration, NOISE, recording


def test_nothing_is_advised_where_the_noise_is_unknown():
    calibration, noise, recording = calibrated_with_noise(SPREAD[:6])
    unknown = NoiseModel("example", dict.fromkeys(CHANNELS, AxisNoise()))
    still = replace(recording.poses, f=0.0 * recording.poses.f)
    assert next_step(calibration, noise, recording)["step"]
    assert next_step(calibration, unknown, recording) == {}
    assert next_step(calibration, noise, replace(recording, poses=still)) == {}
