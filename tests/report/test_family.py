"""The part of the report on devices of one type: its tables."""

import json
import shutil

import numpy as np
import pytest

from family.members import EVERY, Family
from imuloop.family.family import write_family
from imuloop.report.family import family_tables, finding
from imuloop.report.report import write_report
from report.build import PROVENANCE
from soundness import Page

COUNT = 12
ODD = "accelerometer.b"


@pytest.fixture(scope="module")
def family():
    """Return devices, one of which has other biases."""
    family = Family(2, count=COUNT, unlike=[ODD])
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
    write_family(folder / "family.json", {"chip": family.members()})
    folders = [folder / name for name in family.names]
    paths = folder / "report.html", folder / "comparison.csv", folder / "family.json"
    write_report(folders, PROVENANCE, *paths)
    return folder


@pytest.fixture(scope="module")
def content(folder):
    return json.loads((folder / "family.json").read_text())["types"]["chip"]


def test_the_page_is_sound_and_leads_there(folder):
    page = Page((folder / "report.html").read_text(encoding="utf-8"))
    assert page.faults == []
    assert {"#types"} <= {e["href"] for e in page.all("a")}
    captions = [e["text"] for e in page.all("caption")]
    for caption in ("Mean and spread of 12 devices", "Devices that stand out"):
        assert caption in captions
    assert "d0/calibration.json" in [e["href"] for e in page.all("a")]


def test_who_stands_out_is_named_with_the_chance_of_a_false_alarm(content, family):
    (odd,) = family.odd
    labels = {name: f"<b>{name}" for name in family.names}
    said = finding(content, labels)
    assert said.startswith(f"1 device stands out: <b>{odd}. If no device were odd")
    assert f"the {39 * COUNT} tests would still name one in 5.0\u202f%" in said
    tables = {t.caption: t for t in family_tables(content, labels)}
    named = {(f"<b>{odd}", f"accelerometer, bias {axis}") for axis in "xyz"}
    assert {tuple(row[:2]) for row in tables["Devices that stand out"].rows} == named
    assert len(tables["Mean and spread of 12 devices"].rows) == 39
