"""The report: one HTML file of all devices, and the comparison as CSV."""

import re
from collections.abc import Mapping
from pathlib import Path

import yaml
from markupsafe import Markup

from imuloop.core.errors import joined, plural
from imuloop.core.files import plain, read_json, replaced
from imuloop.export.bound import RANGE
from imuloop.report.card import headline
from imuloop.report.figures import comparison as figures
from imuloop.report.figures.drawing import write_svg
from imuloop.report.figures.loop import loop_picture, reach
from imuloop.report.page import write_page
from imuloop.report.tables import comparison as tables
from imuloop.report.tables import family as of_type
from imuloop.report.verdict import WORDS, grouped

# the most devices whose parts are in the report itself; of more each has its own page
TOGETHER = 10


def write_report(folders, provenance, report_path, comparison_path, family_path=None, failures=()):
    """Write the report and the comparison of all devices.

    Parameters
    ----------
    folders : sequence of Path
        Complete results of each device, in the order to show them.
    provenance : dict
        What made the report: `imuloop` (its version), `commit`, `command`, `versions`, `config`
        (resolved), …; single values become rows of a table, mappings are printed as YAML.
    report_path, comparison_path : path-like
        HTML and CSV file to write; pictures of all devices go into ``figures`` beside the latter.
    family_path : path-like, optional
        family.json, where devices name their type.
    failures : list of imuloop.failures.Failure
        One for each device that has no complete results; they come first.
    """
    folders = [Path(folder) for folder in folders]
    devices = [read_json(folder / "summary.json") for folder in folders]
    together, comparison = len(devices) <= TOGETHER, Path(comparison_path).name
    with replaced(comparison_path) as temporary:
        tables.write_comparison(temporary, devices, failures)
    drawings = Path(comparison_path).with_name("figures")
    drawings.mkdir(exist_ok=True)
    # one device is compared with none: its own part has its curves
    several = devices if len(devices) > 1 else ()
    allan = figures.allan_comparison(several, drawings, together)
    types = read_json(family_path)["types"] if family_path else {}
    families = [
        _family(*each, {d["device"]: d["label"] for d in devices}) for each in types.items()
    ]
    for picture in allan:
        write_svg(drawings, picture.stem, picture)
    # on one axis they can be compared by eye
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
        rows=list(
            zip(devices, *(tables.cells(devices, sensor) for sensor in tables.COLUMNS), strict=True)
        ),
        columns=tables.COLUMNS,
        loops=[loop_picture(d["device"], d["loop"], ends) if together else None for d in devices],
        rank=tables.verdict_rank,
        verdict_parts=tables.verdict_parts,
        filters=[tables.filter_cells(d) for d in devices],
        bounded=RANGE,
        exports=[sorted(read_json(folder / "exports.json")["sha256"]) for folder in folders],
        verdict_words=WORDS,
        allan=allan,
        families=families,
        styles=[figures.line_style(i) for i in range(len(devices))],
        comparison=comparison,
        facts={k: v for k, v in provenance.items() if not isinstance(v, Mapping)},
        texts={
            k: yaml.safe_dump(_given(plain(v)), sort_keys=False, allow_unicode=True)
            for k, v in provenance.items()
            if isinstance(v, Mapping)
        },
    )


def _section(folder):
    """Return a device's part without what the report says first: why sessions were rejected."""
    text = (folder / "section.html").read_text("utf-8")
    return re.sub("<!-- why -->.*?<!-- /why -->", "", text, flags=re.DOTALL)


def _family(name, found, labels):
    """Return what is laid out of a type, by its name and its content of family.json."""
    return {
        "name": name,
        "finding": of_type.finding(found, labels),
        "tables": of_type.family_tables(found, labels),
    }


def verdict_lines(folders):
    """Return a line per device with its verdicts; of many devices one per group that has them."""
    devices = [read_json(Path(folder) / "summary.json") for folder in folders]
    if len(devices) <= TOGETHER:
        given = [(device["label"], device["answers"]) for device in devices]
    else:
        given = [(plural(len(found), "device"), answers) for answers, found in grouped(devices)]
    lines = []
    for name, answers in given:
        of_words = {}
        for sensor, _, words in answers:
            of_words.setdefault(words, []).append(sensor)
        said = "; ".join(f"{joined(sensors)} {words}" for words, sensors in of_words.items())
        lines.append(f"{name}: {said}")
    return lines


def _given(content):
    """Return what a mapping says, without keys that hold nothing."""
    if not isinstance(content, Mapping):
        return content
    known = {key: _given(value) for key, value in content.items()}
    return {key: value for key, value in known.items() if value not in (None, {}, [], "")}
