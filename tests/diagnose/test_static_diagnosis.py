"""Static records from samples to the fields of the diagnosis, the calibration and the noise."""

import json

import numpy as np
import pandas as pd
import pytest

import imuloop.effects  # noqa: F401  the library of effects
from diagnose.records import LENGTH
from diagnose.records import record as made_record
from diagnose.test_means import calibration
from imuloop.core import rest_log
from imuloop.core.noise_model import AxisNoise, Coefficient, NoiseModel, Sinusoid
from imuloop.core.samples import CHANNELS
from imuloop.diagnose.records.rests import StaticData
from imuloop.diagnose.records.static_content import static_content
from imuloop.diagnose.records.static_diagnosis import diagnose_static, find, static_tests
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.noise.correction import corrected
from imuloop.noise.noise import estimate_noise
from imuloop.noise.records import Session
from imuloop.noise.settings import NoiseSettings

RATE, SECONDS, WHITE = 4.0, 4000.0, 0.02
SENSORS = ("accelerometer", "gyroscope")
# m/s^2 and rad/s per K of each axis
SLOPES = (np.array([1e-2, -2e-2, 3e-2]), np.array([2e-2, 1e-2, -1e-2]))


def warmth(t):
    return 20 + 12 * np.sin(2 * np.pi * t / 3000.0)


def log(seed, slopes=(0.0, 0.0), extra=None, up=(0.1, -0.2, 9.8)):
    n = int(SECONDS * RATE)
    t = np.arange(n) / RATE
    x = np.random.default_rng(seed).normal(scale=WHITE * np.sqrt(RATE), size=(n, 6))
    x[:, :3] += up
    x += np.column_stack([np.outer(warmth(t) - 20, np.ones(3) * s) for s in slopes])
    if extra is not None:
        x += extra(t)
    return pd.DataFrame({"t": t, **dict(zip(CHANNELS, x.T, strict=True)), "temperature": warmth(t)})


def data(**samples):
    whole = pd.DataFrame({"start_s": [0.0], "end_s": [SECONDS], "kind": ["static"]})
    return StaticData(dict.fromkeys(samples, "static"), samples, dict.fromkeys(samples, whole))


def noise_of(made):
    sessions = [Session(n, "static", s, made.segments[n]) for n, s in made.samples.items()]
    return estimate_noise("d", sessions, NoiseSettings()).model


def diagnosed(made, noise=None):
    settings = DiagnoseSettings()
    records = records_of(made)
    return diagnose_static(
        made,
        records,
        calibration(),
        noise or noise_of(made),
        settings,
        NoiseSettings(),
        static_tests(records, settings),
    )


def records_of(made):
    mean_time = DiagnoseSettings().mean_time
    return {sensor: made.records(sensor, calibration(), mean_time) for sensor in SENSORS}


@pytest.fixture(scope="module")
def warm():
    made = data(a=log(1, SLOPES), b=log(2, SLOPES, up=(9.8, 0.3, -0.1)))
    noise = noise_of(made)
    return made, noise, diagnosed(made, noise)


def test_a_device_without_an_effect_is_consistent():
    result = diagnosed(data(a=log(3)))
    for sensor in SENSORS:
        content = result.content[sensor]
        assert content["verdict"] == "consistent"
        assert content["effects"] == [] and content["noise"] == {}
        residual = content["residuals"]["bias"]
        assert residual["before"] == residual["after"] == pytest.approx(residual["floor"], rel=0.1)
        # white noise of means over a minute on three axes, the level of the other blocks
        floor = WHITE * np.sqrt(3 / 60 * (1 + 1 / 58))
        assert residual["floor"] == pytest.approx(floor, rel=0.1)
    assert result.effects == {"accelerometer": (), "gyroscope": ()}
    assert result.allan == {}


@pytest.mark.parametrize("sensor, slopes", list(zip(SENSORS, SLOPES, strict=True)))
def test_a_bias_that_follows_the_temperature(warm, sensor, slopes):
    _, _, result = warm
    content = result.content[sensor]
    assert content["verdict"] == "explained"
    assert [e["name"] for e in content["effects"]] == ["bias_temperature"]
    (effect,) = content["effects"]
    for axis, slope in zip("xyz", slopes, strict=True):
        assert abs(effect["parameters"][f"c1{axis}"] - slope) < 4 * effect["std"][f"c1{axis}"]
        # each session by itself says the same
        for own in content["by_session"]["bias_temperature"].values():
            assert abs(own[f"c1{axis}"]["value"] - slope) < 4 * own[f"c1{axis}"]["std"]
    assert effect["p_value"] < 1e-10
    low, high = effect["ratio_ci95"]
    assert low <= effect["heldout_after"] / effect["heldout_before"] <= high < 0.5
    residual = content["residuals"]["bias"]
    assert residual["chi2_before"] > 10 and residual["chi2_after"] == pytest.approx(1, abs=0.3)
    assert residual["after"] == pytest.approx(residual["floor"], rel=0.1)
    for session in ("a", "b"):
        for name in ("ax", "ay", "az") if sensor == "accelerometer" else ("gx", "gy", "gz"):
            figures = residual["sessions"][session][name]
            assert figures["after"] < figures["before"] / 2
    # what goes into the calibration
    (fitted,) = result.effects[sensor]
    assert fitted.values == effect["parameters"]


def test_noise_is_estimated_again_without_the_effect(warm, tmp_path):
    _, noise, result = warm
    for name in CHANNELS:
        # a temperature that was read as a slow term
        before, after = noise.axes[name], result.noise.axes[name]
        assert max(before.B.square, before.K.square * 1e3, before.R.square * 1e6) > 0
        assert after.N.value == pytest.approx(WHITE, rel=0.03)
        assert after.K.value is None and after.R.value is None
        change = result.content["accelerometer" if name[0] == "a" else "gyroscope"]["noise"][name]
        assert change["before"]["N"]["value"] == before.N.value
        assert change["after"]["N"]["value"] == after.N.value
    curves = pd.DataFrame(result.allan["a"])
    assert list(curves["stage"].unique()) == ["corrected"]
    # longest averages lie at the white noise
    longest = curves[curves["axis"] == "az"].iloc[-1]
    assert longest["ci_low"] < WHITE / np.sqrt(longest["tau_s"]) < longest["ci_high"]


def test_a_warm_up_that_one_start_cannot_confirm_is_no_random_walk():
    def settles(t):
        return np.outer(0.1 * np.exp(-t / 100.0), np.ones(6))

    made = data(a=log(4, extra=settles))
    noise = noise_of(made)
    result = diagnosed(made, noise)
    assert all(result.content[s]["effects"] == [] for s in SENSORS)
    # but the content of the record keeps the noise as logged
    assert all(result.content[s]["noise"] == {} for s in SENSORS)
    plain = noise_of(data(a=log(4)))
    for axis in CHANNELS:
        limits = [model.known(axis, "K") for model in (noise, result.noise, plain)]
        logged, without, true = (size + spread for size, spread in limits)
        assert without < 0.5 * logged
        assert without < 1.5 * true


def test_corrected_samples_are_those_without_the_effect(warm):
    made, _, result = warm
    samples = made.samples["a"]
    got = corrected("a", made.log("a"), calibration(scale=2.0), result.effects)
    plain = log(1)
    for sensor, columns in (("accelerometer", "ax ay az"), ("gyroscope", "gx gy gz")):
        values = np.array(list(result.effects[sensor][0].values.values()))[:3]
        assert len(values) == 3
        # e is in units of K (raw - b): with K = 2 half of it comes off the log
        change = np.column_stack([samples[name] - got[name] for name in columns.split()])
        slope = np.polyfit(warmth(samples["t"]) - 20, change, 1)[0]
        np.testing.assert_allclose(slope, values / 2, rtol=0.05)
    np.testing.assert_array_equal(got["t"], plain["t"])


def test_corrected_samples_are_the_same_in_parts(warm, monkeypatch):
    made, _, result = warm
    arguments = "a", made.log("a"), calibration(), result.effects
    whole = corrected(*arguments)
    monkeypatch.setattr(rest_log, "PART", 1000)
    for name, values in corrected(*arguments).items():
        np.testing.assert_array_equal(values, whole[name])


def test_every_candidate_has_the_fields_of_the_contract(warm):
    _, _, result = warm
    for sensor in SENSORS:
        found = {c["name"]: c for c in result.content[sensor]["candidates"]}
        json.dumps(result.content[sensor])
        for name in ("ramp", "steps", "sinusoid", "gauss_markov", "warm_up", "thermal_hysteresis"):
            candidate = found[name]
            assert candidate["status"] in ("rejected", "confounded", "not_observable")
            assert candidate["why"]
            if candidate["status"] != "not_observable":
                assert 0 <= candidate["p_value"] <= 1
                assert candidate["heldout_after"] > 0
                assert candidate["detection_limit"]
                assert set(candidate["detection_limit"]) <= set(candidate["units"])
        assert found["bias_temperature"]["status"] == "added"
        assert found["bias_drift"]["status"] == "not_observable"


def test_a_scale_factor_and_a_bias_are_one_in_one_attitude():
    content = diagnosed(data(a=log(4, SLOPES))).content["accelerometer"]
    pairs = {(p["effect"], p["with"]) for p in content["confounded"]}
    assert ("scale_temperature", "bias_temperature") in pairs
    found = {c["name"]: c for c in content["candidates"]}
    assert found["scale_temperature"]["status"] == "confounded"
    assert found["scale_temperature"]["confounded_with"] == "bias_temperature"


def test_what_no_candidate_is_stays_unexplained():
    """A bias that wanders while the noise model says that it does not."""

    def wander(t):
        return np.cumsum(np.random.default_rng(5).normal(size=(len(t), 6)), axis=0) * 1e-3

    result = diagnosed(data(a=log(6, extra=wander)), noise_of(data(a=log(6))))
    for sensor in SENSORS:
        content = result.content[sensor]
        assert content["verdict"] == "unexplained"
        assert content["effects"] == []
        assert content["residuals"]["bias"]["chi2_after"] > 2
        assert {c["name"] for c in content["correlates"]} >= {"time", "temperature"}


def test_too_short_and_silent_records_say_why():
    made = data(a=log(7))
    short = made.samples["a"].iloc[:100]
    cut = made.segments["a"].assign(end_s=25.0)
    content = diagnosed(StaticData(made.kinds, {"a": short}, {"a": cut}), noise_of(made)).content
    assert content["gyroscope"]["verdict"] == "not_testable"
    assert "16 means" in content["gyroscope"]["why"]
    nothing = diagnosed(StaticData({}, {}, {}), noise_of(made))
    assert nothing.content["accelerometer"]["verdict"] == "not_testable"
    silent = data(a=made.samples["a"].assign(gy=0.25))
    content = diagnosed(silent, noise_of(made)).content
    assert content["gyroscope"]["why"] == "an axis never changes"
    assert content["accelerometer"]["verdict"] == "consistent"
    assert static_tests(records_of(made), DiagnoseSettings()) > 10


def test_lines_without_noise_are_no_noise_to_weigh_with():
    made = data(a=log(7))
    noise = noise_of(made)
    line = AxisNoise(
        N=Coefficient(1e-15, (0.0, 2e-15), 2e-15, True),
        sinusoid=(Sinusoid(Coefficient(0.01), Coefficient(0.613)),),
    )
    content = diagnosed(made, NoiseModel("d", noise.axes | {"ay": line})).content
    assert content["accelerometer"]["verdict"] == "not_testable"
    assert "lines and no noise beside them" in content["accelerometer"]["why"]
    assert content["gyroscope"]["verdict"] == "consistent"


def test_a_part_that_is_lost_to_a_move_leaves_the_other_sensor_its_own_windows():
    """The last five means, tilted and too few for a record, are the gyroscope's alone."""
    moved = SECONDS - 330
    # the output (-0.4, -0.7, 9.3) m/s^2 and what is as long
    lower = np.sqrt(0.4**2 + 9.3**2 - 0.6**2) - 9.3

    def tilt(t):
        return np.outer(t > moved, [1.0, 0, lower, 0, 0, 0])

    made = data(a=log(5, extra=tilt))
    ends = {"start_s": [0.0, moved + 20], "end_s": [moved - 20, SECONDS], "kind": ["static"] * 2}
    made.segments["a"] = pd.DataFrame(ends)
    result = diagnosed(made)
    n = {s: result.content[s]["residuals"]["bias"]["n"] for s in SENSORS}
    assert n["gyroscope"] - n["accelerometer"] == 5
    assert result.content["gyroscope"]["verdict"] == "consistent"


def test_means_that_gaps_part_have_no_spectrum():
    """Of too few in a row the process is not observable; all else is tried."""
    values = 0.01 * np.random.default_rng(4).standard_normal((64, 3))
    one = made_record(values, stretch=np.arange(64) // 8)
    found = find("gyroscope", [one], [one], DiagnoseSettings(), 20)
    assert found.process is None
    white = Coefficient(0.01 * np.sqrt(LENGTH), (0.0, 1.0), 1.0, True)
    noise = NoiseModel("one", dict.fromkeys(CHANNELS, AxisNoise(N=white)))
    content = static_content("gyroscope", found, noise, {})
    process = next(c for c in content["candidates"] if c["name"] == "gauss_markov")
    assert process["status"] == "not_observable" and "spectrum" in process["why"]
    assert content["verdict"] == "consistent" and content["effects"] == []
