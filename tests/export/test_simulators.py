"""The models for gnss-ins-sim and MATLAB's imuSensor, taken and simulated as these do."""

import json
import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from export.devices import (
    GNSS_INS_SIM,
    HOSTILE,
    MATLAB_IMU_SENSOR,
    MATLAB_PARAMETERS,
    RATE,
    K,
    N,
    device,
    fitted,
    g_sensitivity,
    warm_device,
    warm_samples,
)
from imuloop.core.noise_model import Coefficient, GaussMarkovTerm
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, SENSORS
from imuloop.effects.temperature import BiasTemperature

# flicker of every axis of the device
B = 3e-5
SHORT = {"accelerometer": "accel", "gyroscope": "gyro"}


def allan(x, m):
    means = x.reshape(*x.shape[:-1], -1, m).mean(axis=-1)
    return np.sqrt(np.mean(np.diff(means) ** 2, axis=-1) / 2)


def dictionary(text):
    """Return what the file of gnss-ins-sim makes; as bytes, so that a line on encoding counts."""
    names = {}
    exec(compile(text.encode(), GNSS_INS_SIM.file, "exec"), names)
    return names["imu_err"]


def errors(model):
    """Return SI parameters as IMU.__init__ does: rates from deg/h, noise from per root hour."""
    found = {}
    for name, white, angle in (("gyro", "arw", np.pi / 180), ("accel", "vrw", 1.0)):
        per_hour = angle / 3600 if name == "gyro" else 1.0
        found[name] = {
            "b": model[f"{name}_b"] * per_hour,
            "white": model[f"{name}_{white}"] * angle / 60,
            "drift": model[f"{name}_b_stability"] * per_hour,
            "corr": model[f"{name}_b_corr"],
        }
    return found


def test_gnss_ins_sim_has_our_bias_and_white_noise():
    board = device()
    found = errors(dictionary(GNSS_INS_SIM.text(board)))
    for name, axes in SENSORS.items():
        sensor, each = board.sensor(name), found[SHORT[name]]
        # what the log shows at truth zero, but for T, K and effects
        bias = (sensor.b - sensor.raw_unit.offset) * sensor.raw_unit.scale
        np.testing.assert_allclose(each["b"], bias, rtol=1e-14)
        np.testing.assert_allclose(each["white"], [N[axis] for axis in axes], rtol=1e-14)
        assert (each["corr"] == 100).all()
    text = GNSS_INS_SIM.text(board)
    assert "Not carried of the gyroscope: g_sensitivity" in text and "scale factor K" in text


def test_gnss_ins_sim_has_a_process_whose_peak_is_the_floor_of_flicker():
    accel = errors(dictionary(GNSS_INS_SIM.text(device())))["accel"]
    u = np.linspace(1, 3, 2001)
    # IEEE Std 952-1997, C.1.5, of standard deviation 1
    variance = 2 / u * (1 - (3 - 4 * np.exp(-u) + np.exp(-2 * u)) / (2 * u))
    peak = accel["drift"][0] * np.sqrt(variance.max())
    assert peak == pytest.approx(B * np.sqrt(2 * np.log(2) / np.pi), rel=1e-4)


def test_gnss_ins_sim_takes_a_gauss_markov_process_as_it_is():
    board = device()
    known = [Coefficient(value, None, value, True) for value in (3e-6, 40.0, 2e-6, 900.0)]
    both = GaussMarkovTerm(known[0], known[1]), GaussMarkovTerm(known[2], known[3])
    axes = dict(board.noise.axes, gy=replace(board.noise.axes["gy"], gauss_markov=both))
    text = GNSS_INS_SIM.text(replace(board, noise=replace(board.noise, axes=axes)))
    gyro = errors(dictionary(text))["gyro"]
    assert gyro["corr"].tolist() == [100.0, 900.0, 100.0]
    # stationary: q^2 T / 2
    assert gyro["drift"][1] == pytest.approx(np.sqrt(2e-6**2 * 900 / 2), rel=1e-14)


@pytest.mark.parametrize("label", [HOSTILE, "coding: utf-16", "coding=nonsense"])
def test_a_label_adds_no_statement_to_python(label):
    plain, other = (dictionary(GNSS_INS_SIM.text(device(each))) for each in ("Board", label))
    assert str(plain) == str(other)
    # nor does the file hide a package
    assert GNSS_INS_SIM.file.removesuffix(".py") not in ("gnss_ins_sim", *sys.stdlib_module_names)


def assigned(text):
    """Return what a MATLAB script assigns: arrays by name, text as it stands."""
    found = {}
    text = "\n".join(line.split("%")[0] for line in re.split(r"\r|\n", text))
    for name, value in re.findall(r"^([\w.]+) = (.*?);\s*$", text.replace("...\n", ""), re.M):
        if value.startswith("["):
            rows = [row.split() for row in value.strip("[]").split(";")]
            value = np.squeeze(np.array(rows, dtype=float))
        found[name] = value
    return found


def imu_sensor(board, truth):
    found, logged = assigned(MATLAB_IMU_SENSOR.text(board)), truth.copy()
    warmer = truth["temperature"].to_numpy()[:, None] - 25
    f = truth[list(ACCELERATION)].to_numpy()
    # it reads gravity less acceleration, the negative of specific force
    for name, u, sign in (("accel", -f, -1), ("gyro", truth[list(ANGULAR_RATE)].to_numpy(), 1)):
        reading = u @ (found[f"{name}.AxesMisalignment"] / 100).T + found[f"{name}.ConstantBias"]
        reading = reading + warmer * found.get(f"{name}.TemperatureBias", np.zeros(3))
        if name == "gyro" and "gSensitivity" in found:
            reading += f @ found["gSensitivity"].T
        logged[list(ACCELERATION if name == "accel" else ANGULAR_RATE)] = sign * reading
    return logged


@pytest.mark.parametrize("warm", [True, False])
def test_imu_sensor_measures_what_the_calibration_takes_back(warm):
    line, other = fitted(BiasTemperature(1, 18.0), (5e-3,)), fitted(BiasTemperature(1), (4e-4,))
    board = warm_device(accelerometer=(line,) * warm, gyroscope=(*(other,) * warm, g_sensitivity()))
    truth = warm_samples()
    back = board.calibration.apply(imu_sensor(board, truth))
    np.testing.assert_allclose(back, truth, rtol=0, atol=1e-12)


# properties of accelparams and gyroparams by MathWorks' reference pages that are numbers
NUMBERS = {"MeasurementRange", "Resolution", "ConstantBias", "AxesMisalignment", "NoiseDensity"}
NUMBERS |= {"BiasInstability", "RandomWalk", "TemperatureBias", "TemperatureScaleFactor"}


@pytest.mark.parametrize("warm", [True, False])
def test_loadparams_gets_the_numbers_of_the_script(warm):
    board = warm_device(accelerometer=(fitted(BiasTemperature(1), (4e-4,)),) * warm, gyroscope=())
    board = replace(board, device="my-imu")
    script = assigned(MATLAB_IMU_SENSOR.text(board))
    # as loadparams reads it: without any white space; names of a struct are identifiers
    content = json.loads("".join(MATLAB_PARAMETERS.text(board).split()))
    assert all(name.isidentifier() and len(name) <= 63 for name in content)
    part = content["my_imu"]
    # it knows a magnetometer besides
    assert {*part} == {"Accelerometer", "Gyroscope"}
    for name, variable in (("Accelerometer", "accel"), ("Gyroscope", "gyro")):
        assert {*part[name]} <= NUMBERS
        assert ("TemperatureBias" in part[name]) == (warm and variable == "accel")
        for key, value in part[name].items():
            assert np.shape(value) in ((3,), (3, 3))
            np.testing.assert_array_equal(value, script[f"{variable}.{key}"])


def test_imu_sensors_noise_has_the_allan_deviation_of_our_model():
    board = device()
    found = assigned(MATLAB_IMU_SENSOR.text(board))
    for name, axes in SENSORS.items():
        of = f"{SHORT[name]}."
        assert found[f"{of}NoiseDensity"].tolist() == [N[axis] for axis in axes]
        assert found[f"{of}RandomWalk"].tolist() == [K[axis] for axis in axes]
        assert found[f"{of}BiasInstability"].tolist() == [B] * 3
        assert found[f"{of}NoiseType"] == "'single-sided'"
    rng, n, m, poles = np.random.default_rng(1), 400_000, 100, 1000
    assert found["accel.BiasInstabilityCoefficients"] == f"fractalcoef({poles})"
    white = found["accel.NoiseDensity"][0] * np.sqrt(RATE) * rng.standard_normal(n)
    walk = np.cumsum(found["accel.RandomWalk"][0] / np.sqrt(RATE) * rng.standard_normal(n))
    # Kasdin, equation 116, alpha = 1
    k = np.arange(1, poles + 1)
    a = np.concatenate([[1], np.cumprod((k - 1.5) / k)])
    flicker = lfilter([1], a, found["accel.BiasInstability"][0] * rng.standard_normal(n))
    noise, unseen = board.noise.axes["ax"], Coefficient()
    processes = (
        replace(noise, K=unseen, B=unseen),
        replace(noise, N=unseen, B=unseen),
        replace(noise, N=unseen, K=unseen),
    )
    expected = [np.sqrt(each.allan_variance(m / RATE)) for each in processes]
    # 4,000 means: 1.5 %; the flicker's floor holds to a few per cent over 100 samples
    np.testing.assert_allclose(allan(np.array([white, walk, flicker]), m), expected, rtol=0.06)
