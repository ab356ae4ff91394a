"""The comparison of devices: what a filter takes, comparison.csv."""

import csv
import json

import numpy as np
import pytest

from imuloop.core.noise_model import NoiseModel
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
    calibration = Calibration.from_json(results / "still" / "calibration.json")
    noise = NoiseModel.from_json(results / "still" / "noise.json")
    rate, n_a, k_a, n_g, k_g = filter_cells(summaries["still"])
    for cell, term, sensor in ((n_a, "N", "a"), (k_a, "K", "a"), (n_g, "N", "g")):
        axes = [noise.axes[f"{sensor}{axis}"] for axis in "xyz"]
        # the axes are the same, as logged
        bounds = [dict(zip("NK", bounding(each), strict=True))[term] for each in axes]
        assert len({*bounds}) == 1 and bounds[0] > getattr(axes[0], term).size
        of = calibration.accelerometer if sensor == "a" else calibration.gyroscope
        gain = np.sqrt(((of.T @ np.diag(of.K) / of.raw_unit.scale) ** 2).sum(axis=1))
        assert cell.value == pytest.approx(bounds[0] * gain.max(), rel=1e-12)
        assert float(cell.text) == pytest.approx(cell.value, rel=5e-3)
        axis, own = "xyz"[int(gain.argmax())], getattr(axes[0], term).size * gain.max()
        limit = f"axis {axis}: none seen, so its 95 % limit" if term == "K" else f"axis {axis}"
        assert cell.below == f"{limit}, raised from {own:.2e}"
    # large enough next to the white noise that was raised
    assert k_g.value == pytest.approx(3e-6 * gain.max(), rel=1e-12)
    assert rate.text == "20"
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
    hostile = [{**each, "label": '=HYPERLINK("a";1)'} for each in summaries.values()]
    write_comparison(tmp_path / "comparison.csv", hostile)
    below = []
    with open(tmp_path / "comparison.csv", newline="") as file:
        for row in csv.DictReader(file):
            assert row.pop("label") == '\'=HYPERLINK("a";1)'
            assert not any(cell.startswith(("'", "=", "@", "+")) for cell in row.values())
            below += [cell for cell in row.values() if cell.startswith("-")]
    # numbers stay numbers, those below zero too
    assert below and all(float(cell) < 0 for cell in below)
