"""OpenVINS' intrinsics, put through its own model, give our calibrated samples."""

import numpy as np
import pytest

from export.devices import device, samples, without_effects
from export.test_densities import opencv
from export.warm_device import narrow_device, warm_device
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.export.openvins import text


def through_openvins(exported, table):
    """Return specific force and angular rate as Propagator::predict_and_compute has them."""
    content = text(exported)
    imu = opencv(content)["imu0"]
    Ta, Tw, Tg, to_acc, to_gyro = (
        np.array(imu[key]) for key in ("Ta", "Tw", "Tg", "R_IMUtoACC", "R_IMUtoGYRO")
    )
    biases = {
        key: np.array(opencv(f"%YAML:1.0\n{line.removeprefix('# ').partition(' (')[0]}")[key])
        for line in content.splitlines()
        for key in ("init_dyn_bias_a", "init_dyn_bias_g")
        if line.startswith(f"# {key}: ")
    }
    # model "rpng" keeps what is on and above the diagonal
    assert imu["model"] == "rpng"
    Da, Dw = np.triu(np.linalg.inv(Ta)), np.triu(np.linalg.inv(Tw))
    am, wm = table[list(ACCELERATION)].to_numpy(), table[list(ANGULAR_RATE)].to_numpy()
    a = (am - biases["init_dyn_bias_a"]) @ (to_acc.T @ Da).T
    w = (wm - biases["init_dyn_bias_g"] - a @ Tg.T) @ (to_gyro.T @ Dw).T
    return a, w


@pytest.mark.parametrize("effects", [True, False], ids=["g_sensitivity", "base"])
def test_the_same_calibrated_samples(effects):
    board, table = device() if effects else device(effects=()), samples()
    expected = board.calibration.apply(table)
    a, w = through_openvins(board, table)
    np.testing.assert_allclose(a, expected[list(ACCELERATION)], rtol=0, atol=2e-13)
    np.testing.assert_allclose(w, expected[list(ANGULAR_RATE)], rtol=0, atol=2e-14)


def test_g_sensitivity_matters_here():
    table = samples()
    _, w = through_openvins(device(), table)
    bare = without_effects(device()).apply(table)[list(ANGULAR_RATE)].to_numpy()
    assert np.abs(w - bare).max() > 1e-3


def test_the_range_of_what_it_cannot_hold_is_said():
    board = narrow_device()
    seen = board.sensor("gyroscope").effects[1].seen
    line = next(line for line in text(board).splitlines() if "g_sensitivity was seen" in line)
    assert line.endswith("m/s^2; OpenVINS holds it to no range")
    for axis, (low, high) in zip("xyz", (seen[f"G0{j}"] for j in range(3)), strict=True):
        assert f"f_{axis} from {low:g} to {high:g}" in line
    assert "was seen" not in text(device())
    assert opencv(text(board))["imu0"] == opencv(text(warm_device()))["imu0"]


def test_rotations_are_rotations():
    imu = opencv(text(device()))["imu0"]
    rotation = np.array(imu["R_IMUtoGYRO"])
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), rtol=0, atol=1e-15)
    assert np.linalg.det(rotation) == pytest.approx(1, abs=1e-14)
    assert np.array(imu["T_i_b"]).tolist() == np.eye(4).tolist()
