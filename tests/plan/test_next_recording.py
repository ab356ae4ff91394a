"""What the next recording is expected to do is what it does: simulated, added and fitted again."""

from dataclasses import replace

import numpy as np
import pytest

from calibrate.devices import ACCELERATION_UNIT, RATE_UNIT, difference, known_noise
from diagnose.models import accelerometer_poses, pose_sensors
from imuloop.calibrate.pose_fits import GyroscopePoses, fitted_calibration
from imuloop.calibrate.recording import record
from imuloop.core.effect import FittedEffect
from imuloop.core.model import Calibration, SensorCalibration
from imuloop.core.noise_model import AxisNoise, Coefficient, NoiseModel, Sinusoid
from imuloop.core.samples import CHANNELS
from imuloop.effects.bias_temperature import BiasTemperature
from imuloop.plan.next_recording import candidate_plans, directions_of, next_recording
from imuloop.plan.information import Information
from imuloop.plan.session import FULL_TURN_S
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import Session, example_truth
from plan.planned_log import simulate_plan

SENSORS = ("accelerometer", "gyroscope")
HOLD_S, MOVE_S = 4.0, 2.0
SESSION = Session("multi_position", 3, poses=14, rest_s=(HOLD_S, HOLD_S), move_s=(MOVE_S, MOVE_S))
TRUTH = example_truth(sessions={"multi_position": SESSION})
NONE = dict.fromkeys(SENSORS)


def recorded(*samples):
    segments = [segment_session(s, "multi_position", SegmentSettings())[0] for s in samples]
    return record(list(samples), segments, 30.0)


def fitted(recording, noise, effects=()):
    """Return models, solutions and the calibration of a recording; effects of the gyroscope."""
    models, solutions = pose_sensors(TRUTH, recording, noise), {}
    for (sensor, model), own in zip(models.items(), ((), effects), strict=True):
        found = model.fit(recording, own)
        solutions[sensor] = replace(found, calibration=fitted_calibration(model, found))
    sensors = (solutions[sensor].calibration for sensor in SENSORS)
    return models, solutions, Calibration("example", TRUTH.gravity, *sensors)


def unfitted(noise, calibration):
    """Return the models of a device whose poses are fitted nowhere."""
    force = accelerometer_poses(TRUTH, noise)
    turn = GyroscopePoses(noise, calibration.accelerometer, RATE_UNIT, force.settings)
    return dict(zip(SENSORS, (force, turn), strict=True))


def nominal():
    """Return the calibration of a device as logged."""
    sensors = (SensorCalibration.nominal(unit, "none") for unit in (ACCELERATION_UNIT, RATE_UNIT))
    return Calibration("example", TRUTH.gravity, *sensors)


def expectation(seed, truth=TRUTH):
    """Return what is expected of a simulated device, the plans, and its first samples."""
    first = simulate_session(truth, "multi_position", seed)
    recording = recorded(first)
    models, solutions, calibration = fitted(recording, known_noise(truth))
    content = next_recording(models, solutions, calibration, recording)
    views = {s: Information.of(models[s], solutions[s], None, None, recording) for s in SENSORS}
    return content, candidate_plans(recording, calibration, views), first


def comparison(seed, chosen):
    """Return what comes after the candidates chosen: expected σ, σ and error of a fit, by sensor.

    The reduced χ² of a few poses is mostly chance, so it is taken out of both.
    """
    content, plans, first = expectation(seed)
    noise = known_noise(TRUTH)
    found = {sensor: [] for sensor in SENSORS}
    for k, (entry, plan) in enumerate(plans):
        if (entry["name"], entry["turns"] or entry["poses"]) not in chosen:
            continue
        # by hand as before: what was planned is what the segmentation saw of it
        planned = np.broadcast_to(plan.move_s, len(plan.turns))
        move = np.where(planned < FULL_TURN_S, MOVE_S, FULL_TURN_S)
        more = simulate_plan(TRUTH, plan, seed, HOLD_S, move)
        _, solutions, calibration = fitted(recorded(first, more), noise)
        for sensor in SENSORS:
            expected = content["sensors"][sensor]["candidates"][k]
            assert {key: expected[key] for key in entry} == entry
            solution = solutions[sensor]
            names = solution.calibration.names
            wanted = np.array([expected["std"][n] for n in names])
            wanted = wanted / np.sqrt(content["sensors"][sensor]["excess"])
            std = np.sqrt(np.diag(solution.calibration.covariance))
            std = std / np.sqrt(max(1.0, solution.fit.chi2 / solution.fit.dof))
            error = difference(getattr(calibration, sensor), getattr(TRUTH, sensor), names)
            found[sensor].append((wanted, std, error))
    assert all(len(rows) == len(chosen) for rows in found.values())
    return {sensor: np.array(rows) for sensor, rows in found.items()}


@pytest.mark.parametrize("seed", [1, 2])
def test_expected_errors_are_those_of_a_fit_with_the_recording_added(seed):
    for sensor, rows in comparison(seed, {("poses", 20), ("turns", 16)}).items():
        ratio = rows[:, 0] / rows[:, 1]
        assert np.all(np.abs(ratio - 1) < 0.15), (sensor, ratio)


@pytest.fixture(scope="module")
def content():
    return expectation(4)[0]


def test_the_same_session_again_halves_the_variance(content):
    for found in content["sensors"].values():
        again = next(c for c in found["candidates"] if c["name"] == "again")
        for name, now in found["parameters"].items():
            assert again["std"][name] == pytest.approx(now["std"] / np.sqrt(2))


def test_more_poses_never_raise_an_error(content):
    for found in content["sensors"].values():
        rows = [c["std"] for c in found["candidates"] if c["name"] == "poses"]
        now = {name: p["std"] for name, p in found["parameters"].items()}
        for less, more in zip([now, *rows], rows, strict=False):
            assert all(more[name] < less[name] for name in now)


def test_turns_are_as_many_as_the_level_needs(content):
    turns = content["turns"]
    assert turns["std_after"] < turns["std"]
    assert turns["std_after"] <= turns["level"] or turns["turns"] == 64
    axis = "xyz".index(turns["axis"])
    stds = [content["sensors"]["gyroscope"]["parameters"][f"K{i}"]["std"] for i in range(3)]
    assert turns["std"] == max(stds) == stds[axis]
    assert 0 < turns["largest_deg"][axis] <= 180.0 < turns["turned_deg"][axis]
    mean = turns["turned_deg"][axis] / 14 / (MOVE_S + 1)
    assert mean < turns["mean_deg_s"][axis] < turns["largest_deg"][axis] / MOVE_S


def test_an_error_weighs_as_much_as_it_moves_the_output(content):
    noise = known_noise(TRUTH)
    one = np.sqrt(noise.pose_mean_covariance(np.array([[0.0, 1.0]]))[:, 0, 0])
    force = content["sensors"]["accelerometer"]["parameters"]
    turn = content["sensors"]["gyroscope"]["parameters"]
    assert force["K1"]["weight"] == pytest.approx(force["K1"]["std"] * TRUTH.gravity / one[1])
    assert turn["T20"]["weight"] == pytest.approx(turn["T20"]["std"] * np.radians(100) / one[5])
    assert turn["b0"]["weight"] == pytest.approx(turn["b0"]["std"] / one[3])


def test_without_a_session_a_first_one_is_expected_from_the_noise_alone():
    noise = known_noise(TRUTH)
    device = nominal()
    content = next_recording(unfitted(noise, device), NONE, device, record([], [], 30.0))
    assert content["turns"] == {}
    # as the simulated 40 poses are calibrated, within the difference of their attitudes
    _, solutions, _ = fitted(
        recorded(simulate_session(example_truth(), "multi_position", 1)), noise
    )
    for sensor in SENSORS:
        found = content["sensors"][sensor]
        assert all(p["std"] is None for p in found["parameters"].values())
        (first,) = found["candidates"]
        solution = solutions[sensor]
        actual = solution.calibration.std
        excess = np.sqrt(max(1.0, solution.fit.chi2 / solution.fit.dof))
        ratio = np.array([first["std"][n] / actual[n] * excess for n in actual])
        assert np.all((ratio > 0.6) & (ratio < 1.6)), ratio


def test_heating_and_cooling_shows_what_a_temperature_does():
    values = dict.fromkeys(BiasTemperature().parameters, 1e-4)
    effect = FittedEffect(BiasTemperature(), values, {})
    warm = replace(SESSION, temperature=((0.0, 20.0), (400.0, 22.0)))
    truth = replace(
        TRUTH,
        gyroscope=replace(TRUTH.gyroscope, effects=(effect,)),
        sessions={"multi_position": warm},
    )
    recording = recorded(simulate_session(truth, "multi_position", 5))
    made = fitted(recording, known_noise(truth), (BiasTemperature(),))
    content = next_recording(*made, recording)
    found = content["sensors"]["gyroscope"]
    by_name = {(c["name"], c["poses"]): c for c in found["candidates"]}
    (name, *_) = (n for n in found["parameters"] if n.startswith("bias_temperature."))
    heated, not_heated = (by_name[k, 20]["std"][name] for k in ("heat_and_cool", "poses"))
    assert by_name["heat_and_cool", 20]["span_K"] == pytest.approx(20.0)
    assert heated < 0.3 * not_heated < found["parameters"][name]["std"]


def test_nothing_is_expected_where_the_noise_is_unknown():
    noise = NoiseModel("example", {c: AxisNoise() for c in CHANNELS})
    models = unfitted(noise, nominal())
    assert next_recording(models, NONE, None, record([], [], 30.0)) == {}


def test_nothing_is_expected_of_poses_beside_lines_alone():
    line = AxisNoise(sinusoid=(Sinusoid(Coefficient(1e-3), Coefficient(4.613)),))
    noise = NoiseModel("example", known_noise(TRUTH).axes | {"gy": line})
    *_, calibration = fitted(
        recorded(simulate_session(TRUTH, "multi_position", 5)), known_noise(TRUTH)
    )
    models = unfitted(noise, calibration)
    assert next_recording(models, NONE, calibration, record([], [], 30.0)) == {}


def test_the_same_again_lasts_as_long_as_its_sessions_together():
    # the clock of each session begins anew: the last one may end before the first
    short = replace(TRUTH.sessions["multi_position"], poses=12, initial_rest_s=5.0)
    long = simulate_session(TRUTH, "multi_position", 3)
    short = simulate_session(replace(TRUTH, sessions={"multi_position": short}), "multi_position")
    recording = recorded(long, short)
    content = next_recording(*fitted(recording, known_noise(TRUTH)), recording)
    again = content["sensors"]["accelerometer"]["candidates"][-1]
    assert again["name"] == "again"
    assert again["duration_s"] == pytest.approx(long.t.iloc[-1] + short.t.iloc[-1], rel=0.02)


def test_nothing_is_expected_where_a_pose_shows_no_noise():
    # of an axis whose noise no rest was long enough for
    first = simulate_session(TRUTH, "multi_position", 5)
    recording = recorded(first)
    variance = recording.poses.variance.copy()
    variance[3, 5] = 0.0
    poses = replace(recording.poses, variance=variance)
    noise = known_noise(TRUTH)
    noise = NoiseModel("example", noise.axes | {"gz": AxisNoise()})
    *_, calibration = fitted(recording, known_noise(TRUTH))
    models = unfitted(noise, calibration)
    assert next_recording(models, NONE, calibration, replace(recording, poses=poses)) == {}


def test_poses_without_specific_force_know_nothing():
    recording = recorded(simulate_session(TRUTH, "multi_position", 5))
    models, *_ = fitted(recording, known_noise(TRUTH))
    f = recording.poses.f * np.where(np.arange(len(recording.poses)) < 4, 1e-200, 1.0)[:, None]
    deaf = replace(recording, poses=replace(recording.poses, f=f))
    device, force = nominal(), models["accelerometer"]
    own = device.accelerometer
    assert len(directions_of(deaf, device)) == len(deaf.poses) - 4
    assert set(Information.of(force, None, own, own, deaf).std().values()) == {None}
    assert None not in Information.of(force, None, own, own, recording).std().values()
