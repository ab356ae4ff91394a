"""Turns of a known angle or rate: what comes back, held out too."""

import numpy as np
import pandas as pd
import pytest

import imuloop.effects  # noqa: F401
from bench.study.chain import through
from imuloop import chain
from imuloop.calibrate.calibrate import by_turns
from imuloop.calibrate.known_rotation import read_turns
from imuloop.chain import Device
from imuloop.core.model import Calibration
from imuloop.core.units import RawUnit

K = np.array([1.02, 0.985, 1.004])
T = np.array([[1.0, 0.006, -0.004], [0.003, 1.0, 0.002], [-0.005, 0.001, 1.0]])
BIAS = np.array([0.004, -0.002, 0.001])


def calibrated(folder, kinds, declared, paths):
    device = Device("d", folder, kinds)
    for name in kinds:
        own = {k: v for k, v in declared.items() if k != "known_rotation" or name == "turns"}
        chain.ingest(device, name, own, [paths[name]])
    through(device, (chain.segment, chain.noise, chain.calibrate))
    return device


@pytest.fixture(scope="module")
def turntable(tmp_path_factory):
    """A turntable at two rates about each axis, 20 s of rest before each."""
    folder, rng = tmp_path_factory.mktemp("table"), np.random.default_rng(5)
    rates, sections, at = [], [], 0.0
    for axis in range(3):
        for rate in (20.0, -45.0):
            w = np.zeros((4000, 3))
            w[2000:, axis] = np.radians(rate)
            rates.append(w)
            sections.append({"axis": "xyz"[axis], "rate": rate, "start": at + 21, "end": at + 39})
            at += 40
    w = np.concatenate(rates)
    f = np.tile([0.0, 0.0, 9.80665], (len(w), 1))
    logged = w @ np.linalg.inv(T).T / K + BIAS
    columns = np.hstack([f, logged]) + rng.normal(0, [5e-3] * 3 + [1e-3] * 3, (len(w), 6))
    table = pd.DataFrame(columns, columns=["ax", "ay", "az", "gx", "gy", "gz"])
    table.insert(0, "t", np.arange(len(w)) / 100)
    table.to_parquet(folder / "log.parquet")
    declared = {"known_rotation": sections}
    paths = {"turns": folder / "log.parquet"}
    return calibrated(folder / "d", {"turns": "known_rotation"}, declared, paths)


def test_turntable_gives_scale_and_axes(turntable):
    found = Calibration.from_json(turntable.file("multi_position.json")).gyroscope
    assert found.method == "known_rotation"
    np.testing.assert_allclose(found.K, K, atol=3e-4)
    np.testing.assert_allclose(found.T, T, atol=3e-4)
    np.testing.assert_allclose(found.b, BIAS, atol=2e-4)


def test_turn_held_out_is_predicted_by_the_others(turntable):
    calibration = Calibration.from_json(turntable.file("multi_position.json"))
    turns = read_turns(turntable.sessions, calibration.accelerometer)
    assert len(turns) == 6
    for k in range(6):
        made = by_turns(turns.select(np.arange(6) != k), RawUnit("rad/s", 1.0))
        errors = turns.errors(made)[k]
        # half a degree over a full turn, of those about z, whose axis gravity gives, too
        assert np.linalg.norm(errors) < np.radians(0.5) * np.linalg.norm(turns.target[k]) / 6.28


def test_turns_about_one_axis_determine_nothing_alone(turntable):
    calibration = Calibration.from_json(turntable.file("multi_position.json"))
    turns = read_turns(turntable.sessions, calibration.accelerometer)
    assert by_turns(turns.select(slice(0, 2)), RawUnit("rad/s", 1.0)) is None
