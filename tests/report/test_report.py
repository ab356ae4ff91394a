"""The report of a results folder as the stages leave it."""

import base64
import csv
import hashlib
import json
import re
import shutil
from collections import Counter
from html import unescape

import numpy as np
import pytest

from imuloop.chain import Device
from imuloop.report.section import write_section
from report.build import DEVICES, HOSTILE, joined_report
from soundness import Page


@pytest.fixture(scope="module")
def html(results):
    return (results / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(html):
    page = Page(html)
    assert page.faults == []
    return page


def _written(folder):
    kept = [p for p in folder.rglob("*") if p.suffix in (".html", ".csv", ".json", ".svg")]
    return {str(p.relative_to(folder)): p.read_bytes() for p in kept}


def test_a_second_run_gives_the_same_bytes(results, tmp_path):
    folder, (label, kinds) = shutil.copytree(results, tmp_path / "results"), DEVICES["partly"]
    shutil.rmtree(folder / "partly/figures")
    for path in folder.glob("partly/*.html"):
        path.unlink()
    write_section(Device("partly", folder / "partly", kinds, label))
    assert _written(folder) == _written(results)


def test_ten_devices_stay_below_8_mb(results):
    # `board`, three sessions and all views of the noise, is the largest kind
    assert 10 * (results / "board" / "section.html").stat().st_size < 7.5e6


def test_nothing_is_requested_and_no_other_script_is_run(html, page):
    # its own script, which the page allows by its hash
    (script,) = page.all("script")
    digest = base64.b64encode(hashlib.sha256(script["text"].encode()).digest()).decode()
    (policy,) = (e for e in page.all("meta") if e.get("http-equiv"))
    assert f"script-src 'sha256-{digest}';" in policy["content"]
    assert policy["content"].startswith("default-src 'none';")
    assert not page.all("link") and not page.all("img")
    assert not page.all("iframe") and not page.all("object")
    assert "@import" not in html and "url(http" not in html and "@font-face" not in html
    for element in page.elements:
        assert not [name for name in element if name.startswith("on")]
        for name in ("src", "href", "xlink:href"):
            assert not re.match(r"\w+:|//", element.get(name) or "")


def test_other_peoples_text_stays_text(html, page):
    assert "<script>alert" not in html and "<i>" not in html and "<b>" not in html
    assert HOSTILE in page.text
    assert "_Board B $\\frac{1}{2}$" in page.text


def test_ids_are_unique_and_every_link_inside_leads_somewhere(page):
    ids = Counter(e["id"] for e in page.elements if e.get("id"))
    assert not [name for name, count in ids.items() if count > 1]
    inside = {e["href"][1:] for e in page.elements if (e.get("href") or "").startswith("#")}
    assert inside <= set(ids)


def test_rejected_sessions_come_first_then_the_comparison(page, results):
    alert = next(e["text"] for e in page.elements if e.get("class") == "alert")
    reason, *_ = json.loads((results / "nothing/turns/quality.json").read_text())["reasons"]
    assert f"turns (multi_position): {reason}" in " ".join(alert.split())
    assert page.text.index(alert) < page.text.index("Accelerometers, value ± 1 σ")


def test_a_device_of_which_nothing_was_testable_is_reported_alone(results, tmp_path):
    joined_report(results, ["nothing"], tmp_path)
    html = (tmp_path / "report.html").read_text(encoding="utf-8")
    [said] = re.findall(r'<li class="device">(.*?)</li>', html, re.DOTALL)
    assert "<strong>Not testable.</strong>" in said and "<svg" not in said
    # without errors there is no line to explain
    assert "Dashed: an estimate of the error from noise" not in html


# what the first screen calls an error: sensor, record, residual, and how many of its unit an SI is
SAID = {
    "Vertical after a turn": ("gyroscope", "poses", "rotation", 180 / np.pi),
    "Accelerometer's bias at rest": ("accelerometer", "static_record", "bias", 1e3 / 9.80665),
}


@pytest.mark.parametrize("device", ["board", "still", "partly"])
def test_the_figures_of_the_first_screen_are_those_of_the_files(html, page, results, device):
    card = re.search(rf'<h3><a href="#{device}">(?:(?!</figcaption>).)*', html, re.DOTALL)[0]
    assert f'href="{device}/figures/loop.csv"' in card
    words = unescape(re.sub("<[^>]*>", "", card)).replace("\u202f", " ")
    [what] = (w for w in SAID if f"{w}: " in words)
    sizes = words.split(f"{what}: ")[1]
    sensor, record, name, factor = SAID[what]
    content = json.loads((results / device / "diagnosis.json").read_text())
    residual = content["sensors"][sensor][record]["residuals"][name]
    printed = {
        "before": re.match(r"([\d.]+)", sizes),
        "after": re.match(r"\S+ ?m?g? before and ([\d.]+\d)", sizes),
        "floor": re.search(r"the noise alone would give about ([\d.]+\d)", sizes),
    }
    for key, size in printed.items():
        if size:
            assert float(size[1]) == pytest.approx(factor * residual[key], rel=0.05)
    assert printed["before"] and bool(printed["after"]) == (device != "partly")
    # and the table, which is of poses
    row = {r["device"]: r for r in csv.DictReader((results / "comparison.csv").open())}[device]
    shown = [float(v) for k, v in row.items() if v and k.startswith(f"{sensor}_residual [")]
    assert shown == [pytest.approx(residual["after"])] * (record == "poses")


def test_every_figure_has_alt_text_with_numbers_a_caption_and_its_numbers(page, results):
    figures = page.all("figure")
    pictures = [e for e in page.all("svg") if e.get("role") == "img"]
    captions = [e["text"] for e in page.all("figcaption")]
    assert len(figures) == len(pictures) == len(captions) > 20
    assert all(re.search(r"\d", p["aria-label"]) for p in pictures)
    assert all(re.search(r"\d", c) and c.strip().endswith((".", ".csv", "SVG")) for c in captions)
    linked = {e["href"] for e in page.all("a") if e["href"].endswith(".csv")}
    assert all((results / name).is_file() for name in linked)


def test_simulated_devices_are_called_so_everywhere(page):
    called = [e for e in page.elements if e["text"].strip() == f"{HOSTILE} (simulated)"]
    # contents, two tables, sentences, key, title, logs
    assert len({id(e) for e in called if e["tag"] in ("a", "h2", "th")}) >= 7
    assert "logs of this device were made by a computer" in page.text


def test_comparison_csv_is_si_with_units_in_its_header(results):
    with open(results / "comparison.csv", newline="", encoding="utf-8") as file:
        rows = {row["device"]: row for row in csv.DictReader(file)}
    assert list(rows) == ["board", "still", "partly", "nothing"]
    assert rows["still"]["label"] == f"{HOSTILE} (simulated)"
    assert rows["still"]["simulated"] == "true"
    noise = json.loads((results / "board" / "noise.json").read_text())["axes"]
    worst = max(noise[axis]["N"]["value"] for axis in ("ax", "ay", "az"))
    assert float(rows["board"]["accelerometer_N [m/s^2/sqrt(Hz)]"]) == pytest.approx(worst)
    assert rows["nothing"]["accelerometer_N [m/s^2/sqrt(Hz)]"] == ""
    calibration = json.loads((results / "board" / "calibration.json").read_text())
    sensor = calibration["accelerometer"]
    bias = (sensor["b"][2] - sensor["raw_offset"]) * sensor["raw_scale"]
    assert float(rows["board"]["accelerometer_bias_z [m/s^2]"]) == pytest.approx(bias)
    sigma = sensor["covariance"]["matrix"][-1][-1] ** 0.5 * sensor["raw_scale"]
    assert float(rows["board"]["accelerometer_bias_z_std [m/s^2]"]) == pytest.approx(sigma)


def test_a_calibration_of_which_nothing_was_measured_is_none_to_use(page):
    """Protects who reads the report from the link to a calibration that is the data sheet's."""
    links = {e["href"].partition("/")[0] for e in page.all("a") if "calibration.json" in e["href"]}
    assert links == {"board", "still", "partly"}
    (cell,) = [e["text"] for e in page.all("td") if "not measured" in e["text"]]
    assert cell.startswith("not measured")


def test_an_unexplained_sensor_is_named_beside_its_parameters(results):
    """Protects parameters ± σ from being read without the verdict that they are not all."""
    for device, count in (("board", 1), ("still", 0)):
        text = (results / device / "section.html").read_text("utf-8")
        part = text[text.index(f"{device}.calibration") : text.index(f"{device}.noise")]
        assert part.count("unexplained") == count
        assert part.count("<strong>Gyroscope: unexplained</strong>: its errors") == count


def test_numbers_to_copy_can_be_copied(page, results):
    sensor = json.loads((results / "board" / "calibration.json").read_text())["accelerometer"]
    row = next(e["text"] for e in page.all("tr") if e["text"].startswith("T, row x"))
    assert "−" not in row
    assert str(float(f"{sensor['T'][0][1]:.8g}")) in row
