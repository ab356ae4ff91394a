"""Two sensors on their own clocks: noise, rests and turns are of each sensor's own samples."""

import zipfile

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

import imuloop
from imuloop import chain
from imuloop.core.files import read_json
from imuloop.core.samples import Samples
from imuloop.noise.allan import session_curves
from imuloop.noise.noise import estimate_noise
from imuloop.noise.records import RecordedSession
from imuloop.noise.settings import NoiseSettings
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings

# white noise, m/s^2/√Hz and rad/s/√Hz
FORCE_NOISE, RATE_NOISE = 1e-3, 1.7e-4
# acceleration and angular rate, Hz: slow and fast, nearly equal, fast and slow
RATES = [(62.5, 400), (100, 100.3), (400, 50)]


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
    for sensor, axes, density, hertz in (
        ("accelerometer", ["ax", "ay", "az"], FORCE_NOISE, force_rate),
        ("gyroscope", ["gx", "gy", "gz"], RATE_NOISE, turn_rate),
    ):
        np.testing.assert_allclose(noise.rates_hz[sensor], hertz, rtol=1e-3)
        densities = [noise.model.axes[axis].N.value for axis in axes]
        np.testing.assert_allclose(densities, density, rtol=0.05)
        np.testing.assert_allclose(curves.loc[axes, "tau_s"], 1 / hertz, rtol=1e-3)
        np.testing.assert_allclose(curves.loc[axes, "adev"], density * np.sqrt(hertz), rtol=0.05)
    # nothing is said of what merging two clocks alone would do
    assert not [note for note in noise.notes if "power is lacking" in note]
    assert "a value is held" not in str(read_json(device.sessions["log"]["quality"])["warnings"])


def turning_device(t, rng):
    """Return specific force and angular rate of a device that is turned from rest to rest."""
    begin, length, rest = 20.0, 1.5, 4.0
    attitude, force = Rotation.identity(), np.zeros((len(t), 3))
    rate, start = np.zeros((len(t), 3)), 0.0
    for number in range(25):
        axis = rng.normal(size=3)
        axis *= rng.uniform(1.2, 2.6) / np.linalg.norm(axis)
        still = (t >= start) & (t < begin)
        force[still] = attitude.inv().apply([0, 0, 9.80665])
        # the turn about one axis begins and ends smoothly
        moving = (t >= begin) & (t < begin + length)
        phase = (t[moving] - begin) / length
        angle = phase - np.sin(2 * np.pi * phase) / (2 * np.pi)
        rate[moving] = axis * ((1 - np.cos(2 * np.pi * phase)) / length)[:, None]
        along = attitude * Rotation.from_rotvec(axis * angle[:, None])
        force[moving] = along.inv().apply([0, 0, 9.80665])
        attitude = attitude * Rotation.from_rotvec(axis)
        start, begin = begin + length, begin + length + rest
        rest = 4.0 + number % 3
    last = t >= start
    force[last] = attitude.inv().apply([0, 0, 9.80665])
    return force, rate


@pytest.mark.parametrize(
    ("force_rate", "turn_rate"),
    [(62.5, 400), *(pytest.param(*r, marks=pytest.mark.study) for r in ((100, 100.3), (400, 100)))],
)
def test_a_calibration_is_as_good_as_of_one_clock(export, force_rate, turn_rate):
    scales = np.array([1.01, 0.99, 1.005]), np.array([0.99, 1.012, 1.004])
    t_force, t_rate = stamps(170, force_rate), stamps(170, turn_rate, 0.0031)
    rng = np.random.default_rng(4)
    force, _ = turning_device(t_force, np.random.default_rng(9))
    _, rate = turning_device(t_rate, np.random.default_rng(9))
    force = add_noise(force / scales[0] + [0.1, -0.05, 0.02], FORCE_NOISE, force_rate, rng)
    rate = add_noise(rate / scales[1] + [5e-3, -3e-3, 1e-3], RATE_NOISE, turn_rate, rng)
    device = imuloop.calibrate(export(t_force, force, t_rate, rate))
    sensors = ("accelerometer", "gyroscope")
    for sensor, scale, limit in zip(sensors, scales, (3e-4, 1e-3), strict=True):
        fit = getattr(device.calibration, sensor)
        verdicts = device.diagnosis["sensors"][sensor]
        # within four of its own errors, and those are small
        error = np.array([fit.std[f"K{k}"] for k in range(3)])
        assert (error < limit).all()
        assert (np.abs(fit.K - scale) < 4 * error).all(), (fit.K - scale) / error
        assert verdicts["poses"]["verdict"] == "consistent"
        # a slow accelerometer misses what a move does
        if force_rate < 0.9 * turn_rate:
            assert "slower than the gyroscope" in verdicts["motion"]["why"]
