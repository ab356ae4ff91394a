"""Tables of all sessions of a device in one file; cells that a spreadsheet would run."""

import csv

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from imuloop.core.samples import CALIBRATED, CHANNELS
from imuloop.core.tables import joined, read_session, table, text_cell, write_sessions
from imuloop.core.units import RawUnit
from imuloop.model.calibration import Calibration
from imuloop.model.sensor_calibration import SensorCalibration


def test_each_session_comes_back_from_the_table_of_all(tmp_path):
    path, names = tmp_path / "t.parquet", ("axis", "x")
    first, second = table(names, "ax", [1.0, 2.0]), table(names, "gy", [3.0])
    none = table(names, "", [])
    write_sessions(path, {"a": joined([first, second]), "b": none, "": none})
    columns = read_session(path, "a")
    assert columns["axis"].tolist() == ["ax", "ax", "gy"]
    np.testing.assert_array_equal(columns["x"], [1.0, 2.0, 3.0])
    assert [len(column) for column in read_session(path, "b").values()] == [0, 0]


def test_what_a_spreadsheet_would_run_is_text():
    for text in ("=1+1", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1"):
        assert text_cell(text) == f"'{text}"
    for text in ("", "imu", "1-2", "a=b", " =1", "µ-imu"):
        assert text_cell(text) == text


def test_calibrated_samples_keep_numbers_and_quote_the_text_of_a_log(tmp_path):
    columns = {"t": np.arange(3) / 10.0} | {name: -np.ones(3) for name in CHANNELS}
    columns |= {"=note": ["=1+1", "a,b", None], "a,b": [-1, -2, -3]}
    # row groups of others
    pq.write_table(pa.table(columns), tmp_path / "samples.parquet", row_group_size=2)
    sensors = (SensorCalibration.nominal(RawUnit(u, 1.0), "why") for u in ("m/s^2", "rad/s"))
    calibration = Calibration("d", 9.8, *sensors)
    calibration.apply_file(tmp_path / "samples.parquet", tmp_path / "out.csv", nominal=True)
    with open(tmp_path / "out.csv", newline="") as file:
        header, *rows = csv.reader(file)
    assert header == ["t", *CHANNELS, "'=note", "a,b", CALIBRATED]
    assert [row[7:] for row in rows] == [["'=1+1", "-1", "1"], ["a,b", "-2", "1"], ["", "-3", "1"]]
    assert all(float(row[1]) == -1 for row in rows)
