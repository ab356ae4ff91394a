"""The report: one HTML file of all devices, and the comparison as CSV."""

from collections.abc import Mapping
from pathlib import Path

import yaml
from markupsafe import Markup

from imuloop.core.files import plain, read_json, replaced
from imuloop.noise.filters import RANGE
from imuloop.report.answer import best_words, grouped
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
from imuloop.report.page import write_page
from imuloop.report.spread_plot import allan_spread, parameter_spread
from imuloop.report.verdict import WORDS

# the most devices whose parts are in the report itself; of more each has a page of its own
TOGETHER = 10


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
        Section and summary of each device, in the order to show them; devices in which a stage
        failed come first.
    exports : sequence of path-like
        ``exports.json`` of each device, the list of other tools' files.
    template, style, script : path-like
        ``report.html.j2``, ``style.css`` and ``sorting.js``.
    provenance : dict
        What made the report: `commit`, `command`, `versions`, `config` (resolved), …; single
        values become rows of a table, mappings are printed as YAML.
    report_path, comparison_path : path-like
        HTML and CSV file to write.
    """
    # what failed comes first, the rest in the order given
    given = sorted(
        zip(map(read_json, summaries), sections, exports, strict=True),
        key=lambda each: each[0]["status"] != "failed",
    )
    devices, sections, exports = zip(*given, strict=True)
    rows = zip(devices, *(cells(devices, sensor) for sensor in COLUMNS), strict=True)
    many, comparison = len(devices) > TOGETHER, Path(comparison_path).name
    with replaced(comparison_path) as temporary:
        write_comparison(temporary, devices)
    write_page(
        report_path,
        template,
        style,
        script,
        many=many,
        groups=grouped(devices),
        # written by this stage from escaped text
        sections=[Markup(Path(p).read_text(encoding="utf-8")) for p in sections if not many],
        devices=devices,
        rows=list(rows),
        columns=COLUMNS,
        best=best_words(devices, COLUMNS),
        rank=verdict_rank,
        verdict_parts=verdict_parts,
        rates=[rate_cell(d) for d in devices],
        filters=[filter_cells(d) for d in devices],
        bounded=RANGE,
        exports=[sorted(read_json(path)["sha256"]) for path in exports],
        verdict_words=WORDS,
        allan=allan_spread(devices) if many else allan_comparison(devices),
        intervals=(parameter_spread if many else interval_comparison)(devices, comparison),
        styles=[line_style(i) for i in range(len(devices))],
        comparison=comparison,
        facts={k: v for k, v in provenance.items() if not isinstance(v, Mapping)},
        texts={
            k: yaml.safe_dump(plain(v), sort_keys=False, allow_unicode=True)
            for k, v in provenance.items()
            if isinstance(v, Mapping)
        },
    )
