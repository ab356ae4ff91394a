"""Time and size of the report of ten devices and of 200, from finished results.

The devices of a results folder are taken in turn under so many names; their parts and the report
are written, twice. Bounds for ten: 100 s, 8 MB; the same bytes again. `make bench-report`.
"""

import argparse
import tempfile
import time
from itertools import cycle, islice, pairwise
from pathlib import Path

from imuloop.chain import Device, report, report_device
from imuloop.core.files import read_json

COUNTS = (10, 200)
WRITTEN = ("figures", "report.html", "section.html", "summary.json")


def named(found, folder, count):
    """Return folders of so many devices, in which those found lie in turn as links."""
    folders = []
    for i, device in enumerate(islice(cycle(found), count)):
        folders.append(folder / f"{device.name}_{i}")
        folders[-1].mkdir(parents=True)
        for path in device.iterdir():
            if path.name not in WRITTEN:
                (folders[-1] / path.name).symlink_to(path.resolve())
    return folders


def write_parts(folders):
    """Write the devices' parts and pages, as the workflow's script does."""
    for folder in folders:
        kinds = {p.parent.name: read_json(p)["kind"] for p in sorted(folder.glob("*/quality.json"))}
        if failures := report_device(Device(folder.name, folder, kinds)):
            raise RuntimeError(str(failures[0]))


def write_all(folders, page):
    """Write the report of all devices."""
    provenance = {"command": "bench/report_size.py"}
    report(folders, provenance, page, page.with_name("comparison.csv"))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path, nargs="+", help="results folders of finished runs")
    arguments = parser.parse_args()
    found = sorted(p.parent for r in arguments.results for p in r.glob("*/diagnosis.json"))
    for count in COUNTS:
        with tempfile.TemporaryDirectory() as folder:
            folders = named(found, Path(folder), count)
            page = Path(folder) / "report.html"
            pages = [measured(folders, page) for _ in range(2)]
        print("the same bytes" if pages[0] == pages[1] else "OTHER BYTES the second time")


def measured(folders, path):
    """Write parts and report, print the processor time of each; return the report."""
    times = [time.process_time()]
    for write in (lambda: write_parts(folders), lambda: write_all(folders, path)):
        write()
        times.append(time.process_time())
    parts, joined = (last - first for first, last in pairwise(times))
    page = path.read_bytes()
    print(
        f"{len(folders)} devices: {parts:.1f} s of processor time for their parts, {joined:.2f} s "
        f"for the report, {joined / len(folders) * 1e3:.1f} ms a device, {len(page) / 1e6:.2f} MB"
    )
    return page


if __name__ == "__main__":
    main()
