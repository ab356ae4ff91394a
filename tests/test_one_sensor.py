"""Logs of one sensor: effects that it can show are found, the others are not testable."""

import numpy as np
import pandas as pd
import pytest
import yaml

import imuloop
from imuloop.__main__ import main
from imuloop.core.errors import ImuloopError
from imuloop.core.samples import SENSORS
from imuloop.simulate.truth import example_truth
from quick import hurry

RATE, STEP = 1e-3, 0.01
LEVEL = np.array([5e-3, -2e-3, 1e-3])


def at_rest(seconds=120):
    rng = np.random.default_rng(2)
    t = STEP * np.arange(int(seconds / STEP))
    w = LEVEL + RATE / np.sqrt(STEP) * rng.normal(size=(len(t), 3))
    return pd.DataFrame(np.column_stack([t, w]), columns=["t", "gx", "gy", "gz"])


def test_an_accelerometer_alone_is_calibrated(device):
    true = example_truth().accelerometer
    log = pd.read_csv(device / "1.csv")[["t", "ax", "ay", "az"]]
    with pytest.warns(UserWarning) as said, hurry("device"):
        result = imuloop.calibrate(log)
    assert "the log holds no angular_rate: what needs it is not testable" in str(said[0].message)
    sensor = result.calibration.accelerometer
    std = np.array([sensor.std[f"K{k}"] for k in range(3)])
    assert (std < 4e-4).all()
    assert (np.abs(sensor.K - true.K) < 4 * std).all()
    verdict = result.diagnosis["sensors"]
    assert verdict["accelerometer"]["poses"]["verdict"] == "consistent"
    assert verdict["gyroscope"]["poses"]["verdict"] == "not_testable"
    for axis, density in zip(SENSORS["accelerometer"], true.noise.N, strict=True):
        assert result.noise[axis].N.value == pytest.approx(density, rel=0.1)
    assert result.noise["gx"].N.value is None


def test_a_gyroscope_alone_at_rest_has_noise_and_bias(tmp_path, blank_figures):
    with pytest.warns(UserWarning, match="the log holds no acceleration: what needs it is not t"):
        result = imuloop.calibrate(at_rest(), folder=tmp_path / "made", progress=False)
    result.report(tmp_path / "report.html")
    files = {path.name: path.read_text() for path in result.export(tmp_path / "files")}
    assert {"kalibr_imu.yaml", "imu_calibration.h"} <= {*files}
    assert "accelerometer_" not in files["kalibr_imu.yaml"] + files["imu_calibration.h"]
    for axis in ("gx", "gy", "gz"):
        assert result.noise[axis].N.value == pytest.approx(RATE, rel=0.05)
        assert result.noise[axis.replace("g", "a")].N.value is None
    np.testing.assert_allclose(result.calibration.gyroscope.b, LEVEL, atol=5 * RATE / np.sqrt(120))
    verdicts = result.diagnosis["sensors"]
    assert {verdicts[s]["poses"]["verdict"] for s in verdicts} == {"not_testable"}


@pytest.mark.parametrize("sensor", SENSORS)
def test_its_noise_comes_with_files_of_this_sensor_alone(sensor, tmp_path, capsys, blank_figures):
    log = at_rest(60)
    if sensor == "accelerometer":
        log = log.set_axis(["t", *SENSORS[sensor]], axis=1).assign(az=log["gz"] + 9.81)
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
