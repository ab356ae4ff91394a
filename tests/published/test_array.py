"""Eight chips of one board at known places, shaken: bench.array prints the figures."""

import numpy as np
import pandas as pd
import pytest

from bench.array import CHIPS, GRAVITY, NOMINAL, RECORDINGS, calibrated, places, related
from bench.study.chain import through
from imuloop import chain
from imuloop.core.files import read_json


@pytest.fixture(scope="module")
def board(recordings, tmp_path_factory):
    recordings("exp_1.parquet")
    folder = tmp_path_factory.mktemp("array")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("IMULOOP_MIRROR", str(recordings.folder))
        devices = [calibrated(folder, "exp_1", CHIPS[0])]
        noise = devices[0].file("noise.json").read_text()

        def as_of_the_first(device):
            device.file("noise.json").write_text(noise)
            return []

        # chips of one kind, and the noise takes longest
        patch.setattr(chain, "noise", as_of_the_first)
        devices += [calibrated(folder, "exp_1", chip) for chip in CHIPS[1:]]
        for device in devices:
            made = device.file("multi_position.json").read_text()
            device.file("calibration.json").write_text(made)
        content = related(folder, devices)
        return content, *places(content)


def test_the_places_of_the_chips_are_those_of_the_drawing(board):
    _, arms, std, nominal = board
    apart = arms - nominal
    assert np.sqrt((apart**2).sum(axis=1).mean()) <= 0.5e-3
    # chips are soldered to some tenth of a millimetre, which σ does not hold
    assert np.all(std < 0.25e-3) and np.all(np.abs(apart) < 4 * np.hypot(std, 0.1e-3))


def test_chips_on_either_side_of_the_board_are_turned_by_half_a_turn(board):
    found = [np.array(d["rotation"]) for d in board[0]["devices"].values()]
    turned = [[[1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, -1, 0], [-1, 0, 0], [0, 0, -1]]]
    for number, rotation in enumerate(found):
        np.testing.assert_allclose(rotation, turned[number % 2], atol=0.02)


def test_what_the_rotations_leave_is_no_chips_own(board):
    content = board[0]
    closure = content["common"]["closure"]
    assert closure["verdict"] == "common" and closure["error"] > 5 * closure["floor"]
    for device in content["devices"].values():
        assert device["turn"]["error"] < 0.5 * closure["error"]
        assert {device[kind]["verdict"] for kind in ("turn", "gravity_norm")} <= {
            "consistent",
            "undecided",
        }
    assert content["common"]["gravity_norm"]["verdict"] == "consistent"


@pytest.mark.study
@pytest.mark.parametrize("chips", [(1, 1, 1), (3, 5, 7)], ids=str)
def test_an_accelerometer_of_three_chips_shows_its_arms(recordings, tmp_path, chips):
    """Axes x, y, z of three chips that lie alike; the arms of the drawing, from motion alone."""
    kinds = dict.fromkeys(RECORDINGS, "multi_position")
    device = chain.Device("virtual", tmp_path, kinds, gravity=GRAVITY, nominal=NOMINAL)
    columns = {"time": "t_us", "angular_rate": [f"g{axis}{chips[2]}" for axis in "xyz"]}
    columns["acceleration"] = [f"a{axis}{chip}" for axis, chip in zip("xyz", chips, strict=True)]
    units = {"time": "us", "acceleration": "count", "angular_rate": "count"}
    for name in RECORDINGS:
        log = [recordings(f"{name}.parquet")]
        assert chain.ingest(device, name, {"columns": columns, "units": units}, log) == []
    through(device)
    block = read_json(device.file("diagnosis.json"))["sensors"]["accelerometer"]["motion"]
    found = next(c for c in block["candidates"] if c["name"] == "lever_arm")
    value, std = (np.array(list(found[key].values())) for key in ("parameters", "std"))
    drawn = pd.read_csv(recordings("IMU_positions.csv"), index_col=0).to_numpy().T
    at = drawn[np.array(chips) - 1] - drawn[chips[2] - 1]
    assert np.all(std <= 20e-3)
    assert np.all(np.abs(value - at[:2].ravel()) < 3 * std)
