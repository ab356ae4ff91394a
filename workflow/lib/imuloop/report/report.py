"""The report: one HTML file of all devices, and the comparison as CSV."""

import re
from collections.abc import Mapping
from pathlib import Path

import yaml
from markupsafe import Markup

from imuloop.core.errors import joined, plural
from imuloop.core.files import plain, read_json, replaced
from imuloop.core.samples import SENSORS
from imuloop.export.bound import RANGE
from imuloop.report import comparison
from imuloop.report.family import family_tables, finding
from imuloop.report.figures.comparison import allan_comparison, line_style
from imuloop.report.figures.loop import loop_picture, reach
from imuloop.report.findings import grouped, headline
from imuloop.report.page import RECORDS, WORDS, write_page

# with more devices than this, the part of each is only on a page of its own
TOGETHER = 10


def write_report(folders, provenance, report_path, comparison_path, family_path=None, failures=()):
    """Write the report of all devices, an HTML file, and the table that compares them, a CSV file.

    Parameters
    ----------
    folders : sequence of Path
        Folder of each device with complete results, in the order to show them.
    provenance : dict
        Origin of the report: `imuloop` (its version), `commit`, `command`, `versions`, `config`
        (resolved), …; single values become rows of a table, mappings are printed as YAML.
    report_path : path-like
        HTML file to write.
    comparison_path : path-like
        CSV file to write. Pictures that compare devices go into ``figures`` next to it.
    family_path : path-like, optional
        Path of family.json, if devices name their type.
    failures : list of imuloop.failures.Failure
        Why results are missing, at least one for each device without complete results. The report
        shows them first.
    """
    folders = [Path(folder) for folder in folders]
    devices = [read_json(folder / "summary.json") for folder in folders]
    together, labels = len(devices) <= TOGETHER, {d["device"]: d["label"] for d in devices}
    with replaced(comparison_path) as temporary:
        comparison.write_comparison(temporary, devices, failures)
    drawings = Path(comparison_path).with_name("figures")
    drawings.mkdir(exist_ok=True)
    # a single device is not compared: its own part has its curves
    allan = allan_comparison(devices if len(devices) > 1 else (), together)
    for picture in allan:
        picture.write(drawings)
    types = read_json(family_path)["types"] if family_path else {}
    # all pictures share one axis, so that devices can be compared by eye
    ends = reach([error for d in devices for error in d["loop"]])
    write_page(
        report_path,
        "report.html.j2",
        headline=headline(devices) if devices else "No results",
        failures=failures,
        many=not together,
        groups=grouped(devices),
        # escaped when they were written
        sections=[Markup(_section(folder)) for folder in folders if together],
        devices=devices,
        columns={sensor: comparison.columns(sensor) for sensor in SENSORS},
        cells={
            sensor: comparison.placed([comparison.cells(d, sensor) for d in devices])
            for sensor in SENSORS
        },
        loops=[loop_picture(d["device"], d["loop"], ends) if together else None for d in devices],
        rank=comparison.verdict_rank,
        records=RECORDS,
        headers=WORDS["compared"],
        filters=comparison.placed([comparison.filter_cells(d) for d in devices]),
        bounded=RANGE,
        exports=[sorted(read_json(folder / "exports.json")["sha256"]) for folder in folders],
        allan=allan,
        families=[
            {"name": name, "finding": finding(t, labels), "tables": family_tables(t, labels)}
            for name, t in types.items()
        ],
        styles=[line_style(i) for i in range(len(devices))],
        comparison=Path(comparison_path).name,
        facts={k: v for k, v in provenance.items() if not isinstance(v, Mapping)},
        texts={
            k: yaml.safe_dump(_filled(plain(v)), sort_keys=False, allow_unicode=True)
            for k, v in provenance.items()
            if isinstance(v, Mapping)
        },
    )


def _section(folder):
    """Return the HTML of a device in the report, from section.html in its results `folder`.

    The reasons of rejected sessions are left out, as the report gives them at its beginning.
    """
    text = (folder / "section.html").read_text("utf-8")
    return re.sub("<!-- why -->.*?<!-- /why -->", "", text, flags=re.DOTALL)


def verdict_lines(folders):
    """Return lines of text with the verdicts of each device, a list.

    `folders` are the folders of the devices' results. With more than `TOGETHER` devices, a line
    stands for all devices with equal verdicts, and has their number instead of their names.
    """
    devices = [read_json(Path(folder) / "summary.json") for folder in folders]
    if len(devices) <= TOGETHER:
        groups = [(device["label"], device["answers"]) for device in devices]
    else:
        groups = [(plural(len(names), "device"), said) for said, names in grouped(devices)]
    lines = []
    for name, answers in groups:
        places = {}
        for place, _, words in answers:
            places.setdefault(words, []).append(place)
        said = "; ".join(f"{joined(where)} {words}" for words, where in places.items())
        lines.append(f"{name}: {said}")
    return lines


def _filled(content):
    """Return `content` without keys whose values are empty, at any depth, if it is a mapping.

    A value is empty if it is None or an empty text, list or mapping; zero and False are kept.
    Content that is not a mapping is returned as it is.
    """
    if not isinstance(content, Mapping):
        return content
    kept = {key: _filled(value) for key, value in content.items()}
    return {key: value for key, value in kept.items() if value not in (None, {}, [], "")}
