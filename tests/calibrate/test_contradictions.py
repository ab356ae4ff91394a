"""A turn that contradicts all others is left out; a sensor that changed within a log has no fit.

Parameters that poses and turns do not determine are not judged.
"""

from dataclasses import replace

import numpy as np
import pytest

from calibrate.devices import (
    calibrate_recording,
    known_noise,
    plan_session,
    record_samples,
    recording,
)
from imuloop.calibrate.contradictions import odd_turns, why_changed
from imuloop.core.samples import CHANNELS
from imuloop.model.calibration import Calibration
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import example_truth
from plan.planned_log import simulate_plan, turns_between
from quick import diagnose_log

TRUTH = plan_session(example_truth(rate=50.0), poses=30)
FORCE, RATE = list(CHANNELS[:3]), list(CHANNELS[3:])
SWAP = [1, 0, 2]


def change_values(channels, values):
    """Return a recording with other values after two thirds of its log, and when that is."""
    samples = simulate_session(TRUTH, "multi_position", 0)
    late = np.arange(len(samples)) > 2 / 3 * len(samples)
    rows = samples.loc[late, channels].to_numpy()
    samples.loc[late, channels] = values(rows)
    return record_samples(samples), samples["t"].to_numpy()[late][0]


def is_near(words, time, room=20.0):
    """Return whether the time that words name is within `room` of another, s."""
    return abs(float(words.split("changed at about ")[1].split(" s:")[0]) - time) < room


@pytest.mark.parametrize("cut_s", [8.0, 20.0])
def test_a_stretch_that_is_cut_out_costs_one_turn(cut_s):
    samples = simulate_session(TRUTH, "multi_position", 0)
    n, t = len(samples), samples["t"].to_numpy()
    first = n // 2
    kept = np.r_[:first, first + int(cut_s * 50) : n]
    cut = samples.iloc[kept].assign(t=t[: len(kept)]).reset_index(drop=True)
    made = record_samples(cut)
    # a rest after it may be in the same attitude by chance
    assert len(made.lost.contradicting) <= 1
    for _, start, end, angle in made.lost.contradicting:
        assert start - 1 < t[first] < end + 1 and angle > 0.05
    noise = known_noise(TRUTH)
    whole = calibrate_recording(recording(TRUTH, 0), noise, TRUTH.gravity)[1]
    found = calibrate_recording(made, noise, TRUTH.gravity)[1]
    assert found.method == "multi_position"
    off = np.abs(found.K - whole.K) / found.std["K0"]
    assert off.max() < 4


@pytest.mark.parametrize("seed", range(2))
def test_nothing_contradicts_in_a_sound_recording(seed):
    made = recording(TRUTH, seed)
    assert made.lost.contradicting == ()
    assert not odd_turns(made)[0].any()
    for sensor in ("accelerometer", "gyroscope"):
        assert why_changed(sensor, made) is None


def test_a_bias_that_jumps_costs_no_more_than_the_turn_in_which_it_does():
    samples = simulate_session(TRUTH, "multi_position", 0)
    late = samples["t"].to_numpy() >= (when := 0.9 * samples["t"].iloc[-1])
    samples.loc[late, RATE] += 0.03
    made = record_samples(samples)
    assert all(start < when < end for _, start, end, _ in made.lost.contradicting)
    assert why_changed("gyroscope", made) is None


@pytest.mark.parametrize(
    "values",
    [lambda x: 0.5 * x, lambda x: x[:, SWAP], lambda x: x * [1, -1, 1]],
    ids=["half", "swapped", "turned around"],
)
def test_a_gyroscope_that_changed_has_no_fit_and_the_time_is_named(values):
    made, when = change_values(RATE, values)
    force, turn = calibrate_recording(made, known_noise(TRUTH), TRUTH.gravity)
    # its bias before and after has no mean that is right for either
    assert (force.method, turn.method) == ("multi_position", "nominal")
    assert turn.not_testable.startswith("the gyroscope, or an axis")
    assert is_near(turn.not_testable, when)


def test_a_gyroscope_that_changed_keeps_a_bias_that_did_not():
    b = TRUTH.gyroscope.b
    made, _ = change_values(RATE, lambda x: b + 0.5 * (x - b))
    _, turn = calibrate_recording(made, known_noise(TRUTH), TRUTH.gravity)
    assert turn.method == "static" and np.abs(turn.b - b).max() < 5 * max(turn.std.values())


@pytest.mark.parametrize("tilt", [3e-2, 3e-4])
def test_no_turn_contradicts_where_the_direction_of_gravity_is_not_known(tilt):
    """Faces x and y by turns about z, and z itself at the end: nine parameters are open."""
    for seed in range(2):
        rng = np.random.default_rng(seed)
        angle = np.pi / 2 * np.cumsum(rng.choice([1, -1, 2], 20))
        up = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(20)])
        up += rng.normal(0, tilt, (20, 3))
        up[-1] = 0.1, -0.1, 1.0
        up /= np.linalg.norm(up, axis=1)[:, None]
        made = record_samples(simulate_plan(TRUTH, up[0], turns_between(up), seed))
        for size in (1e-3, 3e-3):
            norm = 1 + rng.normal(0, size, len(made.poses))
            poses = replace(made.poses, f=made.poses.f * norm[:, None])
            assert not odd_turns(replace(made, poses=poses))[0].any()


def test_what_is_left_out_stands_in_the_diagnosis(tmp_path):
    samples = simulate_session(TRUTH, "multi_position", 0)
    t = samples["t"].to_numpy()
    kept = np.r_[: len(t) // 2, len(t) // 2 + 400 : len(t)]
    cut = samples.iloc[kept].assign(t=t[: len(kept)])
    sensors = diagnose_log(tmp_path, cut, gravity=TRUTH.gravity)
    [turn] = sensors["gyroscope"]["poses"]["contradicting"]
    assert turn["session"] == "log" and turn["start_s"] - 1 < t[len(t) // 2] < turn["end_s"] + 1
    assert sensors["gyroscope"]["poses"]["verdict"] == "consistent"


def test_an_accelerometer_that_changed_keeps_its_data_sheet(tmp_path):
    samples = simulate_session(TRUTH, "multi_position", 0)
    samples.loc[2 * len(samples) // 3 :, FORCE] *= 0.5
    sensors = diagnose_log(tmp_path, samples, gravity=TRUTH.gravity)
    assert sensors["accelerometer"]["poses"]["verdict"] == "not_testable"
    found = Calibration.from_json(tmp_path / "calibration.json")
    assert (found.accelerometer.method, found.gyroscope.method) == ("nominal", "static")
    assert "changed at about" in found.accelerometer.not_testable
    # the rates at rest need no direction of gravity
    assert np.abs(found.gyroscope.b - TRUTH.gyroscope.b).max() < 1e-3
