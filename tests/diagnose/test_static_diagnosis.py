"""Static records from samples to the fields of the diagnosis, the calibration and the noise."""

from unittest.mock import patch

import numpy as np
import pandas as pd
import pytest

import imuloop.effects  # noqa: F401  the library of effects
from bench.study.chain import LIMITS
from imuloop.core.samples import CHANNELS, SENSORS
from imuloop.core.units import RawUnit
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.diagnose.static import diagnose_static, static_tests
from imuloop.diagnose.static_means import StaticData, rests_to_use
from imuloop.model.calibration import Calibration
from imuloop.model.sensor_calibration import SensorCalibration
from imuloop.noise.noise import estimate_noise
from imuloop.noise.records import RecordedSession
from imuloop.noise.settings import NoiseSettings

RATE, SECONDS, WHITE = 4.0, 4000.0, 0.02
SETTINGS = DiagnoseSettings()
NOMINAL = Calibration(
    "d", 9.8, *(SensorCalibration.nominal(RawUnit(u, 1.0), "") for u in ("m/s^2", "rad/s"))
)
# m/s^2 and rad/s per K of each axis
SLOPES = {
    "accelerometer": np.array([1e-2, -2e-2, 3e-2]),
    "gyroscope": np.array([2e-2, 1e-2, -1e-2]),
}


def log(seed, warm=False, extra=None, up=(0.1, -0.2, 9.8)):
    n = int(SECONDS * RATE)
    t = np.arange(n) / RATE
    kelvin = 12 * np.sin(2 * np.pi * t / 3000.0)
    x = np.random.default_rng(seed).normal(scale=WHITE * np.sqrt(RATE), size=(n, 6))
    x[:, :3] += up
    if warm:
        x += np.outer(kelvin, np.concatenate(list(SLOPES.values())))
    if extra is not None:
        x += extra(t)
    return pd.DataFrame(
        {"t": t, **dict(zip(CHANNELS, x.T, strict=True)), "temperature": 20 + kelvin}
    )


def data(**samples):
    whole = pd.DataFrame(
        {"start_s": [0.0], "end_s": [SECONDS], "kind": ["static"], "tilt_rad": [0.0]}
    )
    return StaticData(dict.fromkeys(samples, "static"), samples, dict.fromkeys(samples, whole))


def noise_of(made):
    sessions = [RecordedSession(n, "static", s, made.segments[n]) for n, s in made.samples.items()]
    return estimate_noise("d", sessions, NoiseSettings())


def diagnose_record(made, noise=None):
    records = made.records(NOMINAL, SETTINGS.mean_time)
    noise, tests = noise or noise_of(made), static_tests(records, SETTINGS)
    how = SETTINGS, NoiseSettings(), tests
    return diagnose_static(made, records, NOMINAL, noise.model, *how)


@pytest.fixture(scope="module")
def warm():
    made = data(a=log(1, warm=True), b=log(2, warm=True, up=(9.8, 0.3, -0.1)))
    noise = noise_of(made)
    with patch(LIMITS, return_value={}):
        return noise, diagnose_record(made, noise)


@pytest.fixture(scope="module")
def still_record():
    """White noise alone, and its noise model."""
    made = data(a=log(4))
    return made, noise_of(made)


def test_a_device_without_an_effect_is_consistent(no_limits, still_record):
    result = diagnose_record(*still_record)
    for content in result.content.values():
        assert content["verdict"] == "consistent"
        assert content["effects"] == [] and content["noise"] == {}
        residual = content["residuals"]["bias"]
        assert residual["before"] == residual["after"] == pytest.approx(residual["floor"], rel=0.1)
        # white noise of means over a minute on three axes, the level of the other blocks
        floor = WHITE * np.sqrt(3 / 60 * (1 + 1 / 58))
        assert residual["floor"] == pytest.approx(floor, rel=0.1)
    assert result.effects == {"accelerometer": (), "gyroscope": ()}
    assert result.allan == {}


@pytest.mark.parametrize("sensor", SENSORS)
def test_a_bias_that_follows_the_temperature(warm, sensor):
    _, result = warm
    content = result.content[sensor]
    assert content["verdict"] == "explained"
    (effect,) = content["effects"]
    assert effect["name"] == "bias_temperature"
    for axis, slope in zip("xyz", SLOPES[sensor], strict=True):
        assert abs(effect["parameters"][f"c1{axis}"] - slope) < 4 * effect["std"][f"c1{axis}"]
    assert effect["p_value"] < 1e-10
    low, high = effect["ratio_ci95"]
    assert low <= effect["heldout_after"] / effect["heldout_before"] <= high < 0.5
    residual = content["residuals"]["bias"]
    assert residual["chi2_before"] > 10 and residual["chi2_after"] == pytest.approx(1, abs=0.3)
    assert residual["after"] == pytest.approx(residual["floor"], rel=0.1)
    assert set(residual["sessions"]) == {"a", "b"}
    for figures in (residual["sessions"][s][name] for s in "ab" for name in SENSORS[sensor]):
        assert figures["after"] < figures["before"] / 2
    # what goes into the calibration
    (fitted,) = result.effects[sensor]
    assert fitted.values == effect["parameters"]


def test_noise_is_estimated_again_without_the_effect(warm):
    noise, result = warm
    for sensor, names in SENSORS.items():
        for name in names:
            # a temperature that was read as a slow term
            before, after = noise.model.axes[name], result.noise.axes[name]
            assert max(before.B.square, before.K.square * 1e3, before.R.square * 1e6) > 0
            assert after.N.value == pytest.approx(WHITE, rel=0.03)
            assert after.K.value is None and after.R.value is None
            change = result.content[sensor]["noise"][name]
            assert change["before"]["N"]["value"] == before.N.value
            assert change["after"]["N"]["value"] == after.N.value
    # longest averages of the corrected curve lie at the white noise
    table = pd.DataFrame(result.allan["a"])
    assert list(table["stage"].unique()) == ["corrected"]
    longest = table[table["axis"] == "az"].iloc[-1]
    assert longest["ci_low"] < WHITE / np.sqrt(longest["tau_s"]) < longest["ci_high"]


def test_a_warm_up_that_one_start_cannot_confirm_is_no_random_walk(no_limits, still_record):
    def settles(t):
        return np.outer(0.1 * np.exp(-t / 100.0), np.ones(6))

    made = data(a=log(4, extra=settles))
    noise = noise_of(made)
    result = diagnose_record(made, noise)
    for content in result.content.values():
        # the content of the record keeps the noise as logged
        assert content["effects"] == [] and content["noise"] == {}
    for axis in CHANNELS:
        models = noise.model, result.noise, still_record[1].model
        limits = [model.value_and_std(axis, "K") for model in models]
        logged, without, true = (size + spread for size, spread in limits)
        assert without < 0.5 * logged
        assert without < 1.5 * true


def test_a_scale_factor_and_a_bias_are_one_in_one_attitude(no_limits, still_record):
    content = diagnose_record(data(a=log(4, warm=True)), still_record[1]).content["accelerometer"]
    assert ("scale_temperature", "bias_temperature") in {
        (p["effect"], p["with"]) for p in content["confounded"]
    }
    (found,) = (c for c in content["candidates"] if c["name"] == "scale_temperature")
    assert (found["status"], found["confounded_with"]) == ("confounded", "bias_temperature")


def test_what_no_candidate_is_stays_unexplained(no_limits, still_record):
    """A bias that wanders while the noise model says that it does not."""

    def wander(t):
        return np.cumsum(np.random.default_rng(5).normal(size=(len(t), 6)), axis=0) * 1e-3

    result = diagnose_record(data(a=log(4, extra=wander)), still_record[1])
    for content in result.content.values():
        assert (content["verdict"], content["effects"]) == ("unexplained", [])
        assert content["residuals"]["bias"]["chi2_after"] > 2


def test_too_short_and_silent_records_say_why(no_limits, still_record):
    made, noise = still_record
    cut = {"a": made.segments["a"].assign(end_s=25.0)}
    short = diagnose_record(StaticData(made.kinds, {"a": made.samples["a"].iloc[:100]}, cut), noise)
    assert short.content["gyroscope"]["verdict"] == "not_testable"
    assert "16 means" in short.content["gyroscope"]["why"]
    nothing = diagnose_record(StaticData({}, {}, {}), noise)
    assert nothing.content["accelerometer"]["verdict"] == "not_testable"
    silent = diagnose_record(data(a=made.samples["a"].assign(gy=0.25)), noise).content
    assert silent["gyroscope"]["why"] == "an axis never changes"
    assert silent["accelerometer"]["verdict"] == "consistent"


def test_the_static_sessions_are_used_else_the_longest_rest():
    def segments(*rows):
        return pd.DataFrame(rows, columns=["start_s", "end_s", "kind"])

    still, moved = segments((0, 1190, "static")), segments((0, 100, "disturbed"))
    moves = segments((0, 700, "static"), (700, 710, "motion"), (710, 720, "static"))
    short = segments((0, 500, "static"), (500, 560, "motion"))
    kinds = {"a": "static", "b": "multi_position", "c": "six_position"}
    for tables, used in (
        ({"a": still, "b": moves}, {"a": [1190]}),
        ({"b": moves, "c": short}, {"b": [700]}),
        ({"c": short}, {}),
        # a static session that holds no rest is as none
        ({"a": moved, "b": moves}, {"b": [700]}),
    ):
        found = rests_to_use(kinds, tables).items()
        assert {n: [*t[t["kind"] == "static"]["end_s"]] for n, t in found} == used
