"""Above ten devices: a comparison that stays small and complete, and a page for each device."""

import json
import re
import shutil

import numpy as np
import pytest

from imuloop.report.figures.comparison import FAR, far_out, standing_out
from imuloop.report.report import TOGETHER
from report.build import joined_report
from soundness import Page

COUNT = 14
ODD = "unit_05"


def _scaled(summary, factor):
    for channel in summary["allan"].values():
        channel["adev"] = [factor * v for v in channel["adev"]]
    for key in ("accelerometer_bias", "gyroscope_bias"):
        values = summary["axes"][key]["value"]
        summary["axes"][key]["value"] = [factor * v for v in values]
    return summary


@pytest.fixture(scope="module")
def many(results, tmp_path_factory):
    """Return the results of 14 devices: thirteen like `board`, one of them odd, and `partly`."""
    folder = tmp_path_factory.mktemp("many") / "results"
    rng = np.random.default_rng(4)
    for k in range(COUNT):
        name, source = f"unit_{k:02}", "partly" if k == 9 else "board"
        (folder / name).mkdir(parents=True)
        shutil.copytree(results / source / "exports", folder / name / "exports")
        shutil.copy(results / source / "exports.json", folder / name)
        shutil.copytree(results / source / "figures", folder / name / "figures")
        for file in ("section.html", "report.html"):
            text = (results / source / file).read_text(encoding="utf-8")
            (folder / name / file).write_text(text.replace(source, name), encoding="utf-8")
        summary = json.loads((results / source / "summary.json").read_text().replace(source, name))
        if source == "board":
            summary["label"] = f"Unit {k:02}"
            _scaled(summary, (8.0 if name == ODD else 1.0) * rng.lognormal(0, 0.05))
        (folder / name / "summary.json").write_text(json.dumps(summary))
    joined_report(folder, [f"unit_{k:02}" for k in range(COUNT)], folder)
    return folder


@pytest.fixture(scope="module")
def page(many):
    page = Page((many / "report.html").read_text(encoding="utf-8"))
    assert page.faults == []
    return page


def test_the_parts_of_the_devices_are_left_to_their_pages(many, page):
    assert COUNT > TOGETHER
    assert not [e for e in page.elements if e.get("class") == "device"]
    # less than the parts of two devices
    assert (many / "report.html").stat().st_size < 2 * (many / ODD / "section.html").stat().st_size


def test_every_device_is_in_every_table_and_its_page_is_there(many, page):
    heads = [e["text"] for e in page.all("th") if e.get("scope") == "row"]
    for k in range(COUNT):
        label = json.loads((many / f"unit_{k:02}/summary.json").read_text())["label"]
        # three comparisons; the logs have a row each
        assert heads.count(label) >= 3
    inside = {e["href"][1:] for e in page.all("a") if e["href"].startswith("#")}
    assert inside <= {e.get("id") for e in page.elements}
    outside = {e["href"] for e in page.all("a") if not e["href"].startswith("#")}
    assert {f"unit_{k:02}/report.html" for k in range(COUNT)} <= outside
    # of these no more than a name is looked at here
    written = {name for name in outside if not name.endswith("calibration.json")}
    assert all((many / name).is_file() for name in written)


def test_the_page_of_a_device_is_whole_and_its_links_lead_somewhere(many):
    page = Page((many / ODD / "report.html").read_text(encoding="utf-8"))
    assert page.faults == []
    assert "Unit" in page.text and page.all("section")[0]["id"] == ODD
    names = {e.get("id") for e in page.elements}
    for link in (e["href"] for e in page.all("a")):
        assert link[1:] in names if link.startswith("#") else (many / ODD / link).exists()


def test_who_stands_out_is_named_and_nobody_else(page):
    captions = [e["text"] for e in page.all("figcaption")]
    assert len(captions) == 12
    level = [c for c in captions if "nine of ten lie" in c]
    assert len(level) == 6
    for caption in level:
        # the noise of `partly` is twice that of the others
        assert re.search(r"2 far from the others: Unit 05, .*; _Board B ", caption)
    factors = [float(re.search(r"Unit 05, ([\d.]+)", c)[1]) for c in level]
    assert factors == pytest.approx([8.0] * 6, rel=0.15)
    bias = next(c for c in captions if c.startswith("Accelerometer bias"))
    assert "1 far from the others: Unit 05" in bias
    scale = next(c for c in captions if c.startswith("Accelerometer scale"))
    assert "none far from the others" in scale


def test_what_is_said_of_the_devices_is_said_once_the_worst_first(page):
    said = [e["text"] for e in page.all("li") if re.match(r"\d+ devices? –", e["text"])]
    assert [text.split(" –")[0] for text in said] == ["13 devices", "1 device"]
    assert "something is missing" in said[0] and "Board B" in said[1]


def test_normal_scatter_stands_out_never_and_a_stray_always():
    values = np.random.default_rng(1).normal(3.0, 2.0, (200, 6))
    assert far_out(values).max() < FAR
    values[17, 2], values[40, 1] = 30.0, np.nan
    distances = far_out(values)
    assert distances[17, 2] > 10 and distances[40, 1] == 0
    assert standing_out(distances.max(axis=1)) == [17]


def test_devices_are_searched_by_label_and_verdict(tab, many):
    page = tab.open(many / "report.html")
    search = page.get_by_role("searchbox")
    shown = page.locator("table.comparison >> nth=0").locator("tbody tr:visible")
    assert shown.count() == COUNT
    search.fill("Unit 03")
    assert shown.count() == 1
    # in every table alike
    assert page.locator("table.comparison >> nth=2").locator("tbody tr:visible").count() == 1
    search.fill("explained")
    assert 0 < shown.count() < COUNT
    search.fill("nobody")
    assert not shown.count()
    search.fill("")
    assert shown.count() == COUNT
