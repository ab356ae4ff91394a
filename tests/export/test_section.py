"""The report's section of a device links its exports."""

import re

from export.devices import device
from imuloop.export.export import FORMATS, export_files, write_exports
from imuloop.report.section import write_section
from report import plausible_results


def _section(folder, repository, monkeypatch, files):
    name = "nothing"
    monkeypatch.setattr(plausible_results, "DEVICES", {name: plausible_results.DEVICES[name]})
    label, sessions = plausible_results.write_results(folder)[name]
    write_exports(folder / name / "exports", files)
    write_section(
        device=name,
        label=label,
        folder=folder / name,
        sessions=sessions,
        template=repository / "workflow/templates/section.html.j2",
        section_path=folder / "section.html",
        summary_path=folder / "summary.json",
        figures_folder=folder / "figures",
    )
    return re.findall(r'<a href="([^"]*/exports/[^"]*)"', (folder / "section.html").read_text())


def test_every_file_is_linked(tmp_path, repository, monkeypatch):
    links = _section(tmp_path, repository, monkeypatch, export_files(device()))
    names = {"README.txt", *(each.FILE for each in FORMATS)}
    assert set(links) == {f"nothing/exports/{name}" for name in names}
    assert all((tmp_path / link).is_file() for link in links)


def test_what_was_not_written_is_not_linked(tmp_path, repository, monkeypatch):
    assert _section(tmp_path, repository, monkeypatch, {"README.txt": "none"}) == []
