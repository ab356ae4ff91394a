"""The part of the report on devices of one type: tables and control charts."""

import json
import shutil

import numpy as np
import pandas as pd
import pytest

from family.members import EVERY, Family
from imuloop.family.family import write_family
from imuloop.report.figures.family import control_charts, production
from imuloop.report.report import write_report
from imuloop.report.tables.family import family_tables, finding
from report.build import PROVENANCE
from soundness import Page

COUNT = 12
ODD = "accelerometer.b"


@pytest.fixture(scope="module")
def family():
    """Return devices in no order, one of which has other biases, with a drift of another one."""
    family = Family(2, count=COUNT, unlike=[ODD])
    drifting = EVERY.index("gyroscope.b2")
    family.y[:, drifting] += family.spread[drifting] * 3 * np.arange(COUNT)
    # far enough for twelve devices
    at = [k for k, name in enumerate(EVERY) if name.startswith(ODD)]
    odd = int(next(iter(family.odd))[1:])
    family.y[odd, at] = family.mean[at] + 40 * np.hypot(family.spread[at], family.std[odd, at])
    return family


@pytest.fixture(scope="module")
def folder(family, results, tmp_path_factory):
    """Return a report of all of them."""
    folder = tmp_path_factory.mktemp("family") / "results"
    for name in family.names:
        (folder / name).mkdir(parents=True)
        shutil.copy(results / "board/exports.json", folder / name)
        text = (results / "board/summary.json").read_text().replace("board", name)
        summary = json.loads(text) | {"label": f"<b>{name}"}
        (folder / name / "summary.json").write_text(json.dumps(summary))
    members = family.members(serial=100.0 - np.arange(COUNT), date=[None] * COUNT)
    write_family(folder / "family.json", {"chip": members})
    given = [folder / name for name in family.names]
    paths = folder / "report.html", folder / "comparison.csv", folder / "family.json"
    write_report(given, PROVENANCE, *paths)
    return folder


@pytest.fixture(scope="module")
def found(folder):
    return json.loads((folder / "family.json").read_text())["types"]["chip"]


@pytest.fixture(scope="module")
def labels(family):
    return {name: f"<b>{name}" for name in family.names}


def test_the_page_is_sound_and_leads_there(folder):
    page = Page((folder / "report.html").read_text(encoding="utf-8"))
    assert page.faults == []
    assert {"#types"} <= {e["href"] for e in page.all("a")}
    captions = [e["text"] for e in page.all("caption")]
    for caption in ("Mean and spread of 12 devices", "Devices that stand out"):
        assert caption in captions
    assert "d0/calibration.json" in [e["href"] for e in page.all("a")]


def test_a_report_without_types_has_no_part_of_them(results):
    text = (results / "report.html").read_text(encoding="utf-8")
    assert 'id="types"' not in text and "#types" not in text


def test_who_stands_out_is_named_with_the_chance_of_a_false_alarm(found, family, labels):
    (odd,) = family.odd
    assert finding(found, labels) == (
        f"1 device stands out: <b>{odd}. By chance alone 5\u202f% of such families have any device "
        f"named, or any trend, in all of {39 * (COUNT + 1)} tests."
    )
    tables = {t.caption: t for t in family_tables(found, labels)}
    rows = tables["Devices that stand out"].rows
    assert {row[0] for row in rows} == {f"<b>{odd}"}
    assert {row[1] for row in rows} == {f"accelerometer, bias {axis}" for axis in "xyz"}
    assert [row[0] for row in tables["Trends over serial number or date"].rows] == [
        "Gyroscope, bias z"
    ]
    spread = {row[0]: row for row in tables["Mean and spread of 12 devices"].rows}
    assert len(spread) == 39 and spread["Accelerometer, bias x"][-1] == "1"


def test_a_control_chart_has_the_order_of_the_serial_numbers(found, labels, folder, tmp_path):
    assert next(iter(production(found, labels))) == f"d{COUNT - 1}"
    charts = control_charts("chip", found, labels, tmp_path)
    # three kinds of parameters and three of noise of each sensor
    assert len(charts) == 12 and {len(c.rows) for c in charts} == {3, 6}
    table = pd.read_csv(tmp_path / "type_chip_accelerometer_bias.csv")
    assert table["place"].tolist() == sorted(table["place"][:COUNT]) * 3
    assert "1 of" not in charts[0].caption and "3 of 36 values outside" in charts[0].caption
    for chart in charts:
        assert (folder / f"figures/{chart.stem}.svg").exists()
