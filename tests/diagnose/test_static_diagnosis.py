"""Static records from samples to the fields of the diagnosis, the calibration and the noise."""

import numpy as np
import pandas as pd
import pytest

import imuloop.effects  # noqa: F401  the library of effects
from imuloop.core.samples import CHANNELS
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


def log(seed, extra=lambda t: 0.0):
    t = np.arange(int(SECONDS * RATE)) / RATE
    x = np.random.default_rng(seed).normal(scale=WHITE * np.sqrt(RATE), size=(len(t), 6))
    x[:, :3] += (0.1, -0.2, 9.8)
    kelvin = 12 * np.sin(2 * np.pi * t / 3000.0)
    return pd.DataFrame(x + extra(t), columns=CHANNELS).assign(t=t, temperature=20 + kelvin)


def data(**samples):
    whole = pd.DataFrame(
        {"start_s": [0.0], "end_s": [SECONDS], "kind": ["static"], "tilt_rad": [0.0]}
    )
    return StaticData(dict.fromkeys(samples, "static"), samples, dict.fromkeys(samples, whole))


def noise_of(record):
    sessions = [
        RecordedSession(n, "static", s, record.segments[n]) for n, s in record.samples.items()
    ]
    return estimate_noise("d", sessions, NoiseSettings())


def diagnose_record(record, noise=None):
    records = record.records(NOMINAL, SETTINGS.mean_time)
    noise, tests = noise or noise_of(record), static_tests(records, SETTINGS)
    how = SETTINGS, NoiseSettings(), tests
    return diagnose_static(record, records, NOMINAL, noise.model, *how)


@pytest.fixture(scope="module")
def still_record():
    """White noise alone, and its noise model."""
    record = data(a=log(4))
    return record, noise_of(record)


def test_a_warm_up_that_one_start_cannot_confirm_is_no_random_walk(no_limits, still_record):
    def settles(t):
        return np.outer(0.1 * np.exp(-t / 100.0), np.ones(6))

    record = data(a=log(4, extra=settles))
    noise = noise_of(record)
    result = diagnose_record(record, noise)
    for content in result.content.values():
        # the content of the record keeps the noise as logged
        assert content["effects"] == [] and content["noise"] == {}
    for axis in CHANNELS:
        models = noise.model, result.noise, still_record[1].model
        limits = [model.value_and_std(axis, "K") for model in models]
        logged, without, true = (size + spread for size, spread in limits)
        assert without < 0.5 * logged
        assert without < 1.5 * true


def test_what_no_candidate_is_stays_unexplained(no_limits, still_record):
    """A bias that wanders while the noise model says that it does not."""

    def wander(t):
        return np.cumsum(np.random.default_rng(5).normal(size=(len(t), 6)), axis=0) * 1e-3

    result = diagnose_record(data(a=log(4, extra=wander)), still_record[1])
    for content in result.content.values():
        assert (content["verdict"], content["effects"]) == ("unexplained", [])
        assert content["residuals"]["bias"]["chi2_after"] > 2


def test_too_short_and_silent_records_say_why(no_limits, still_record):
    record, noise = still_record
    cut = {"a": record.segments["a"].assign(end_s=25.0)}
    short = diagnose_record(
        StaticData(record.kinds, {"a": record.samples["a"].iloc[:100]}, cut), noise
    )
    assert short.content["gyroscope"]["verdict"] == "not_testable"
    assert "16 means" in short.content["gyroscope"]["why"]
    nothing = diagnose_record(StaticData({}, {}, {}), noise)
    assert nothing.content["accelerometer"]["verdict"] == "not_testable"
    silent = diagnose_record(data(a=record.samples["a"].assign(gy=0.25)), noise).content
    assert silent["gyroscope"]["why"] == "an axis never changes"
    assert silent["accelerometer"]["verdict"] == "consistent"


def test_the_static_sessions_are_used_else_the_longest_rest():
    def segments(*rows):
        return pd.DataFrame(rows, columns=["start_s", "end_s", "kind"]).assign(tilt_rad=0.0)

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
        rests = rests_to_use(kinds, tables).items()
        assert {name: [*table["end_s"]] for name, table in rests} == used
