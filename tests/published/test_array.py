"""Chips of an array at known places as one device."""

import numpy as np
import pandas as pd
import pytest

from bench.study.chain import run_stages
from imuloop import Calibration, chain
from imuloop.calibrate.recording import record
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.files import read_json
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import read_samples
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from imuloop.validate.new_bias import update_biases
from published.array_chips import GRAVITY, NOMINAL, RECORDINGS, ingest_chip


@pytest.mark.study
@pytest.mark.parametrize("chip", [1, 3, 7])
def test_biases_of_a_later_recording_take_most_of_its_error_away(
    recordings, tmp_path, monkeypatch, chip
):
    """Calibrated in one recording, updated in half of the other, judged in its second half."""
    monkeypatch.setenv("IMULOOP_MIRROR", str(recordings(f"{RECORDINGS[0]}.parquet").parent))
    devices = [ingest_chip(name, chip, tmp_path / name) for name in RECORDINGS]
    run_stages(devices[0], (chain.segment, chain.noise, chain.calibrate))
    old = Calibration.from_json(devices[0].file("multi_position.json"))
    noise = NoiseModel.from_json(devices[0].file("noise.json"))
    samples = read_samples(tmp_path / RECORDINGS[1] / "poses" / "samples.parquet")
    first = samples["t"] < samples["t"].iloc[-1] / 2
    halves = []
    for part in (samples[first], samples[~first]):
        segments, _ = segment_session(part, "multi_position", SegmentSettings())
        halves.append(record([part], [segments], CalibrateSettings().longest_rotation))
    new = update_biases(old, halves[0], noise, RECORDINGS[1])[0]
    poses, errors = halves[1].poses, []
    for each in (old, new):
        force, rate = each.apply_arrays(poses.f, poses.w)
        norm = np.linalg.norm(force, axis=1) - GRAVITY
        errors.append([np.sqrt(np.mean(norm**2)), np.sqrt(np.mean(rate**2))])
    less = np.divide(*errors)
    # found: 3 to 8 times, 5 to 14 times
    assert less[0] > 2.5 and less[1] > 4


@pytest.mark.study
@pytest.mark.parametrize("chips", [(1, 1, 1), (3, 5, 7)], ids=str)
def test_an_accelerometer_of_three_chips_shows_its_arms(recordings, tmp_path, chips):
    """Axes x, y, z of three parallel chips; the arms of the drawing, from motion alone."""
    kinds = dict.fromkeys(RECORDINGS, "multi_position")
    device = chain.Device("virtual", tmp_path, kinds, gravity=GRAVITY, nominal=NOMINAL)
    columns = {"time": "t_us", "angular_rate": [f"g{axis}{chips[2]}" for axis in "xyz"]}
    columns["acceleration"] = [f"a{axis}{chip}" for axis, chip in zip("xyz", chips, strict=True)]
    units = {"time": "us", "acceleration": "count", "angular_rate": "count"}
    for name in RECORDINGS:
        log = [recordings(f"{name}.parquet")]
        chain.ingest(device, name, {"columns": columns, "units": units}, log)
    run_stages(device)
    block = read_json(device.file("diagnosis.json"))["sensors"]["accelerometer"]["motion"]
    found = next(c for c in block["candidates"] if c["name"] == "lever_arm")
    value, std = (np.array(list(found[key].values())) for key in ("parameters", "std"))
    drawn = pd.read_csv(recordings("IMU_positions.csv"), index_col=0).to_numpy().T
    at = drawn[np.array(chips) - 1] - drawn[chips[2] - 1]
    assert np.all(std <= 20e-3)
    assert np.all(np.abs(value - at[:2].ravel()) < 3 * std)
