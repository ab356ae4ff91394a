"""Two sensors on their own clocks: noise, rests and turns are of each sensor's own samples."""

import zipfile

import numpy as np
import pandas as pd
import pytest

import imuloop
from calibrate.devices import plan_session, without_noise
from imuloop import chain
from imuloop.core.files import read_json
from imuloop.core.samples import CHANNELS, Samples
from imuloop.noise.allan import session_curves
from imuloop.noise.noise import estimate_noise
from imuloop.noise.records import RecordedSession
from imuloop.noise.settings import NoiseSettings
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import example_truth
from quick import hurry

# white noise, m/s^2/√Hz and rad/s/√Hz
FORCE_NOISE, RATE_NOISE = 1e-3, 1.7e-4
# acceleration and angular rate, Hz: slow and fast, nearly equal, fast and slow
RATES = [(62.5, 400), (100, 100.3), pytest.param(400, 50, marks=pytest.mark.study)]


def stamps(seconds, rate, start=0.0):
    return start + np.arange(int(seconds * rate)) / rate


def add_noise(values, density, rate, rng):
    return values + density * np.sqrt(rate) * rng.normal(size=(len(values), 3))


@pytest.fixture
def export(tmp_path):
    """Return a function that writes a zip with a table a sensor, as a phone exports it."""

    def write(t_force, force, t_rate, rate):
        path = tmp_path / "log.zip"
        with zipfile.ZipFile(path, "w") as archive:
            for name, t, values in (("Accelerometer", t_force, force), ("Gyroscope", t_rate, rate)):
                table = pd.DataFrame(values, columns=[*"xyz"]).assign(seconds_elapsed=t)
                table["time"] = 1_700_000_000_000_000_000 + np.rint(t * 1e9).astype(np.int64)
                archive.writestr(f"{name}Uncalibrated.csv", table.to_csv(index=False))
            archive.writestr("Metadata.csv", "version,platform\n3,android\n")
        return path

    return write


@pytest.mark.parametrize(("force_rate", "turn_rate"), RATES)
def test_noise_is_that_of_each_sensor_s_own_samples(export, tmp_path, force_rate, turn_rate):
    rng = np.random.default_rng(int(force_rate + 2 * turn_rate))
    t_force, t_rate = stamps(150, force_rate), stamps(150, turn_rate, 0.0007)
    force = add_noise(np.tile([0.2, -0.1, 9.78], (len(t_force), 1)), FORCE_NOISE, force_rate, rng)
    rate = add_noise(np.tile([5e-3, -3e-3, 1e-3], (len(t_rate), 1)), RATE_NOISE, turn_rate, rng)
    device = chain.Device("imu", tmp_path, {"log": "static"})
    chain.ingest(device, "log", {}, [export(t_force, force, t_rate, rate)])
    samples = Samples(device.sessions["log"]["samples"])
    segments, _ = segment_session(samples, "static", SegmentSettings())
    # a log that rests is one rest, for any clocks
    assert segments["kind"].tolist() == ["static"]
    session = RecordedSession("log", "static", samples, segments)
    noise = estimate_noise("imu", [session], NoiseSettings())
    curves = pd.DataFrame(session_curves(session, NoiseSettings())).groupby("axis").first()
    for sensor, axes, density, rate_hz in (
        ("accelerometer", ["ax", "ay", "az"], FORCE_NOISE, force_rate),
        ("gyroscope", ["gx", "gy", "gz"], RATE_NOISE, turn_rate),
    ):
        np.testing.assert_allclose(noise.rates_hz[sensor], rate_hz, rtol=1e-3)
        densities = [noise.model.axes[axis].N.value for axis in axes]
        np.testing.assert_allclose(densities, density, rtol=0.05)
        np.testing.assert_allclose(curves.loc[axes, "tau_s"], 1 / rate_hz, rtol=1e-3)
        np.testing.assert_allclose(curves.loc[axes, "adev"], density * np.sqrt(rate_hz), rtol=0.05)
    # nothing is said of what merging two clocks alone would do
    assert not [note for note in noise.notes if "power is lacking" in note]
    assert "a value is held" not in str(read_json(device.sessions["log"]["quality"])["warnings"])


def sensed(log, t, axes):
    """Return three axes of a log without noise at other stamps, (n, 3)."""
    return np.column_stack([np.interp(t, log["t"], log[axis]) for axis in axes])


@pytest.mark.parametrize(
    ("force_rate", "turn_rate"),
    [(62.5, 400), *(pytest.param(*r, marks=pytest.mark.study) for r in ((100, 100.3), (400, 100)))],
)
def test_a_calibration_is_as_good_as_of_one_clock(export, force_rate, turn_rate):
    truth = plan_session(example_truth(rate=800.0), poses=24, initial_rest_s=20.0)
    log, rng = simulate_session(without_noise(truth), "multi_position", 9), np.random.default_rng(4)
    seconds = log["t"].iloc[-1] - 0.1
    t_force, t_rate = stamps(seconds, force_rate), stamps(seconds, turn_rate, 0.0031)
    force = add_noise(sensed(log, t_force, CHANNELS[:3]), FORCE_NOISE, force_rate, rng)
    rate = add_noise(sensed(log, t_rate, CHANNELS[3:]), RATE_NOISE, turn_rate, rng)
    with hurry("device"):
        device = imuloop.calibrate(export(t_force, force, t_rate, rate), name="device")
    for sensor, limit in (("accelerometer", 3e-4), ("gyroscope", 1e-3)):
        fitted, scale = getattr(device.calibration, sensor), getattr(truth, sensor).K
        verdicts = device.diagnosis["sensors"][sensor]
        # within four of its own errors, and those are small
        error = np.array([fitted.std[f"K{k}"] for k in range(3)])
        assert (error < limit).all()
        assert (np.abs(fitted.K - scale) < 4 * error).all(), (fitted.K - scale) / error
        assert verdicts["poses"]["verdict"] == "consistent"
        # a slow accelerometer misses what a move does
        if force_rate < 0.9 * turn_rate:
            assert "slower than the gyroscope" in verdicts["motion"]["why"]
