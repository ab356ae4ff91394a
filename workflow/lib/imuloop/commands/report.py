"""``imuloop report``: report of one device's logs.

For example:
  imuloop report poses.csv -o report.html
  imuloop report multi_position=poses.csv static=night.csv -o report.html --keep results

Runs all stages on the logs of one device, with default settings. For several devices, for other
settings, or to repeat only stages that have changed, write a config and use the workflow.
"""

import shlex
import sys
from pathlib import Path

from imuloop.commands.calibrate import add_logs, calibrated, refuse_failures, refuse_paths
from imuloop.commands.lines import say


def add(command):
    """Add the arguments of ``imuloop report`` to `command`, its argparse parser."""
    add_logs(command)
    command.add_argument("-o", "--output", type=Path, required=True, help="HTML file to write")
    command.add_argument(
        "--keep",
        type=Path,
        metavar="FOLDER",
        help="folder in which to keep calibration.json, noise.json, exports and all other results; "
        "default: only the report is kept",
    )


def run(arguments):
    """Write the report of one device, an HTML file.

    `arguments` are those that `add` declares, parsed.
    """
    # loads matplotlib
    from imuloop.report.report import verdict_lines

    page, folder = arguments.output, arguments.keep
    refuse_paths(arguments, folder, page)
    result = calibrated(arguments)
    say(*result.notes, f"gravity {result.device.gravity:.6g} m/s²")
    result.report(page, f"imuloop report {shlex.join(sys.argv[2:])}", folder)
    if folder:
        result.save(folder)
    say(*verdict_lines([result.device.folder]), f"wrote {page}")
    refuse_failures(result)
