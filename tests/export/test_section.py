"""The report's section of a device links its exports."""

import re

from export.devices import device
from imuloop.export.export import FORMATS, export_files, write_exports
from imuloop.report.section import write_section
from report import plausible_results


def _section(folder, monkeypatch, files):
    name = "nothing"
    monkeypatch.setattr(plausible_results, "DEVICES", {name: plausible_results.DEVICES[name]})
    label, sessions = plausible_results.write_results(folder)[name]
    write_exports(folder / name / "exports", files)
    write_section(name, label, folder / name, sessions)
    text = (folder / name / "section.html").read_text()
    return re.findall(r'<a href="([^"]*/exports/[^"]*)"', text)


def test_every_file_is_linked(tmp_path, monkeypatch):
    links = _section(tmp_path, monkeypatch, export_files(device()))
    names = {"README.txt", *(each.FILE for each in FORMATS)}
    assert set(links) == {f"nothing/exports/{name}" for name in names}
    assert all((tmp_path / link).is_file() for link in links)


def test_what_was_not_written_is_not_linked(tmp_path, monkeypatch):
    assert _section(tmp_path, monkeypatch, {"README.txt": "none"}) == []
