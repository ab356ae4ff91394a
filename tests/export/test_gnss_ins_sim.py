"""The model for gnss-ins-sim, taken and simulated as the simulator does."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from export.devices import HOSTILE, N, device, unknown
from imuloop.core.errors import Lacking
from imuloop.core.noise_model import Coefficient, GaussMarkov
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.export import gnss_ins_sim

RATE = 200.0
# flicker of every axis of the device
B = 3e-5


def load(text):
    """Return the dictionary that the file makes."""
    names = {}
    # bytes, so that the line on the encoding counts
    exec(compile(text.encode(), gnss_ins_sim.FILE, "exec"), names)
    return names["imu_err"]


def errors(model):
    """Return SI parameters as IMU.__init__ does: rates from deg/h, noise from per root hour."""
    degree = np.pi / 180
    return {
        "gyro": {
            "b": model["gyro_b"] * degree / 3600,
            "white": model["gyro_arw"] * degree / 60,
            "drift": model["gyro_b_stability"] * degree / 3600,
            "corr": model["gyro_b_corr"],
        },
        "accel": {
            "b": model["accel_b"],
            "white": model["accel_vrw"] / 60,
            "drift": model["accel_b_stability"],
            "corr": model["accel_b_corr"],
        },
    }


def allan(x, m):
    """Return the Allan deviation over m samples, shape (3,)."""
    means = x[: len(x) // m * m].reshape(-1, m, 3).mean(axis=1)
    return np.sqrt(np.mean(np.diff(means, axis=0) ** 2, axis=0) / 2)


def test_bias_and_white_noise_are_ours():
    board = device()
    found = errors(load(gnss_ins_sim.text(board)))
    for key, name, axes in (
        ("accel", "accelerometer", ACCELERATION),
        ("gyro", "gyroscope", ANGULAR_RATE),
    ):
        sensor = board.sensor(name)
        # what the log shows at truth zero, but for T, K and effects
        bias = (sensor.b - sensor.raw_unit.offset) * sensor.raw_unit.scale
        np.testing.assert_allclose(found[key]["b"], bias, rtol=1e-14)
        np.testing.assert_allclose(found[key]["white"], [N[a] for a in axes], rtol=1e-14)
        assert (found[key]["corr"] == 100).all()


def test_the_simulated_noise_has_the_allan_deviation_of_our_model():
    board = device()
    accel = errors(load(gnss_ins_sim.text(board)))["accel"]
    # white noise as the simulator makes it
    x = np.random.default_rng(1).standard_normal((200_000, 3)) * accel["white"] * np.sqrt(RATE)
    for m in (1, 20):
        expected = [N[axis] / np.sqrt(m / RATE) for axis in ACCELERATION]
        np.testing.assert_allclose(allan(x, m), expected, rtol=0.03)


def test_a_flicker_becomes_a_process_whose_peak_is_its_floor():
    accel = errors(load(gnss_ins_sim.text(device())))["accel"]
    u = np.linspace(1, 3, 2001)
    # IEEE Std 952-1997, C.1.5, of standard deviation 1
    variance = 2 / u * (1 - (3 - 4 * np.exp(-u) + np.exp(-2 * u)) / (2 * u))
    peak = accel["drift"][0] * np.sqrt(variance.max())
    assert peak == pytest.approx(B * np.sqrt(2 * np.log(2) / np.pi), rel=1e-4)


def test_a_gauss_markov_process_is_taken_as_it_is():
    board = device()
    known = [Coefficient(value, None, value, True) for value in (3e-6, 40.0, 2e-6, 900.0)]
    weak, strong = GaussMarkov(known[0], known[1]), GaussMarkov(known[2], known[3])
    axes = dict(board.noise.axes, gy=replace(board.noise.axes["gy"], gauss_markov=(weak, strong)))
    board = replace(board, noise=replace(board.noise, axes=axes))
    text = gnss_ins_sim.text(board)
    gyro = errors(load(text))["gyro"]
    assert gyro["corr"].tolist() == [100.0, 900.0, 100.0]
    # stationary: q^2 T / 2
    assert gyro["drift"][1] == pytest.approx(np.sqrt(2e-6**2 * 900 / 2), rel=1e-14)
    assert "gy: Gauss-Markov process" in text


def test_what_it_cannot_carry_is_said():
    text = gnss_ins_sim.text(device())
    assert "Not carried of the accelerometer: misalignment T" in text
    assert "Not carried of the gyroscope: g_sensitivity" in text
    assert "scale factor K" in text


@pytest.mark.parametrize("label", [HOSTILE, "coding: utf-16", "coding=nonsense"])
def test_a_label_adds_no_statement(label):
    assert str(load(gnss_ins_sim.text(device(label)))) == str(load(gnss_ins_sim.text(device())))


def test_the_file_hides_no_package():
    assert gnss_ins_sim.FILE.removesuffix(".py") not in ("gnss_ins_sim", *sys.stdlib_module_names)


def test_no_file_without_noise():
    with pytest.raises(Lacking, match="no noise"):
        gnss_ins_sim.text(unknown())


def test_the_simulators_own_class_takes_it():
    imu_model = pytest.importorskip("gnss_ins_sim.sim.imu_model")
    model = load(gnss_ins_sim.text(device()))
    imu = imu_model.IMU(accuracy=model, axis=6, gps=False)
    found = errors(model)
    np.testing.assert_allclose(imu.gyro_err["arw"], found["gyro"]["white"], rtol=1e-14)
    np.testing.assert_allclose(imu.accel_err["vrw"], found["accel"]["white"], rtol=1e-14)
    np.testing.assert_allclose(imu.gyro_err["b_drift"], found["gyro"]["drift"], rtol=1e-14)
