"""Time and size of the report of ten devices, from finished results: `make bench-report`.

The devices of a results folder are taken in turn under ten names; their sections and the report
are written, twice. Bounds: 6 s, 5 MB, the same bytes the second time.
"""

import argparse
import shutil
import tempfile
import time
from itertools import cycle, islice
from pathlib import Path

from imuloop.core.files import read_json
from imuloop.report.report import write_report
from imuloop.report.section import write_section

TEMPLATES = Path(__file__).parents[1] / "workflow/templates"
DEVICES = 10


def copies(results, folder):
    """Copy the devices of `results` in turn under ten names; return the folders."""
    found = sorted(path.parent for path in results.glob("*/diagnosis.json"))
    folders = []
    for i, device in enumerate(islice(cycle(found), DEVICES)):
        folders.append(folder / f"{device.name}_{i}")
        shutil.copytree(device, folders[-1])
    return folders


def write(folders, report):
    """Write the sections and the report, as the workflow's scripts do."""
    for folder in folders:
        kinds = {p.parent.name: read_json(p)["kind"] for p in sorted(folder.glob("*/quality.json"))}
        write_section(
            device=folder.name,
            label=folder.name,
            folder=folder,
            sessions=kinds,
            template=TEMPLATES / "section.html.j2",
            section_path=folder / "section.html",
            summary_path=folder / "summary.json",
            figures_folder=folder / "figures",
        )
    write_report(
        sections=[folder / "section.html" for folder in folders],
        summaries=[folder / "summary.json" for folder in folders],
        exports=[folder / "exports" for folder in folders],
        template=TEMPLATES / "report.html.j2",
        style=TEMPLATES / "style.css",
        script=TEMPLATES / "sorting.js",
        provenance={"command": "bench/ten_devices.py"},
        report_path=report,
        comparison_path=report.with_name("comparison.csv"),
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path, nargs="+", help="results folders of finished runs")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        merged = Path(folder) / "merged"
        for results in arguments.results:
            for path in results.glob("*/diagnosis.json"):
                shutil.copytree(path.parent, merged / path.parent.name)
        folders, report = copies(merged, Path(folder)), Path(folder) / "report.html"
        pages = []
        for turn in ("first", "second"):
            wall, processor = time.perf_counter(), time.process_time()
            write(folders, report)
            wall, processor = time.perf_counter() - wall, time.process_time() - processor
            pages.append(report.read_bytes())
            print(
                f"{turn} time: {len(folders)} devices in {wall:.1f} s, {processor:.1f} s of "
                f"processor time, {len(pages[-1]) / 1e6:.2f} MB"
            )
        print("the same bytes" if pages[0] == pages[1] else "OTHER BYTES the second time")


if __name__ == "__main__":
    main()
