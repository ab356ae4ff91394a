"""The comparison of devices: what is said of each, what a filter takes."""

import csv
import json

import numpy as np
import pytest

from imuloop.core.noise_model import NoiseModel
from imuloop.export.bound import bounding
from imuloop.model.calibration import Calibration
from imuloop.report.figures.comparison import allan_comparison
from imuloop.report.summary import PAIRS
from imuloop.report.tables.comparison import (
    filter_cells,
    write_comparison,
)
from imuloop.report.verdict import answers


def test_allan_curves_are_told_by_their_lowest_value(tmp_path):
    def device(label, level):
        curve = {"tau_s": [0.1, 10.0], "adev": [level, level]}
        return {"label": label, "allan": {"ax": curve}}

    one, two = device("A", 2e-3), device("B", 1e-3)
    (picture,) = allan_comparison([one], tmp_path, together=True)
    assert picture.caption == "Accelerometer x, m/s²: A down to 0.00200."
    (picture,) = allan_comparison([one, two], tmp_path, together=True)
    assert picture.caption.endswith("A down to 0.00200; B down to 0.00100.")
    with open(tmp_path / "comparison_allan_ax.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["device"] for row in rows] == ["A", "A", "B", "B"]
    assert {float(row["adev_m/s^2"]) for row in rows} == {1e-3, 2e-3}


@pytest.fixture(scope="module")
def summaries(results):
    return {
        name: json.loads((results / name / "summary.json").read_text())
        for name in ("board", "still", "partly", "nothing")
    }


def test_a_device_is_answered_in_a_line(summaries):
    said = {sensor: (verdict, words) for sensor, verdict, words in summaries["board"]["answers"]}
    assert said["accelerometer"] == ("consistent", "as good as its noise allows")
    # poses explained, but something stands in the static record: the worse marks the line
    verdict, words = said["gyroscope"]
    assert verdict == "unexplained"
    assert words == (
        "as good as its noise allows with g-sensitivity and bias drift corrected; "
        "at rest something is missing that no known effect explains"
    )
    said = {sensor: (verdict, words) for sensor, verdict, words in summaries["still"]["answers"]}
    assert said["gyroscope"][0] == "partly_explained"
    assert said["gyroscope"][1].startswith("at rest better with bias over temperature corrected")
    assert said["gyroscope"][1].endswith("not tested at poses")
    assert [verdict for _, verdict, _ in summaries["nothing"]["answers"]] == ["not_testable"] * 2
    assert answers({}) == [
        (sensor, "not_testable", "not testable: no recording of this kind")
        for sensor in ("accelerometer", "gyroscope")
    ]


def test_a_filter_gets_the_worst_axis_or_its_limit_raised_for_the_flicker(summaries, results):
    calibration = Calibration.from_json(results / "still" / "calibration.json")
    noise = NoiseModel.from_json(results / "still" / "noise.json")
    rate, n_a, k_a, n_g, k_g = filter_cells(summaries["still"])
    for cell, term, sensor in ((n_a, "N", "a"), (k_a, "K", "a"), (n_g, "N", "g")):
        axes = [noise.axes[f"{sensor}{axis}"] for axis in "xyz"]
        # of all axes alike, as logged
        bounds = [dict(zip("NK", bounding(each), strict=True))[term] for each in axes]
        assert len({*bounds}) == 1 and bounds[0] > getattr(axes[0], term).size
        of = calibration.accelerometer if sensor == "a" else calibration.gyroscope
        gain = np.sqrt(((of.T @ np.diag(of.K) / of.raw_unit.scale) ** 2).sum(axis=1))
        worst, own = int(gain.argmax()), getattr(axes[0], term).size * gain.max()
        assert cell.value == pytest.approx(bounds[0] * gain.max(), rel=1e-12)
        assert float(cell.text) == pytest.approx(cell.value, rel=5e-3)
        axis = "xyz"[worst]
        limit = f"{axis}, not seen: 95 % limit" if term == "K" else f"axis {axis}"
        assert cell.below == f"{limit}, raised from {own:.2e}"
    # large enough beside the white noise that was raised
    assert k_g.value == pytest.approx(3e-6 * gain.max(), rel=1e-12)
    assert k_g.below == f"{axis}, not seen: 95 % limit"
    assert rate.text == "20"
    assert [c.text for c in filter_cells(summaries["nothing"])] == ["—"] * 5


def test_misalignments_are_those_that_were_estimated(summaries, results):
    sensor = json.loads((results / "board" / "calibration.json").read_text())["accelerometer"]
    found = dict(
        zip(PAIRS, summaries["board"]["axes"]["accelerometer_misalignment"]["value"], strict=True)
    )
    assert [pair for pair, value in found.items() if value is not None] == ["xy", "xz", "yz"]
    assert found["yz"] == sensor["T"][1][2]
    largest = summaries["board"]["figures"]["accelerometer_misalignment"]
    assert abs(largest["value"]) == max(abs(v) for v in found.values() if v is not None)
    assert found[largest["axis"]] == largest["value"]
    with open(results / "comparison.csv", newline="", encoding="utf-8") as file:
        row = next(csv.DictReader(file))
    assert float(row["accelerometer_misalignment_yz [rad]"]) == found["yz"]
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
