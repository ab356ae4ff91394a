"""The script for imuSensor: its numbers in the documented formula give the log, with its noise."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from export.devices import HOSTILE, K, N, device, g_sensitivity, unknown
from export.warm_device import carried, fitted, narrow_device, warm_device, warm_samples
from imuloop.core.errors import Lacking
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.effects.bias_temperature import BiasTemperature
from imuloop.export import matlab_imu_sensor

# flicker of every axis of the device
B = 3e-5


def load(text):
    """Return what the script assigns: arrays by name, text as it stands, comments left out."""
    found = {}
    text = "\n".join(line.split("%")[0] for line in re.split(r"\r|\n", text))
    for name, value in re.findall(r"^([\w.]+) = (.*?);\s*$", text.replace("...\n", ""), re.M):
        if value.startswith("["):
            rows = [row.split() for row in value.strip("[]").split(";")]
            value = np.squeeze(np.array(rows, dtype=float))
        found[name] = value
    return found


def reading(found, name, u, temperature):
    """Return imuSensor's reading without noise: gain, constant bias, bias of the temperature."""
    gain = found[f"{name}.AxesMisalignment"] / 100
    slope = found.get(f"{name}.TemperatureBias", np.zeros(3))
    return u @ gain.T + found[f"{name}.ConstantBias"] + (temperature[:, None] - 25) * slope


@pytest.mark.parametrize("warm", [True, False])
def test_it_measures_what_the_calibration_takes_back(warm):
    line, other = fitted(BiasTemperature(1, 18.0), (5e-3,)), fitted(BiasTemperature(1), (4e-4,))
    board = warm_device(accelerometer=(line,) * warm, gyroscope=(*(other,) * warm, g_sensitivity()))
    found, truth = load(matlab_imu_sensor.text(board)), warm_samples()
    theta = truth["temperature"].to_numpy()
    f, w = truth[list(ACCELERATION)].to_numpy(), truth[list(ANGULAR_RATE)].to_numpy()
    logged = truth.copy()
    # imuSensor: gravity less acceleration is the negative of specific force
    logged[list(ACCELERATION)] = -reading(found, "accel", -f, theta)
    by_hand = f @ found["gSensitivity"].T
    logged[list(ANGULAR_RATE)] = reading(found, "gyro", w, theta) + by_hand
    back = board.calibration.apply(logged)
    np.testing.assert_allclose(back[list(ACCELERATION)], f, rtol=0, atol=1e-12)
    np.testing.assert_allclose(back[list(ANGULAR_RATE)], w, rtol=0, atol=1e-13)


def test_of_a_curve_it_has_the_tangent_at_the_reference():
    board = warm_device(gyroscope=())
    text = matlab_imu_sensor.text(board)
    found, truth = load(text), warm_samples()
    truth["temperature"] = 18.0 + np.linspace(-1e-3, 1e-3, len(truth))
    f = truth[list(ACCELERATION)].to_numpy()
    logged = truth.copy()
    theta = truth["temperature"].to_numpy()
    logged[list(ACCELERATION)] = -reading(found, "accel", -f, theta)
    back = carried(board, ("bias_temperature",), aligned=True).apply(logged)
    # the curvature over a thousandth of a kelvin
    np.testing.assert_allclose(back[list(ACCELERATION)], f, rtol=0, atol=2e-4 * 1e-6)
    assert "Not carried of bias_temperature: its curvature" in text
    assert "Not carried of the accelerometer: scale_temperature" in text


def test_the_range_of_what_it_cannot_hold_is_said():
    board = narrow_device(gyroscope=(5.0, 25.0))
    text = matlab_imu_sensor.text(board)
    comments = [line.partition("% ")[2] for line in text.splitlines() if "was seen" in line]
    bias = "bias_temperature was seen from {} to {} degC; imuSensor holds it to no range"
    assert comments[:2] == [bias.format(10, 30), bias.format(5, 25)]
    assert comments[2].startswith("g_sensitivity was seen with f_x from -4.8")
    assert len(comments) == 3
    assert "was seen" not in matlab_imu_sensor.text(warm_device())
    assert str(load(text)) == str(load(matlab_imu_sensor.text(warm_device())))


def test_noise_densities_are_ours_and_single_sided():
    text = matlab_imu_sensor.text(device())
    found = load(text)
    for name, axes in (("accel", ACCELERATION), ("gyro", ANGULAR_RATE)):
        assert found[f"{name}.NoiseDensity"].tolist() == [N[axis] for axis in axes]
        assert found[f"{name}.RandomWalk"].tolist() == [K[axis] for axis in axes]
        assert found[f"{name}.BiasInstability"].tolist() == [B] * 3
        assert found[f"{name}.NoiseType"] == "'single-sided'"
    assert "ay, not seen: its 95 % upper limit" in text
    assert "'SampleRate', 200.0," in text


def test_the_simulated_noise_has_the_allan_deviation_of_our_model():
    board = device()
    found = load(matlab_imu_sensor.text(board))
    rng, n, rate, poles = np.random.default_rng(1), 400_000, 200.0, 1000
    assert found["accel.BiasInstabilityCoefficients"] == f"fractalcoef({poles})"
    white = found["accel.NoiseDensity"][0] * np.sqrt(rate) * rng.standard_normal(n)
    walk = np.cumsum(found["accel.RandomWalk"][0] / np.sqrt(rate) * rng.standard_normal(n))
    # Kasdin, equation 116, alpha = 1
    k = np.arange(1, poles + 1)
    a = np.concatenate([[1], np.cumprod((k - 1.5) / k)])
    driven = found["accel.BiasInstability"][0] * rng.standard_normal(n)
    noise = board.noise.axes["ax"]
    for process, x, m in (
        (replace(noise, K=unseen(), B=unseen()), white, 100),
        (replace(noise, N=unseen(), B=unseen()), walk, 100),
        (replace(noise, N=unseen(), K=unseen()), lfilter([1], a, driven), 100),
    ):
        means = x.reshape(-1, m).mean(axis=1)
        found_deviation = np.sqrt(np.mean(np.diff(means) ** 2) / 2)
        # 4,000 means: 1.5 %; the flicker's floor holds to a few per cent over 100 samples
        assert found_deviation == pytest.approx(np.sqrt(process.allan_variance(m / rate)), rel=0.06)


def unseen():
    return type(device().noise.axes["ax"].N)()


def test_a_label_adds_no_statement():
    plain, hostile = (load(matlab_imu_sensor.text(device(label))) for label in ("Board", HOSTILE))
    assert str(plain) == str(hostile)


def test_no_file_without_calibration_or_rate():
    with pytest.raises(Lacking, match="no calibration"):
        matlab_imu_sensor.text(unknown())
    with pytest.raises(Lacking, match="rate"):
        matlab_imu_sensor.text(replace(device(), rate_hz=None))
