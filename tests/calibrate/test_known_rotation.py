"""Turns of a known angle or rate: what comes back, held out too."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

import imuloop.effects  # noqa: F401
from bench.study.chain import run_stages
from imuloop import chain
from imuloop.calibrate.calibrate import calibrate_sensors
from imuloop.calibrate.known_rotation import read_turns
from imuloop.calibrate.sessions import raw_units, read_recording
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.chain import Device
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import SENSORS
from imuloop.model.calibration import Calibration

K = np.array([1.02, 0.985, 1.004])
T = np.array([[1.0, 0.006, -0.004], [0.003, 1.0, 0.002], [-0.005, 0.001, 1.0]])
BIAS = np.array([0.004, -0.002, 0.001])


def calibrate_device(folder, kinds, declared, paths):
    device = Device("d", folder, kinds)
    for name in kinds:
        keys = {k: v for k, v in declared.items() if k != "known_rotation" or name == "turns"}
        chain.ingest(device, name, keys, [paths[name]])
    run_stages(device, (chain.segment, chain.noise, chain.calibrate))
    return device


@pytest.fixture(scope="module")
def turntable(tmp_path_factory):
    """A turntable at two rates, whole turns about each axis, 20 s of rest before each."""
    folder, rng = tmp_path_factory.mktemp("table"), np.random.default_rng(5)
    rates, sections, at = [], [], 0.0
    for axis in range(3):
        for rate in (20.0, -40.0):
            w = np.zeros((4000, 3))
            w[2000:3800, axis] = np.radians(rate)
            rates.append(w)
            sections.append({"axis": "xyz"[axis], "rate": rate, "start": at + 21, "end": at + 37})
            at += 40
    w = np.concatenate(rates)
    # each turn is about one axis and ends where it began
    angle = np.cumsum(w, axis=0) / 100
    f = Rotation.from_rotvec(-angle).apply([0.0, 0.0, 9.80665])
    logged = w @ np.linalg.inv(T).T / K + BIAS
    columns = np.hstack([f, logged]) + rng.normal(0, [5e-3] * 3 + [1e-3] * 3, (len(w), 6))
    table = pd.DataFrame(columns, columns=["ax", "ay", "az", "gx", "gy", "gz"])
    table.insert(0, "t", np.arange(len(w)) / 100)
    table.to_parquet(folder / "log.parquet")
    declared = {"known_rotation": sections}
    paths = {"turns": folder / "log.parquet"}
    return calibrate_device(folder / "d", {"turns": "known_rotation"}, declared, paths)


def test_turntable_gives_scale_and_axes(turntable):
    gyroscope = Calibration.from_json(turntable.file("multi_position.json")).gyroscope
    assert gyroscope.method == "known_rotation"
    np.testing.assert_allclose(gyroscope.K, K, atol=3e-4)
    np.testing.assert_allclose(gyroscope.T, T, atol=3e-4)
    np.testing.assert_allclose(gyroscope.b, BIAS, atol=2e-4)
    six = Calibration.from_json(turntable.file("six_position.json")).accelerometer
    assert six.not_testable == "no six_position session with a pose"


def fit(device, turns, chosen):
    """Return the gyroscope's calibration by some of the turns and the rests between them."""
    recording = read_recording(device.sessions, 30.0, "known_rotation")
    recording = replace(recording, rotations=recording.rotations.select([]))
    noise = NoiseModel.from_json(device.file("noise.json"))
    units = dict(zip(SENSORS, raw_units(device.sessions), strict=True))
    how = recording, noise, device.gravity, units, CalibrateSettings()
    return calibrate_sensors(*how, turns=turns.select(chosen))["gyroscope"]


def test_turns_about_one_axis_leave_the_data_sheet_for_the_others(turntable):
    calibration = Calibration.from_json(turntable.file("multi_position.json"))
    turns = read_turns(turntable.sessions, calibration.accelerometer)
    gyroscope = fit(turntable, turns, slice(0, 2))
    assert gyroscope.K[0] == pytest.approx(K[0], abs=3e-4)
    assert {"K1", "K2"} <= set(gyroscope.unimproved) and "K0" not in gyroscope.unimproved
