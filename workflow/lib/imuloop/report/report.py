"""The report: one HTML file of all devices, and the comparison as CSV."""

import base64
import hashlib
from collections.abc import Mapping
from pathlib import Path

import yaml
from markupsafe import Markup

from imuloop.core.files import plain, read_json, replaced
from imuloop.report.answer import best_words
from imuloop.report.comparison import (
    COLUMNS,
    cells,
    filter_cells,
    rate_cell,
    verdict_parts,
    verdict_rank,
    write_comparison,
)
from imuloop.report.comparison_plot import allan_comparison, interval_comparison, line_style
from imuloop.report.section import render
from imuloop.report.verdict import WORDS


def write_report(
    *,
    sections,
    summaries,
    exports,
    template,
    style,
    script,
    provenance,
    report_path,
    comparison_path,
):
    """Write the report and the comparison of all devices.

    Parameters
    ----------
    sections, summaries : sequence of path-like
        Section and summary of each device, in the order to show them.
    exports : sequence of path-like
        Folder of other tools' files of each device.
    template, style, script : path-like
        ``report.html.j2``, ``style.css`` and ``sorting.js``.
    provenance : dict
        What made the report: `commit`, `command`, `versions`, `config` (resolved), …; single
        values become rows of a table, mappings are printed as YAML.
    report_path, comparison_path : path-like
        HTML and CSV file to write.
    """
    devices = [read_json(path) for path in summaries]
    rows = zip(devices, *(cells(devices, sensor) for sensor in COLUMNS), strict=True)
    code = Path(script).read_text(encoding="utf-8")
    html = render(
        template,
        style=Markup(Path(style).read_text(encoding="utf-8")),
        script=Markup(code),
        # the page allows this script and no other
        script_hash=f"sha256-{base64.b64encode(hashlib.sha256(code.encode()).digest()).decode()}",
        # written by this stage from escaped text
        sections=[Markup(Path(path).read_text(encoding="utf-8")) for path in sections],
        devices=devices,
        rows=list(rows),
        columns=COLUMNS,
        best=best_words(devices, COLUMNS),
        rank=verdict_rank,
        verdict_parts=verdict_parts,
        rates=[rate_cell(d) for d in devices],
        filters=[filter_cells(d) for d in devices],
        exports=[sorted(p.name for p in Path(folder).glob("[!.]*")) for folder in exports],
        verdict_words=WORDS,
        allan=allan_comparison(devices),
        intervals=interval_comparison(devices, Path(comparison_path).name),
        styles=[line_style(i) for i in range(len(devices))],
        comparison=Path(comparison_path).name,
        facts={k: v for k, v in provenance.items() if not isinstance(v, Mapping)},
        texts={
            k: yaml.safe_dump(plain(v), sort_keys=False, allow_unicode=True)
            for k, v in provenance.items()
            if isinstance(v, Mapping)
        },
    )
    with replaced(comparison_path) as temporary:
        write_comparison(temporary, devices)
    with replaced(report_path) as temporary:
        temporary.write_text(html, encoding="utf-8", newline="\n")
