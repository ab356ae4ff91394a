"""``imuloop report``: the report of one device from its logs, without a config or a workflow."""

import argparse
import logging
import shlex
import sys
import tempfile
import warnings
from pathlib import Path

from imuloop.commands.lines import say
from imuloop.commands.raw_log import add_arguments, declared, is_samples, local_gravity
from imuloop.core.errors import ImuloopError
from imuloop.core.files import refuse_overwriting
from imuloop.core.gravity import normal_gravity
from imuloop.core.units import STANDARD_GRAVITY
from imuloop.job_log import Printable
from imuloop.result import KINDS, calibrate

EXAMPLE = """examples:
  imuloop report poses.csv -o report.html
  imuloop report multi_position=poses.csv static=night.csv -o report.html --keep results

The whole chain on the logs of one device, with default settings. For several devices, other
settings, and to repeat only what has changed, write a config and use the workflow."""


def add(commands, **how):
    """Add the command and its arguments."""
    command = commands.add_parser(
        "report", help="report of one device's logs", epilog=EXAMPLE, **how
    )
    command.add_argument(
        "logs", nargs="+", type=log, metavar="[KIND=]LOG", help=f"KIND is {', '.join(KINDS)}"
    )
    command.add_argument(
        "--kind", choices=KINDS, default=KINDS[0], help=f"of logs without; default {KINDS[0]}"
    )
    command.add_argument("-o", "--output", type=Path, required=True, help="HTML file to write")
    command.add_argument(
        "--keep",
        type=Path,
        metavar="FOLDER",
        help="keep calibration.json, noise.json, exports and all else there; without, the report "
        "alone is kept",
    )
    command.add_argument("--label", help="name in the report; default: that of the first log")
    command.add_argument(
        "--gravity",
        type=gravity,
        default=STANDARD_GRAVITY,
        metavar="M/S^2 or LATITUDE,HEIGHT",
        help="local gravity, or degrees and m; default 9.80665: its error is one of scale",
    )
    add_arguments(command)
    command.set_defaults(run=run)


def log(text):
    """Return kind and path of an argument ``static=night.csv``, kind None without."""
    kind, _, path = text.partition("=")
    return (kind, Path(path)) if kind in KINDS and path else (None, Path(text))


def gravity(text):
    """Return gravity of an argument, m/s^2 as it is, or of latitude and height."""
    if "," not in text:
        return local_gravity(text)
    values = [float(value) for value in text.split(",")]
    if len(values) > 2 or not abs(values[0]) <= 90 or not abs(values[1]) <= 1e5:
        raise argparse.ArgumentTypeError(f"{text} is not M/S^2 or LATITUDE,HEIGHT")
    return normal_gravity(*values)


def run(arguments):
    """Write the report of one device."""
    keep, logs = arguments.keep, [path for _, path in arguments.logs]
    for path in logs:
        if not path.exists():
            raise ImuloopError(f"{path}: there is no such file")
    # where tracebacks go
    log = arguments.output.with_name(f"{arguments.output.name}.log")
    refuse_overwriting([arguments.output, log, *([keep] if keep else [])], logs)
    for name, mark in (("figures", "section.html"), ("exports", "exports.json")):
        if keep and (keep / name).exists() and not (keep / mark).exists():
            raise ImuloopError(
                f"--keep {keep}: {keep / name} would be emptied, and is not of an earlier "
                "report: give another folder"
            )
    with tempfile.TemporaryDirectory(prefix="imuloop-") as folder:
        make(arguments, keep or Path(folder), log)


def make(arguments, folder, log):
    """Run all stages and write the report; results go to a folder as ``results/<device>``."""
    logs = {kind: [] for kind in KINDS}
    for kind, path in arguments.logs:
        if path.suffix == ".parquet" and path.is_file() and is_samples(path):
            raise ImuloopError(f"{path}: samples of a run; give the raw log they were made of")
        logs[kind or arguments.kind].append(path)
    what, nominal = declared(arguments)
    # made only where there is a traceback to keep
    handler = logging.FileHandler(log, mode="w", delay=True)
    handler.setLevel(logging.ERROR)
    handler.setFormatter(Printable())
    logging.getLogger().addHandler(handler)
    with warnings.catch_warnings():
        # of numbers at their limits, and what is said below
        warnings.simplefilter("ignore")
        result = calibrate(
            logs.pop("multi_position"),
            **logs,
            **what,
            nominal=nominal,
            gravity=arguments.gravity,
            label=arguments.label or arguments.logs[0][1].stem,
            folder=folder,
            log=log,
            progress=False,
        )
        for line in result.failures:
            say(line)
        result.report(arguments.output, f"imuloop report {shlex.join(sys.argv[2:])}")
    logging.getLogger().removeHandler(handler)
    say(f"wrote {arguments.output}")
