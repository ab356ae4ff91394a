"""Cells of CSV files that a spreadsheet would run."""

import csv

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from imuloop.core.cells import text_cell, text_cells
from imuloop.core.model import Calibration, SensorCalibration
from imuloop.core.samples import CHANNELS
from imuloop.core.units import RawUnit

RUN = ["=1+1", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1"]
LEFT = ["", "imu", "1-2", "a=b", " =1", "µ-imu"]


@pytest.mark.parametrize("text", RUN)
def test_what_a_spreadsheet_would_run_is_text(text):
    assert text_cell(text) == f"'{text}"


@pytest.mark.parametrize("text", LEFT)
def test_other_text_is_left_alone(text):
    assert text_cell(text) == text


def test_numbers_stay_numbers():
    table = pa.table({"x": [-1.5, None], "name": ["-1.5", None], "n": [-3, 4]})
    told = text_cells(table.set_column(1, "name", table["name"].dictionary_encode()))
    assert told.to_pydict() == {"x": [-1.5, None], "name": ["'-1.5", None], "n": [-3, 4]}


def test_text_and_names_of_a_log_in_calibrated_samples(tmp_path):
    columns = {"t": np.arange(3) / 10.0} | {name: -np.ones(3) for name in CHANNELS}
    columns |= {"=note": ["=1+1", "a,b", None], "a,b": [-1, -2, -3]}
    pq.write_table(pa.table(columns), tmp_path / "samples.parquet")
    sensors = (SensorCalibration.nominal(RawUnit(u, 1.0), "why") for u in ("m/s^2", "rad/s"))
    made = Calibration("d", 9.8, *sensors)
    made.apply_file(tmp_path / "samples.parquet", tmp_path / "out.csv")
    with open(tmp_path / "out.csv", newline="") as file:
        header, *rows = csv.reader(file)
    assert header == ["t", *CHANNELS, "'=note", "a,b"]
    assert [row[7:] for row in rows] == [["'=1+1", "-1"], ["a,b", "-2"], ["", "-3"]]
    assert all(float(row[1]) == -1 for row in rows)
