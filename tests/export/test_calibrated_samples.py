"""imu_tk's and OpenVINS' files, read and applied as these tools do, give our calibrated samples."""

from dataclasses import replace

import numpy as np
import pytest

from export.devices import IMU_TK_ACC, IMU_TK_GYRO, OPENVINS, calibration_with, device, samples
from export.test_densities import opencv
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, SENSORS
from imuloop.model.effect import Channels, find_effect


@pytest.mark.parametrize(
    ("sensor", "written"), [("accelerometer", IMU_TK_ACC), ("gyroscope", IMU_TK_GYRO)]
)
def test_imu_tk(sensor, written):
    board, table, columns = device(), samples(), list(SENSORS[sensor])
    text = written.text(board)
    # CalibratedTriad::load: 9, 9 and 3 numbers, parted by white space
    loaded = np.array(text.split()[:21], dtype=float)
    T, K, b = loaded[:9].reshape(3, 3), loaded[9:18].reshape(3, 3), loaded[18:]
    assert np.diag(T).tolist() == [1, 1, 1] and (K == np.diag(np.diag(K))).all()
    # unbiasNormalize: T K (X - B)
    calibrated = (board.sensor(sensor).raw_unit.from_si(table[columns]) - b) @ (T @ K).T
    expected = calibration_with(board, ()).apply(table)[columns]
    np.testing.assert_allclose(calibrated, expected, rtol=0, atol=1e-14 * 20)
    below = "\n".join(text.splitlines()[12:])
    assert all(line.startswith("#") for line in below.splitlines())
    assert f"{board.sensor(sensor).raw_unit.name}, to subtract" in below
    assert ("Not carried of the gyroscope: g_sensitivity" in below) == (sensor == "gyroscope")


def through_openvins(exported, table):
    content = OPENVINS.text(exported)
    imu = opencv(content)["imu0"]
    Ta, Tw, Tg, to_acc, to_gyro = (
        np.array(imu[key]) for key in ("Ta", "Tw", "Tg", "R_IMUtoACC", "R_IMUtoGYRO")
    )
    np.testing.assert_allclose(to_gyro @ to_gyro.T, np.eye(3), rtol=0, atol=1e-15)
    assert np.linalg.det(to_gyro) == pytest.approx(1, abs=1e-14)
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


@pytest.mark.parametrize("board", [device(), device(effects=())], ids=["g_sensitivity", "base"])
def test_openvins(board):
    table = samples()
    expected = board.calibration.apply(table)
    a, w = through_openvins(board, table)
    np.testing.assert_allclose(a, expected[list(ACCELERATION)], rtol=0, atol=2e-13)
    np.testing.assert_allclose(w, expected[list(ANGULAR_RATE)], rtol=0, atol=2e-14)


def test_an_offset_beside_a_reference_has_the_sign_of_the_effect():
    text = OPENVINS.text(
        replace(device(), reference={("gyroscope", "time_offset"): {"dt": -0.004}})
    )
    # what reads t at t is, where the effect is taken out, the value that is stamped 4 ms later
    t = np.arange(0, 1, 0.01)
    ramp = np.repeat(t[:, None], 3, axis=1)
    effect = find_effect("time_offset")()
    e = -0.004 * effect.design_at(Channels(t, ramp, ramp, None), (-0.004,))[..., 0]
    np.testing.assert_allclose((ramp - e)[5:-5], ramp[5:-5] + 0.004, rtol=0, atol=1e-9)
    assert opencv(text)["imu0"]["time_offset"] == -0.004
    assert "stamped 10 s was there at 9.99600 s" in text
