"""``imuloop report``: the report of one device from its logs, without a config or a workflow."""

import shlex
import sys
import tempfile
from pathlib import Path

from imuloop.commands.calibrate import add_logs, kept_in, made, refuse_failures
from imuloop.commands.gravity import gravity_line
from imuloop.commands.lines import say

EXAMPLE = """examples:
  imuloop report poses.csv -o report.html
  imuloop report multi_position=poses.csv static=night.csv -o report.html --keep results

Runs all stages on the logs of one device, with default settings. For several devices, for other
settings, or to repeat only what has changed, write a config and use the workflow."""


def add(commands, **how):
    """Add the command and its arguments."""
    command = commands.add_parser(
        "report", help="report of one device's logs", epilog=EXAMPLE, **how
    )
    add_logs(command)
    command.add_argument("-o", "--output", type=Path, required=True, help="HTML file to write")
    command.add_argument(
        "--keep",
        type=Path,
        metavar="FOLDER",
        help="folder in which to keep calibration.json, noise.json, exports and all other results; "
        "default: only the report is kept",
    )
    command.set_defaults(run=run)


def run(arguments):
    """Write the report of one device."""
    # loads matplotlib
    from imuloop.report.report import verdict_lines

    page = arguments.output
    with tempfile.TemporaryDirectory(prefix="imuloop-") as folder:
        results = kept_in(arguments.keep or Path(folder), "--keep", arguments, [page])
        with made(arguments, results) as result:
            say(*result.notes, gravity_line(result.device.gravity))
            command = f"imuloop report {shlex.join(sys.argv[2:])}"
            result.report(page, command, linked=bool(arguments.keep))
            say(*verdict_lines([result.device.folder]))
    say(f"wrote {page}")
    refuse_failures(result)
