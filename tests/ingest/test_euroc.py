"""A sensor's folder of an EuRoC recording."""

import csv
import os

import numpy as np
import pytest

HEADER = ["#timestamp [ns]"]
HEADER += [f"w_RS_S_{axis} [rad s^-1]" for axis in "xyz"]
HEADER += [f"a_RS_S_{axis} [m s^-2]" for axis in "xyz"]


@pytest.fixture
def folder(log, tmp_path):
    folder = tmp_path / "mav0" / "imu0"
    folder.mkdir(parents=True)
    rows = log[["gx", "gy", "gz", "ax", "ay", "az"]].to_numpy().tolist()
    with open(folder / "data.csv", "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(HEADER)
        for i, row in enumerate(rows):
            writer.writerow([1_403_636_579_758_555_393 + 10_000_001 * i, *row])
    (folder / "sensor.yaml").write_text("sensor_type: imu\nrate_hz: 200\n")
    return folder


@pytest.mark.parametrize("name", [".", "data.csv"])
def test_folder_and_table_alone_come_back_exactly(log, run, folder, name):
    done = run(folder / name)
    np.testing.assert_array_equal(done.samples.t, 10_000_001 * np.arange(500) * 1e-9)
    np.testing.assert_array_equal(done.samples.iloc[:, 1:], log.iloc[:, 1:])
    assert done.metadata["start"] == "2014-06-24T19:02:59.758555393Z"
    assert done.quality["log_format"] == ("euroc" if name == "." else "csv")
    assert "data.csv" in done.metadata["sha256"]
    small = run(folder / name, batch_rows=9)
    assert small.path.read_bytes() == run(folder / name).path.read_bytes()


def test_every_bit(hard, hard_stamps, every_bit, folder):
    with open(folder / "data.csv", "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(HEADER)
        for i, row in enumerate(hard[:, [3, 4, 5, 0, 1, 2]].tolist()):
            writer.writerow([int(hard_stamps[i]), *row])
    every_bit(folder, hard, hard_stamps)
    every_bit(folder / "data.csv", hard, hard_stamps)


def test_a_folder_without_a_table(run, folder):
    (folder / "data.csv").unlink()
    os.mkfifo(folder / "data.csv")
    assert run(folder, format="euroc").quality["reasons"] == ["the folder holds no data.csv"]
