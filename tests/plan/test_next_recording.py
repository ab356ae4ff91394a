"""What a next recording is expected to do is what it does: simulated, added and fitted again."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest

from bench.study.chain import diagnosis_of
from calibrate.devices import ACCELERATION_UNIT, RATE_UNIT, known_noise, recorded
from diagnose.models import accelerometer_poses, pose_sensors
from imuloop.calibrate.pose_fits import GyroscopePoses, fitted_calibration
from imuloop.core.effect import FittedEffect
from imuloop.core.model import Calibration, SensorCalibration
from imuloop.core.noise_model import AxisNoise, Coefficient, NoiseModel, SinusoidTerm
from imuloop.core.samples import CHANNELS
from imuloop.core.units import STANDARD_GRAVITY
from imuloop.effects.bias_temperature import BiasTemperature
from imuloop.plan.information import Information
from imuloop.plan.next_recording import candidate_plans, directions_of, next_recording
from imuloop.plan.session import FULL_TURN_S
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import SessionTruth, example_truth
from plan.planned_log import simulate_plan

SENSORS = ("accelerometer", "gyroscope")
HOLD_S, MOVE_S = 4.0, 2.0
SESSION = SessionTruth(
    "multi_position", 3, poses=14, rest_s=(HOLD_S, HOLD_S), move_s=(MOVE_S, MOVE_S)
)
TRUTH = example_truth(rate=50.0, sessions={"multi_position": SESSION})
NOISE = known_noise(TRUTH)


def fitted(recording, noise=NOISE, effects=()):
    """Return models, solutions and the calibration of a recording; effects of the gyroscope."""
    models, solutions = pose_sensors(TRUTH, recording, noise), {}
    for (sensor, model), own in zip(models.items(), ((), effects), strict=True):
        found = model.fit(recording, own)
        solutions[sensor] = replace(found, calibration=fitted_calibration(model, found))
    sensors = (solutions[sensor].calibration for sensor in SENSORS)
    return models, solutions, Calibration("example", TRUTH.gravity, *sensors)


def unfitted(noise, recording, calibration=None):
    """Return what is expected of a device whose poses are fitted nowhere, as logged."""
    if calibration is None:
        units = (ACCELERATION_UNIT, RATE_UNIT)
        sensors = (SensorCalibration.nominal(unit, "none") for unit in units)
        calibration = Calibration("example", TRUTH.gravity, *sensors)
    force = accelerometer_poses(TRUTH, noise)
    turn = GyroscopePoses(noise, calibration.accelerometer, RATE_UNIT, force.settings)
    models = dict(zip(SENSORS, (force, turn), strict=True))
    return next_recording(models, dict.fromkeys(SENSORS), calibration, recording)


@pytest.fixture(scope="module")
def first():
    log = simulate_session(TRUTH, "multi_position", 4)
    recording = recorded(log)
    models, solutions, calibration = fitted(recording)
    content = next_recording(models, solutions, calibration, recording)
    known = {s: Information.of(models[s], solutions[s], calibration, recording) for s in SENSORS}
    return log, content, candidate_plans(recording, calibration, known)


@pytest.mark.parametrize(("name", "count"), [("poses", 20), ("turns", 16)])
def test_expected_errors_are_those_of_a_fit_with_the_recording_added(first, name, count):
    log, content, plans = first
    [k] = (
        k
        for k, (entry, _) in enumerate(plans)
        if (entry["name"], entry["turns"] or entry["poses"]) == (name, count)
    )
    entry, plan = plans[k]
    # by hand as before: what was planned is what the segmentation saw of it
    planned = np.broadcast_to(plan.move_s, len(plan.turns))
    move = np.where(planned < FULL_TURN_S, MOVE_S, FULL_TURN_S)
    more = simulate_plan(TRUTH, plan, 4, HOLD_S, move)
    _, solutions, _ = fitted(recorded(log, more))
    for sensor, found in content["sensors"].items():
        expected, solution = found["candidates"][k], solutions[sensor]
        assert {key: expected[key] for key in entry} == entry
        # the reduced χ² of a few poses is mostly chance, so it is taken out of both
        std = np.array(list(solution.calibration.std.values()))
        std = std / np.sqrt(max(1.0, solution.fit.reduced_chi2))
        ratio = np.array(list(expected["std"].values())) / np.sqrt(found["excess"]) / std
        assert np.all(np.abs(ratio - 1) < 0.15), (sensor, ratio)


def test_more_poses_never_raise_an_error_and_the_same_again_halves_the_variance(first):
    for found in first[1]["sensors"].values():
        rows = [c["std"] for c in found["candidates"] if c["name"] == "poses"]
        now = {name: p["std"] for name, p in found["parameters"].items()}
        for less, more in zip([now, *rows], rows, strict=False):
            assert all(more[name] < less[name] for name in now)
        again = next(c for c in found["candidates"] if c["name"] == "again")
        for name, std in now.items():
            assert again["std"][name] == pytest.approx(std / np.sqrt(2))


def test_turns_are_as_many_as_the_level_needs(first):
    turns, gyroscope = first[1]["turns"], first[1]["sensors"]["gyroscope"]
    assert turns["std_after"] < turns["std"]
    assert turns["std_after"] <= turns["level"] or turns["turns"] == 64
    axis = "xyz".index(turns["axis"])
    stds = [gyroscope["parameters"][f"K{i}"]["std"] for i in range(3)]
    assert turns["std"] == max(stds) == stds[axis]
    assert 0 < turns["largest_deg"][axis] <= 180.0 < turns["turned_deg"][axis]


def test_an_error_weighs_as_much_as_it_moves_the_output(first):
    one = np.sqrt(NOISE.pose_mean_covariance(np.array([[0.0, 1.0]]))[:, 0, 0])
    force, turn = (first[1]["sensors"][sensor]["parameters"] for sensor in SENSORS)
    assert force["K1"]["weight"] == pytest.approx(force["K1"]["std"] * TRUTH.gravity / one[1])
    assert turn["T20"]["weight"] == pytest.approx(turn["T20"]["std"] * np.radians(100) / one[5])
    assert turn["b0"]["weight"] == pytest.approx(turn["b0"]["std"] / one[3])


def test_without_a_session_a_first_one_is_expected_from_the_noise_alone():
    content = unfitted(NOISE, recorded())
    assert content["turns"] == {}
    # as the simulated 40 poses are calibrated, within the difference of their attitudes
    _, solutions, _ = fitted(recorded(simulate_session(example_truth(), "multi_position", 1)))
    for sensor in SENSORS:
        found = content["sensors"][sensor]
        assert all(p["std"] is None for p in found["parameters"].values())
        [expected] = found["candidates"]
        actual, chi2 = solutions[sensor].calibration.std, solutions[sensor].fit.reduced_chi2
        ratio = np.array([expected["std"][n] / actual[n] for n in actual]) * max(1.0, chi2) ** 0.5
        assert np.all((ratio > 0.6) & (ratio < 1.6)), ratio


def test_heating_and_cooling_shows_what_a_temperature_does():
    values = dict.fromkeys(BiasTemperature().parameters, 1e-4)
    effect = FittedEffect(BiasTemperature(), values, {})
    warm = replace(SESSION, temperature=((0.0, 20.0), (400.0, 22.0)))
    turn = replace(TRUTH.gyroscope, effects=(effect,))
    truth = replace(TRUTH, gyroscope=turn, sessions={"multi_position": warm})
    recording = recorded(simulate_session(truth, "multi_position", 5))
    content = next_recording(*fitted(recording, NOISE, (BiasTemperature(),)), recording)
    found = content["sensors"]["gyroscope"]
    by_name = {(c["name"], c["poses"]): c for c in found["candidates"]}
    (name, *_) = (n for n in found["parameters"] if n.startswith("bias_temperature."))
    heated, not_heated = (by_name[k, 20]["std"][name] for k in ("heat_and_cool", "poses"))
    assert by_name["heat_and_cool", 20]["span_K"] == pytest.approx(20.0)
    assert heated < 0.3 * not_heated < found["parameters"][name]["std"]


def in_usual_units(truth, sensor, name, unit):
    """Return a device whose log has a sensor in another unit, of so much SI."""
    own = getattr(truth, sensor)
    return replace(truth, **{sensor: replace(own, raw_unit=name, K=own.K * unit, b=own.b / unit)})


@pytest.fixture(
    scope="module",
    params=["poses and static", "static", pytest.param("poses", marks=pytest.mark.study)],
)
def diagnosed(request):
    """Return next_recording and the Calibration of a device that temperature changes."""
    truth = in_usual_units(TRUTH, "accelerometer", "g", STANDARD_GRAVITY)
    truth = in_usual_units(truth, "gyroscope", "deg/s", np.radians(1))
    values = dict.fromkeys(BiasTemperature().parameters, 1e-4)
    effect = FittedEffect(BiasTemperature(), values, {})
    truth = replace(truth, gyroscope=replace(truth.gyroscope, effects=(effect,)))
    poses = replace(SESSION, temperature=((0.0, 20.0), (150.0, 22.0)))
    course = ((0.0, 20.0), (450.0, 40.0), (900.0, 20.0))
    sessions = {"poses": poses, "static": SessionTruth("static", 1, duration_s=900.0)}
    sessions["static"] = replace(sessions["static"], temperature=course)
    kept = {name: sessions[name] for name in request.param.split(" and ")}
    truth = replace(truth, sessions=kept)

    def read(truth, sessions, folder):
        return Calibration.from_json(folder / "calibration.json")

    with patch("imuloop.discover.beyond.beyond", return_value=None):
        found, calibration = diagnosis_of(truth, 3, read, limits=False, motion=True)
    return found["next_recording"], calibration, request.param


@pytest.mark.parametrize("sensor", SENSORS)
def test_what_is_known_now_is_what_the_calibration_says(diagnosed, sensor):
    """Protects σ now: it left out all that other records than the poses say, and was 150 times it.

    Of every parameter that calibration.json holds, whatever record it is from, in other units too.
    """
    content, calibration, sessions = diagnosed
    own, found = getattr(calibration, sensor), content["sensors"][sensor]
    unit = {"K": 1 / own.raw_unit.scale, "b": own.raw_unit.scale}
    held = {n: std * (1.0 if "." in n else unit.get(n[0], 1.0)) for n, std in own.std.items()}
    held |= {f"{e.name}.{p}": std for e in own.effects for p, std in e.std.items()}
    # not of nothing: T, K and b by poses, and what the static record shows of the temperature
    assert "poses" not in sessions or {"T01", "K0", "b0"} <= set(held)
    assert sensor == "accelerometer" or "static" not in sessions or any("." in n for n in held)
    assert set(held) <= set(found["parameters"])
    for name, std in held.items():
        assert found["parameters"][name]["std"] == pytest.approx(std, rel=1e-6), name
    for candidate in found["candidates"]:
        for name, std in candidate["std"].items():
            now = found["parameters"][name]["std"]
            assert now is None or std <= now * (1 + 1e-6), (candidate["name"], name)


def test_nothing_is_expected_where_the_noise_is_unknown(first):
    recording = recorded(first[0])
    line = AxisNoise(sinusoid=(SinusoidTerm(Coefficient(1e-3), Coefficient(4.613)),))
    variance = recording.poses.variance.copy()
    variance[3, 5] = 0.0
    silent = replace(recording, poses=replace(recording.poses, variance=variance))
    calibration = fitted(recording)[2]
    for axes, poses in (
        (dict.fromkeys(CHANNELS, AxisNoise()), recorded()),
        # lines alone, and an axis whose noise no rest was long enough for
        (NOISE.axes | {"gy": line}, recorded()),
        (NOISE.axes | {"gz": AxisNoise()}, silent),
    ):
        assert unfitted(NoiseModel("example", axes), poses, calibration) == {}


def test_poses_without_specific_force_know_nothing(first):
    recording = recorded(first[0])
    f = recording.poses.f * np.where(np.arange(len(recording.poses)) < 4, 1e-200, 1.0)[:, None]
    deaf = replace(recording, poses=replace(recording.poses, f=f))
    force, calibration = accelerometer_poses(TRUTH, NOISE), fitted(recording)[2]
    lacking = replace(calibration, accelerometer=SensorCalibration.nominal(ACCELERATION_UNIT, ""))
    for poses, known in ((deaf, False), (recording, True)):
        found = Information.of(force, None, lacking, poses).std()
        assert (None in found.values()) != known
    assert len(directions_of(deaf, lacking)) == len(deaf.poses) - 4
