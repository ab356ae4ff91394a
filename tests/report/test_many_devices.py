"""Above ten devices: a comparison that stays small and complete, and a page for each device."""

import json
import shutil

import pytest

from imuloop.report.report import TOGETHER
from report.build import joined_report
from soundness import Page

COUNT = 14
NAME = "unit_05"


@pytest.fixture(scope="module")
def many(results, tmp_path_factory):
    """Return the results of 14 devices: thirteen like `board`, and `partly`."""
    folder = tmp_path_factory.mktemp("many") / "results"
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
    assert (many / "report.html").stat().st_size < 2 * (many / NAME / "section.html").stat().st_size


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
    page = Page((many / NAME / "report.html").read_text(encoding="utf-8"))
    assert page.faults == []
    assert "Unit" in page.text and page.all("section")[0]["id"] == NAME
    names = {e.get("id") for e in page.elements}
    for link in (e["href"] for e in page.all("a")):
        assert link[1:] in names if link.startswith("#") else (many / NAME / link).exists()


def test_devices_are_searched_by_label_and_verdict(tab, many):
    page = tab.open(many / "report.html")
    search = page.get_by_role("searchbox")
    shown = page.locator("table.comparison >> nth=0").locator("tbody tr:visible")
    assert shown.count() == COUNT
    search.fill("Unit 03")
    assert shown.count() == 1
    # in every table alike
    assert page.locator("table.comparison >> nth=2").locator("tbody tr:visible").count() == 1
