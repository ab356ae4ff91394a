"""A turn that contradicts all others is left out; a sensor that changed amid a log has no fit."""

from dataclasses import replace

import numpy as np
import pytest

from calibrate.devices import UNITS, calibrated, known_noise, planned, recorded, recording
from imuloop.calibrate.calibrate import start_pair
from imuloop.calibrate.contradictions import change, odd_turns
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.model import Calibration
from imuloop.core.samples import CHANNELS
from imuloop.diagnose.records.pose_diagnosis import diagnose_poses
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import example_truth
from quick import diagnosed

TRUTH = planned(example_truth(rate=50.0), poses=30)
FORCE, RATE = list(CHANNELS[:3]), list(CHANNELS[3:])
SWAP = [1, 0, 2]


def changed(channels, values, seed=0, share=2 / 3):
    """Return a recording with other values after a share of its log, and when that is."""
    samples = simulate_session(TRUTH, "multi_position", seed)
    late = np.arange(len(samples)) > share * len(samples)
    rows = samples.loc[late, channels].to_numpy()
    samples.loc[late, channels] = values(rows)
    return recorded(samples), samples["t"].to_numpy()[late][0]


def within(words, time, room=20.0):
    """Return whether the time that words name is within `room` of another, s."""
    return abs(float(words.split("changed at about ")[1].split(" s:")[0]) - time) < room


@pytest.mark.parametrize("cut_s", [8.0, 20.0])
@pytest.mark.parametrize("seed", range(3))
def test_a_stretch_that_is_cut_out_costs_one_turn(seed, cut_s):
    samples = simulate_session(TRUTH, "multi_position", seed)
    n, t = len(samples), samples["t"].to_numpy()
    first = n // 2
    kept = np.r_[:first, first + int(cut_s * 50) : n]
    cut = samples.iloc[kept].assign(t=t[: len(kept)]).reset_index(drop=True)
    made = recorded(cut)
    # a rest after it may be in the same attitude by chance
    assert len(made.lost.contradicting) <= 1
    for _, start, end, angle in made.lost.contradicting:
        assert start - 1 < t[first] < end + 1 and angle > 0.05
    noise = known_noise(TRUTH)
    whole = calibrated(recording(TRUTH, seed), noise, TRUTH.gravity)[1]
    found = calibrated(made, noise, TRUTH.gravity)[1]
    assert found.method == "multi_position"
    off = np.abs(found.K - whole.K) / found.std["K0"]
    assert off.max() < 4


@pytest.mark.parametrize("seed", range(10))
def test_nothing_contradicts_in_a_sound_recording(seed):
    made = recording(TRUTH, seed)
    assert made.lost.contradicting == ()
    assert not odd_turns(made.poses, made.rotations)[0].any()
    for sensor in ("accelerometer", "gyroscope"):
        assert change(sensor, made.poses, made.rotations) is None


@pytest.mark.parametrize("value", [0.0, np.nan])
def test_nothing_contradicts_a_sensor_that_is_dead(value):
    made = recording(TRUTH, 0)
    dead = replace(made.poses, f=np.full_like(made.poses.f, value))
    assert not odd_turns(dead, made.rotations)[0].any()
    assert change("accelerometer", dead, made.rotations) is None


@pytest.mark.parametrize("seed", range(3))
def test_a_bias_that_jumps_costs_no_more_than_the_turn_in_which_it_does(seed):
    samples = simulate_session(TRUTH, "multi_position", seed)
    late = samples["t"].to_numpy() >= (when := 0.9 * samples["t"].iloc[-1])
    samples.loc[late, RATE] += 0.03
    made = recorded(samples)
    assert all(start < when < end for _, start, end, _ in made.lost.contradicting)
    assert change("gyroscope", made.poses, made.rotations) is None


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "values",
    [lambda x: 0.5 * x, lambda x: x[:, SWAP], lambda x: x * [1, -1, 1]],
    ids=["half", "swapped", "turned around"],
)
@pytest.mark.parametrize("share", [2 / 3, 1 / 2])
def test_a_gyroscope_that_changed_has_no_fit_and_the_time_is_named(values, seed, share):
    made, when = changed(RATE, values, seed, share)
    force, turn = calibrated(made, known_noise(TRUTH), TRUTH.gravity)
    assert (force.method, turn.method) == ("multi_position", "static")
    assert turn.not_testable.startswith("the gyroscope, or an axis")
    assert within(turn.not_testable, when)


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    "values", [lambda x: 0.5 * x, lambda x: x[:, SWAP]], ids=["half", "swapped"]
)
def test_an_accelerometer_that_changed_is_not_handed_out(values):
    made, when = changed(FORCE, values)
    how = known_noise(TRUTH), TRUTH.gravity, UNITS, CalibrateSettings()
    found = diagnose_poses(*start_pair(made, *how), made, DiagnoseSettings(), 0)
    assert not found.calibrations
    assert found.contents["accelerometer"]["why"].startswith("the accelerometer changed at about")
    for content in found.contents.values():
        assert "contradict" in content["why"] and within(content["why"], when)


def test_what_is_left_out_stands_in_the_diagnosis(tmp_path):
    samples = simulate_session(TRUTH, "multi_position", 0)
    t = samples["t"].to_numpy()
    kept = np.r_[: len(t) // 2, len(t) // 2 + 400 : len(t)]
    cut = samples.iloc[kept].assign(t=t[: len(kept)])
    sensors = diagnosed(tmp_path, cut, gravity=TRUTH.gravity)
    [turn] = sensors["gyroscope"]["poses"]["contradicting"]
    assert turn["session"] == "log" and turn["start_s"] - 1 < t[len(t) // 2] < turn["end_s"] + 1
    assert sensors["gyroscope"]["poses"]["verdict"] == "consistent"


def test_an_accelerometer_that_changed_keeps_its_data_sheet(tmp_path):
    samples = simulate_session(TRUTH, "multi_position", 0)
    samples.loc[2 * len(samples) // 3 :, FORCE] *= 0.5
    sensors = diagnosed(tmp_path, samples, gravity=TRUTH.gravity)
    assert sensors["accelerometer"]["poses"]["verdict"] == "not_testable"
    found = Calibration.from_json(tmp_path / "calibration.json")
    assert (found.accelerometer.method, found.gyroscope.method) == ("nominal", "static")
    assert "changed at about" in found.accelerometer.not_testable
    # the rates at rest need no direction of gravity
    assert np.abs(found.gyroscope.b - TRUTH.gyroscope.b).max() < 1e-3
