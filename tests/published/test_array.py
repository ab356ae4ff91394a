"""Chips of an array at known places as one device."""

import numpy as np
import pandas as pd
import pytest

from bench.study.chain import run_stages
from imuloop import chain
from imuloop.core.files import read_json
from published.array_chips import GRAVITY, NOMINAL, RECORDINGS


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
    arm = next(c for c in block["candidates"] if c["name"] == "lever_arm")
    value, std = (np.array(list(arm[key].values())) for key in ("parameters", "std"))
    drawn = pd.read_csv(recordings("IMU_positions.csv"), index_col=0).to_numpy().T
    at = drawn[np.array(chips) - 1] - drawn[chips[2] - 1]
    assert np.all(std <= 20e-3)
    assert np.all(np.abs(value - at[:2].ravel()) < 3 * std)
