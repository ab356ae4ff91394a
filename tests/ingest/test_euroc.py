"""A sensor's folder of an EuRoC recording."""

import csv
import os

import numpy as np
import pytest

HEADER = ["#timestamp [ns]"]
HEADER += [f"w_RS_S_{axis} [rad s^-1]" for axis in "xyz"]
HEADER += [f"a_RS_S_{axis} [m s^-2]" for axis in "xyz"]


def write(folder, stamps, values):
    with open(folder / "data.csv", "w", newline="") as file:
        rows = values[:, [3, 4, 5, 0, 1, 2]].tolist()
        csv.writer(file).writerows(
            [HEADER, *([int(t), *x] for t, x in zip(stamps, rows, strict=True))]
        )


@pytest.fixture
def folder(log, tmp_path):
    folder = tmp_path / "mav0" / "imu0"
    folder.mkdir(parents=True)
    stamps = 1_403_636_579_758_555_393 + 10_000_001 * np.arange(500)
    write(folder, stamps, log.to_numpy()[:, 1:])
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
    write(folder, hard_stamps, hard)
    every_bit(folder, hard, hard_stamps)
    every_bit(folder / "data.csv", hard, hard_stamps)


def test_a_folder_without_a_table(run, folder):
    (folder / "data.csv").unlink()
    os.mkfifo(folder / "data.csv")
    assert run(folder, format="euroc").quality["reasons"] == ["the folder holds no data.csv"]
