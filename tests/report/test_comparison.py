"""The comparison of devices: what a filter takes, comparison.csv."""

import csv
import json
from itertools import product

import numpy as np
import pytest

from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import SENSORS
from imuloop.export.bound import bounding
from imuloop.model.calibration import Calibration
from imuloop.report.comparison import filter_cells, write_comparison
from imuloop.report.long_table import Value, select, worst


@pytest.fixture(scope="module")
def summaries(results):
    return {
        name: json.loads((results / name / "summary.json").read_text())
        for name in ("board", "still", "partly", "nothing")
    }


def test_a_filter_gets_the_worst_axis_or_its_limit_raised_for_the_flicker(summaries, results):
    calibration = Calibration.from_json(results / "board" / "calibration.json")
    noise = NoiseModel.from_json(results / "board" / "noise.json")
    rate, *cells = filter_cells(summaries["board"])
    bounds = {axis: bounding(noise.axes[axis]) for axis in noise.axes}
    for cell, (sensor, term) in zip(cells, product(SENSORS, (0, 1)), strict=True):
        part = getattr(calibration, sensor)
        gain = (part.T @ np.diag(part.K) / part.raw_unit.scale) ** 2
        sizes = np.sqrt(gain @ [bounds[axis][term] ** 2 for axis in SENSORS[sensor]])
        assert cell.value == pytest.approx(sizes.max(), rel=1e-12)
        assert float(cell.text) == pytest.approx(cell.value, rel=5e-3)
        assert cell.below.startswith(f"axis {'xyz'[sizes.argmax()]}")
    assert rate.text == "25"
    assert [c.text for c in filter_cells(summaries["nothing"])] == ["—"] * 5


def test_misalignments_are_those_that_were_estimated(summaries, results):
    sensor = json.loads((results / "board" / "calibration.json").read_text())["accelerometer"]
    rows = [Value(**row) for row in summaries["board"]["values"]]
    rows = select(rows, sensor="accelerometer", stage="final", quantity="misalignment")
    assert {row.axis: row.value for row in rows} == {
        pair: sensor["T"]["xyz".index(pair[0])]["xyz".index(pair[1])] for pair in ("xy", "xz", "yz")
    }
    with open(results / "comparison.csv", newline="", encoding="utf-8") as file:
        row = next(csv.DictReader(file))
    assert float(row["accelerometer_misalignment [rad]"]) == worst(rows)[0].value
    assert float(row["accelerometer_misalignment_yz [rad]"]) == sensor["T"][1][2]
    assert row["accelerometer_misalignment_zx [rad]"] == ""
    assert "gyroscope_K_upper95 [rad/s^2/sqrt(Hz)]" in row


def test_a_label_that_a_spreadsheet_would_run(summaries, tmp_path):
    hostile = [{**summary, "label": '=HYPERLINK("a";1)'} for summary in summaries.values()]
    write_comparison(tmp_path / "comparison.csv", hostile)
    below = []
    with open(tmp_path / "comparison.csv", newline="") as file:
        for row in csv.DictReader(file):
            assert row.pop("label") == '\'=HYPERLINK("a";1)'
            assert not any(cell.startswith(("'", "=", "@", "+")) for cell in row.values())
            below += [cell for cell in row.values() if cell.startswith("-")]
    # numbers stay numbers, those below zero too
    assert below and all(float(cell) < 0 for cell in below)
