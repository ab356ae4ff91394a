"""``imuloop calibrate``: calibration, noise and verdicts of one device from its logs."""

import sys
import tempfile
import warnings
from contextlib import contextmanager, suppress
from pathlib import Path

from imuloop.calibrate_logs import KINDS, calibrate
from imuloop.commands.gravity import add_gravity, local_gravity
from imuloop.commands.lines import say
from imuloop.commands.logs import files_of, is_samples, log_of
from imuloop.commands.options import add_arguments, declared_keys
from imuloop.core.errors import ImuloopError
from imuloop.core.files import refuse_overwriting
from imuloop.core.units import STANDARD_GRAVITY

EXAMPLE = """examples:
  imuloop calibrate poses.csv -o results/my_imu
  imuloop calibrate poses.csv static=night.csv -o results/my_imu --acceleration-unit g
  imuloop calibrate acceleration=acc.csv,angular_rate=gyr.csv -o results/my_imu

Writes calibration.json, noise.json, diagnosis.json and exports, and prints the verdicts. It needs
neither Snakemake nor matplotlib."""


def add(commands, **how):
    """Add the command and its arguments."""
    command = commands.add_parser(
        "calibrate", help="calibrate one device from its logs", epilog=EXAMPLE, **how
    )
    add_logs(command)
    command.add_argument("-o", "--output", type=Path, required=True, help="folder of the results")
    command.set_defaults(run=run)


def add_logs(command):
    """Add the logs of a device, and the options that stand for its config."""
    command.add_argument(
        "logs",
        nargs="+",
        type=_log,
        metavar="[KIND=]LOG",
        help=f"KIND is {', '.join(KINDS)}; a log in two files, one per sensor, is "
        "acceleration=FILE,angular_rate=FILE",
    )
    command.add_argument(
        "--kind",
        choices=KINDS,
        default=KINDS[0],
        help=f"kind of logs without; default {KINDS[0]}",
    )
    command.add_argument("--label", help="name in the report; default: the name of the first log")
    add_gravity(command, f"{STANDARD_GRAVITY}; its error becomes an error of the scale factors")
    command.add_argument(
        "--prior",
        type=Path,
        metavar="FILE",
        help="an earlier calibration.json of the device, or a family.json of its type",
    )
    add_arguments(command)


def run(arguments):
    """Write the results of one device, unless nothing was measured."""
    folder = kept_in(arguments.output, "-o", arguments)
    folder.mkdir(parents=True, exist_ok=True)
    try:
        # temporary files are in the folder, where there is room for the results
        with (
            tempfile.TemporaryDirectory(dir=folder, prefix=".imuloop-") as results,
            made(arguments, Path(results)) as result,
        ):
            calibration = result.calibration
            if not calibration.measured:
                refuse_failures(result)
                why = f"nothing was measured: {calibration.accelerometer.not_testable}"
                raise ImuloopError(f"{' and '.join(result.logs.values())}: {why}")
            result.export(Path(results) / "exports")
            say(*result.describe(failures=False).splitlines())
            moved(Path(results), folder)
    finally:
        # the folder is empty if nothing was written
        with suppress(OSError):
            folder.rmdir()
    say(f"wrote {folder / 'calibration.json'}")
    refuse_failures(result)


def moved(results, folder):
    """Move results into a folder, in place of earlier ones."""
    for path in [*results.rglob("*")]:
        if path.is_file():
            target = folder / path.relative_to(results)
            target.parent.mkdir(parents=True, exist_ok=True)
            path.replace(target)


def refuse_failures(result):
    """Raise an error that names the logs that were rejected."""
    if result.failures:
        raise ImuloopError("; ".join(result.failures))


def kept_in(folder, option, arguments, more=()):
    """Return a folder for results, unless they would overwrite something else."""
    logs = [path for _, each in arguments.logs for path in files_of(each)]
    for path in logs:
        if not path.exists():
            raise ImuloopError(f"{path}: there is no such file")
    refuse_overwriting([*more, folder], [*logs, *filter(None, [arguments.prior])])
    for name, mark in (("figures", "section.html"), ("exports", "exports.json")):
        if (folder / name).exists() and not (folder / mark).exists():
            raise ImuloopError(
                f"{option} {folder}: {folder / name} would be emptied, and is not of an earlier "
                "run: give another folder"
            )
    return folder


@contextmanager
def made(arguments, folder):
    """Run all stages into a folder and give the `Result`."""
    logs = {kind: [] for kind in KINDS}
    for kind, log_or_two in arguments.logs:
        for path in files_of(log_or_two):
            if path.suffix == ".parquet" and path.is_file() and is_samples(path):
                raise ImuloopError(f"{path}: samples of a run; give the raw log that they are from")
        logs[kind or arguments.kind].append(log_or_two)
    with warnings.catch_warnings():
        # they are of numbers at their limits; failures and notes are in the result
        warnings.simplefilter("ignore")
        yield calibrate(
            logs.pop("multi_position"),
            **logs,
            **declared_keys(arguments),
            gravity=local_gravity(arguments, STANDARD_GRAVITY),
            prior=arguments.prior,
            label=arguments.label or files_of(arguments.logs[0][1])[0].stem,
            folder=folder,
            progress=sys.stderr.isatty(),
        )


def _log(text):
    """Return kind and log of an argument ``static=night.csv``, kind None if it names none."""
    kind, _, rest = text.partition("=")
    return (kind, log_of(rest)) if kind in KINDS and rest else (None, log_of(text))
