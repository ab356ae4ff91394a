"""Logs of one sensor: effects that it can show are found, the others are not testable."""

from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
import yaml

import imuloop
from imuloop.__main__ import main
from imuloop.core.errors import ImuloopError
from imuloop.core.samples import SENSORS

RATE, STEP = 1e-3, 0.01
LEVEL = np.array([5e-3, -2e-3, 1e-3])


def at_rest(seconds=120):
    rng = np.random.default_rng(2)
    t = STEP * np.arange(int(seconds / STEP))
    w = LEVEL + RATE / np.sqrt(STEP) * rng.normal(size=(len(t), 3))
    return pd.DataFrame(np.column_stack([t, w]), columns=["t", "gx", "gy", "gz"])


def in_many_attitudes(scale, bias):
    """Return specific force in m/s^2 of 30 s in one attitude, then 5 s each in 24 more."""
    rng = np.random.default_rng(3)
    up = rng.normal(size=(25, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    parts = [np.tile(up[0], (3000, 1))]
    for a, b in pairwise(up):
        share = np.linspace(0, 1, 150)[:, None]
        on_the_way = a + (3 * share**2 - 2 * share**3) * (b - a)
        parts += [on_the_way / np.linalg.norm(on_the_way, axis=1, keepdims=True)]
        parts += [np.tile(b, (500, 1))]
    force = 9.80665 * np.concatenate(parts) / scale + bias
    force += 0.01 * rng.normal(size=force.shape)
    t = STEP * np.arange(len(force))
    return pd.DataFrame(np.column_stack([t, force]), columns=["t", "ax", "ay", "az"])


def test_an_accelerometer_alone_is_calibrated():
    scale, bias = np.array([1.01, 0.99, 1.005]), np.array([0.1, -0.05, 0.02])
    with pytest.warns(UserWarning) as said:
        found = imuloop.calibrate(in_many_attitudes(scale, bias))
    assert "the log holds no angular_rate: what needs it is not testable" in str(said[0].message)
    sensor = found.calibration.accelerometer
    std = np.array([sensor.std[f"K{k}"] for k in range(3)])
    assert (std < 2e-4).all()
    assert (np.abs(sensor.K - scale) < 4 * std).all()
    verdict = found.diagnosis["sensors"]
    assert verdict["accelerometer"]["poses"]["verdict"] == "consistent"
    assert verdict["gyroscope"]["poses"]["verdict"] == "not_testable"
    assert found.noise["ax"].N.value == pytest.approx(0.01 * np.sqrt(STEP), rel=0.05)
    assert found.noise["gx"].N.value is None


def test_a_gyroscope_alone_at_rest_has_noise_and_bias(tmp_path, blank_figures):
    with pytest.warns(UserWarning, match="the log holds no acceleration: what needs it is not t"):
        found = imuloop.calibrate(at_rest(), folder=tmp_path / "made", progress=False)
    found.report(tmp_path / "report.html")
    files = {path.name: path.read_text() for path in found.export(tmp_path / "files")}
    assert {"kalibr_imu.yaml", "imu_calibration.h"} <= {*files}
    assert "accelerometer_" not in files["kalibr_imu.yaml"] + files["imu_calibration.h"]
    for axis in ("gx", "gy", "gz"):
        assert found.noise[axis].N.value == pytest.approx(RATE, rel=0.05)
        assert found.noise[axis.replace("g", "a")].N.value is None
    np.testing.assert_allclose(found.calibration.gyroscope.b, LEVEL, atol=5 * RATE / np.sqrt(120))
    verdicts = found.diagnosis["sensors"]
    assert {verdicts[s]["poses"]["verdict"] for s in verdicts} == {"not_testable"}


@pytest.mark.parametrize("sensor", SENSORS)
def test_its_noise_comes_with_files_of_this_sensor_alone(sensor, tmp_path, capsys, blank_figures):
    log = at_rest(60) if sensor == "gyroscope" else in_many_attitudes(np.ones(3), 0.0)[:3000]
    log.to_csv(tmp_path / "log.csv", index=False)
    assert main(["noise", str(tmp_path / "log.csv"), "-o", str(tmp_path / "out")]) == 0
    (other,) = {*SENSORS} - {sensor}
    printed = capsys.readouterr().out
    assert f"\n{sensor} " in printed and f"\n{other} " not in printed
    files = {path.name: path for path in (tmp_path / "out").iterdir()}
    assert {"noise.json", f"allan_{sensor}.svg"} <= {*files} and f"allan_{other}.svg" not in files
    assert set(pd.read_csv(files["allan.csv"])["axis"]) == {*SENSORS[sensor]}
    kalibr = yaml.safe_load(files["kalibr_imu.yaml"].read_text())
    assert [key for key in kalibr if "noise" in key] == [f"{sensor}_noise_density"]
    for path in files.values():
        if path.suffix == ".yaml":
            assert f"{other}_" not in path.read_text()


def test_columns_that_may_be_the_other_sensor_s_are_not_passed_over():
    log = at_rest().assign(u=1.0, v=2.0, w=3.0)
    with pytest.raises(ImuloopError, match=r"no columns of acceleration found .* declare columns"):
        imuloop.calibrate(log)
    with pytest.warns(UserWarning, match="the log holds no acceleration"):
        assert imuloop.calibrate(log, columns={"acceleration": None}).noise["gx"].N.value
