"""What a next recording is expected to do is what it does: simulated, added and fitted again."""

from dataclasses import replace

import numpy as np
import pytest

from bench.study.chain import diagnosis_of
from calibrate.devices import ACCELERATION_UNIT, RATE_UNIT, known_noise, recorded
from imuloop.calibrate.calibrate import start_pair
from imuloop.calibrate.sensor_pair import OfSensor
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.effect import FittedEffect
from imuloop.core.model import Calibration, SensorCalibration
from imuloop.core.noise_model import AxisNoise, Coefficient, NoiseModel, SinusoidTerm
from imuloop.core.samples import CHANNELS
from imuloop.core.units import STANDARD_GRAVITY
from imuloop.diagnose.diagnose import Diagnosed
from imuloop.diagnose.records.pose_diagnosis import PoseResult
from imuloop.effects.temperature import BiasTemperature
from imuloop.plan.information import Information
from imuloop.plan.next_recording import candidate_plans, directions_of, next_recording
from imuloop.plan.session import FULL_TURN_S
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import SessionTruth, example_truth
from imuloop.validate import attitude
from imuloop.validate.drift_residuals import DriftResiduals
from plan.planned_log import simulate_plan

SENSORS = ("accelerometer", "gyroscope")
HOLD_S, MOVE_S = 4.0, 2.0
SESSION = SessionTruth(
    "multi_position", 3, poses=14, rest_s=(HOLD_S, HOLD_S), move_s=(MOVE_S, MOVE_S)
)
TRUTH = example_truth(rate=50.0, sessions={"multi_position": SESSION})
NOISE = known_noise(TRUTH)


UNITS = dict(zip(SENSORS, (ACCELERATION_UNIT, RATE_UNIT), strict=True))


def diagnosed_as(recording, calibration, noise=NOISE, pair=None, solution=None):
    """Return a Diagnosed of a recording that was fitted, or not."""
    poses = PoseResult({}, pair, solution)
    return Diagnosed({}, calibration, {}, noise, poses, recording, [], {})


def fitted(recording, noise=NOISE, effects=()):
    """Return the Diagnosed of a recording; effects are of the gyroscope."""
    pair, _ = start_pair(recording, noise, TRUTH.gravity, UNITS, CalibrateSettings())
    solution = pair.fit(recording, tuple(OfSensor(e, "gyroscope") for e in effects))
    calibration = Calibration("example", TRUTH.gravity, **pair.calibrations(solution))
    return diagnosed_as(recording, calibration, noise, pair, solution)


def unfitted(noise, recording, calibration=None):
    """Return what is expected of a device whose poses are fitted nowhere, as logged."""
    if calibration is None:
        sensors = (SensorCalibration.nominal(unit, "none") for unit in UNITS.values())
        calibration = Calibration("example", TRUTH.gravity, *sensors)
    return next_recording(diagnosed_as(recording, calibration, noise))


@pytest.fixture(scope="module")
def first():
    log = simulate_session(TRUTH, "multi_position", 4)
    recording = recorded(log)
    found = fitted(recording)
    known = Information.of(found)
    plans = candidate_plans(recording, found.calibration, known)
    return log, next_recording(found), plans, known.excess


@pytest.mark.parametrize("name", ["poses", "turns"])
def test_expected_errors_are_those_of_a_fit_with_the_recording_added(first, name):
    log, content, plans, excess = first
    # the last of a name has the most
    *_, k = (k for k, (entry, _) in enumerate(plans) if entry["name"] == name)
    entry, plan = plans[k]
    # by hand as before: what was planned is what the segmentation saw of it
    planned = np.broadcast_to(plan.move_s, len(plan.turns))
    move = np.where(planned < FULL_TURN_S, MOVE_S, FULL_TURN_S)
    more = simulate_plan(TRUTH, plan, 4, HOLD_S, move)
    both = fitted(recorded(log, more))
    for sensor, found in content["sensors"].items():
        expected = found["candidates"][k]
        assert {key: expected[key] for key in entry} == entry
        # the reduced χ² of a few poses is mostly chance, so it is taken out of both
        std = np.array(list(getattr(both.calibration, sensor).std.values()))
        std = std / np.sqrt(max(1.0, both.poses.solution.fit.reduced_chi2))
        ratio = np.array(list(expected["std"].values())) / np.sqrt(excess[sensor]) / std
        assert np.all(np.abs(ratio - 1) < 0.15), (sensor, ratio)


def test_more_poses_never_raise_an_error_and_the_same_again_halves_the_variance(first):
    for found in first[1]["sensors"].values():
        rows = [c["std"] for c in found["candidates"] if c["name"] == "poses"]
        now = {name: p["std"] for name, p in found["parameters"].items()}
        for less, more in zip([now, *rows], rows, strict=False):
            assert all(more[name] < less[name] for name in now)
        again = next(c for c in found["candidates"] if c["name"] == "again")
        for name, std in now.items():
            # 11 % at most by the covariance of one sensor with the other, which is not kept, and by
            # the excess, which the fit has of a kind of residual and the plan of a sensor
            assert again["std"][name] == pytest.approx(std / np.sqrt(2), rel=0.15)


def test_turns_are_as_many_as_the_level_needs(first):
    turns, gyroscope = first[1]["turns"], first[1]["sensors"]["gyroscope"]
    assert turns["std_after"] < turns["std"]
    assert turns["std_after"] <= turns["level"] or turns["turns"] == 64
    axis = "xyz".index(turns["axis"])
    stds = [gyroscope["parameters"][f"K{i}"]["std"] for i in range(3)]
    assert turns["std"] == max(stds) == stds[axis]
    assert 0 < turns["largest_deg"][axis] <= 180.0 < turns["turned_deg"][axis]


def test_an_error_weighs_as_much_as_it_moves_the_output(first):
    one = np.sqrt(NOISE.mean_covariance(np.array([[0.0, 1.0]]))[:, 0, 0])
    force, turn = (first[1]["sensors"][sensor]["parameters"] for sensor in SENSORS)
    assert force["K1"]["weight"] == pytest.approx(force["K1"]["std"] * TRUTH.gravity / one[1])
    assert turn["T20"]["weight"] == pytest.approx(turn["T20"]["std"] * np.radians(100) / one[5])
    assert turn["b0"]["weight"] == pytest.approx(turn["b0"]["std"] / one[3])


def test_without_a_session_a_first_one_is_expected_from_the_noise_alone():
    content = unfitted(NOISE, recorded())
    assert content["turns"] == {}
    # as the simulated 40 poses are calibrated, within the difference of their attitudes
    made = fitted(recorded(simulate_session(example_truth(), "multi_position", 1)))
    chi2 = made.poses.solution.fit.reduced_chi2
    for sensor in SENSORS:
        found = content["sensors"][sensor]
        assert all(p["std"] is None for p in found["parameters"].values())
        [expected] = found["candidates"]
        actual = getattr(made.calibration, sensor).std
        ratio = np.array([expected["std"][n] / actual[n] for n in actual]) * max(1.0, chi2) ** 0.5
        assert np.all((ratio > 0.6) & (ratio < 1.6)), ratio


def test_heating_and_cooling_shows_what_a_temperature_does():
    values = dict.fromkeys(BiasTemperature().parameters, 1e-4)
    effect = FittedEffect(BiasTemperature(), values, {})
    warm = replace(SESSION, temperature=((0.0, 20.0), (400.0, 22.0)))
    turn = replace(TRUTH.gyroscope, effects=(effect,))
    truth = replace(TRUTH, gyroscope=turn, sessions={"multi_position": warm})
    recording = recorded(simulate_session(truth, "multi_position", 5))
    content = next_recording(fitted(recording, NOISE, (BiasTemperature(),)))
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
    params=[
        "poses and static",
        *(pytest.param(kept, marks=pytest.mark.study) for kept in ("static", "poses")),
    ],
)
def diagnosed(request):
    """Return what a device that temperature changes is known to, wherever that is said.

    The content of next_recording; the Calibration of calibration.json, and the one that the
    validation of the attitude is given; the CalibratedPair that `check` tests a new log against.
    """
    values = dict.fromkeys(BiasTemperature().parameters, 1e-4)
    effect = FittedEffect(BiasTemperature(), values, {})
    truth = replace(TRUTH, gyroscope=replace(TRUTH.gyroscope, effects=(effect,)))
    poses = replace(SESSION, temperature=((0.0, 20.0), (150.0, 22.0)))
    course = ((0.0, 20.0), (450.0, 40.0), (900.0, 20.0))
    sessions = {"poses": poses, "static": SessionTruth("static", 1, duration_s=900.0)}
    sessions["static"] = replace(sessions["static"], temperature=course)
    kept = {name: sessions[name] for name in request.param.split(" and ")}
    new_log = recorded(simulate_session(replace(truth, sessions=sessions), "poses", 9))
    truth = in_usual_units(truth, "accelerometer", "g", STANDARD_GRAVITY)
    truth = in_usual_units(truth, "gyroscope", "deg/s", np.radians(1))

    def read(truth, sessions, folder):
        calibration = Calibration.from_json(folder / "calibration.json")
        # `diagnosis_of` stands in for it
        _, given, _ = attitude.validate_attitude.call_args.args
        return calibration, given.calibration

    device = replace(truth, sessions=kept)
    found, (calibration, given) = diagnosis_of(device, 3, read, limits=False, motion=True)
    checked = DriftResiduals.of(calibration, new_log, NOISE, calibration.gravity).old
    return found["next_recording"], calibration, given, checked, request.param


@pytest.mark.parametrize("sensor", SENSORS)
def test_what_is_known_is_the_same_wherever_it_is_said(diagnosed, sensor):
    """Protects σ of each parameter: next_recording had 150 times that of calibration.json.

    It left out all that other records than the poses say; the validation of the attitude had a
    calibration of its own. Of every parameter, whatever record it is from, in other units too.
    """
    content, calibration, given, checked, sessions = diagnosed
    found, expected = content["sensors"][sensor], std_of(getattr(calibration, sensor))
    # not of nothing: T, K and b by poses, and what the static record shows of the temperature
    assert "poses" not in sessions or {"T01", "K0", "b0"} <= set(expected)
    assert sensor == "accelerometer" or "static" not in sessions or any("." in n for n in expected)
    planned = {name: p["std"] for name, p in found["parameters"].items()}
    in_check = dict(zip(checked.names, np.sqrt(np.diag(checked.covariance)), strict=True))
    for name, std in expected.items():
        assert planned[name] == pytest.approx(std, rel=1e-6), name
        assert in_check[f"{sensor}.{name}"] == pytest.approx(std, rel=1e-6), name
    assert std_of(getattr(given, sensor)) == pytest.approx(expected, rel=1e-6)
    for candidate in found["candidates"]:
        for name, std in candidate["std"].items():
            now = planned[name]
            assert now is None or std <= now * (1 + 1e-6), (candidate["name"], name)


def std_of(own):
    """Return the standard errors of all that a SensorCalibration holds, SI."""
    unit = {"K": 1 / own.raw_unit.scale, "b": own.raw_unit.scale}
    held = {n: std * (1.0 if "." in n else unit.get(n[0], 1.0)) for n, std in own.std.items()}
    return held | {f"{e.name}.{p}": std for e in own.effects for p, std in e.std.items()}


def test_nothing_is_expected_where_the_noise_is_unknown(first):
    recording = recorded(first[0])
    line = AxisNoise(sinusoid=(SinusoidTerm(Coefficient(1e-3), Coefficient(4.613)),))
    variance = recording.poses.variance.copy()
    variance[3, 5] = 0.0
    silent = replace(recording, poses=replace(recording.poses, variance=variance))
    calibration = fitted(recording).calibration
    for axes, poses in (
        (dict.fromkeys(CHANNELS, AxisNoise()), recorded()),
        # lines alone, and an axis whose noise no rest was long enough for
        (NOISE.axes | {"gy": line}, recorded()),
        (NOISE.axes | {"gz": AxisNoise()}, silent),
    ):
        assert unfitted(NoiseModel("example", axes), poses, calibration) == {}


@pytest.mark.parametrize(("rests", "term"), zip(range(1, 7), "BKBKBK", strict=True))
def test_a_plan_needs_no_white_noise_that_a_short_log_does_not_show(rests, term):
    slow = AxisNoise(**{term: Coefficient(1e-3, (5e-4, 2e-3), 2e-3, True)})
    noise = NoiseModel("example", NOISE.axes | dict.fromkeys(CHANNELS[3:], slow))
    session = {"multi_position": replace(SESSION, poses=max(rests - 1, 1), initial_rest_s=8.0)}
    log = simulate_session(replace(TRUTH, sessions=session), "multi_position", 2)
    recording = recorded(log if rests > 1 else log[log["t"] < 7.0])
    assert len(recording.poses) == rests
    candidates = unfitted(noise, recording)["sensors"]["gyroscope"]["candidates"]
    assert all(0 < c["std"]["b0"] < 0.1 for c in candidates if c["name"] == "poses")


def test_poses_without_specific_force_know_nothing(first):
    recording = recorded(first[0])
    f = recording.poses.f * np.where(np.arange(len(recording.poses)) < 4, 1e-200, 1.0)[:, None]
    deaf = replace(recording, poses=replace(recording.poses, f=f))
    calibration = fitted(recording).calibration
    lacking = replace(calibration, accelerometer=SensorCalibration.nominal(ACCELERATION_UNIT, ""))
    for poses, known in ((deaf, False), (recording, True)):
        found = Information.of(diagnosed_as(poses, lacking)).std()
        assert (None in found.values()) != known
    assert len(directions_of(deaf, lacking)) == len(deaf.poses) - 4
