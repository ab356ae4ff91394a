"""``imuloop calibrate``: calibrate one device from its logs.

For example:
  imuloop calibrate poses.csv -o results/my_imu
  imuloop calibrate poses.csv static=night.csv -o results/my_imu --units.acceleration g
  imuloop calibrate acceleration=acc.csv,angular_rate=gyr.csv -o results/my_imu

Writes calibration.json, noise.json, diagnosis.json and exports, and prints the verdicts. It needs
neither Snakemake nor matplotlib.
"""

import sys
import warnings
from pathlib import Path

from imuloop.calibrate_logs import KINDS, calibrate
from imuloop.commands.lines import say
from imuloop.commands.logs import Log
from imuloop.commands.options import add_keys
from imuloop.core.errors import ImuloopError
from imuloop.core.files import refuse_overwriting


def add(command):
    """Add the arguments of ``imuloop calibrate`` to `command`, its argparse parser."""
    add_logs(command)
    command.add_argument("-o", "--output", type=Path, required=True, help="folder of the results")


def add_logs(command):
    """Add arguments for the logs of a device, and the options that stand for its config.

    `command` is the argparse parser of the command.
    """
    command.add_argument(
        "logs",
        nargs="+",
        type=_read_log,
        metavar="[KIND=]LOG",
        help=f"KIND is {', '.join(KINDS)}, by default the first; a log in two files, one per "
        "sensor, is acceleration=FILE,angular_rate=FILE",
    )
    command.add_argument("--label", help="name in the report; default: the name of the first log")
    command.add_argument(
        "--prior",
        type=Path,
        metavar="FILE",
        help="an earlier calibration.json of the device, or a family.json of its type",
    )
    add_keys(command)


def _read_log(text):
    """Return kind of session and Log of an argument such as ``static=night.csv``, a tuple.

    `text` is the argument. Without a kind it is the first of `KINDS`, multi_position.
    """
    kind, _, rest = text.partition("=")
    return (kind, Log.parse(rest)) if kind in KINDS and rest else (KINDS[0], Log.parse(text))


def run(arguments):
    """Write the results of one device; raise an ImuloopError if nothing was measured.

    An ImuloopError is also raised, after the results are written, if a log was rejected.
    `arguments` are those that `add` declares, parsed.
    """
    folder = arguments.output
    refuse_paths(arguments, folder)
    result = calibrated(arguments)
    if not result.calibration.measured:
        refuse_failures(result)
        why = f"nothing was measured: {result.calibration.accelerometer.not_testable}"
        raise ImuloopError(f"{' and '.join(result.logs.values())}: {why}")
    result.save(folder)
    say(*str(result).splitlines(), f"wrote {folder / 'calibration.json'}")
    refuse_failures(result)


def refuse_failures(result):
    """Raise an ImuloopError that names the rejected logs of a Result, `result`, if it has any."""
    if result.failures:
        raise ImuloopError("; ".join(result.failures))


def refuse_paths(arguments, folder, *pages):
    """Raise an ImuloopError if a log is missing, or if the results would overwrite other files.

    `arguments` are those that `add_logs` declares, parsed. `folder` is the folder of the results or
    None, and `pages` are other files that will be written.
    """
    for _, log in arguments.logs:
        log.refuse_no_log()
    if folder and folder.is_file():
        raise ImuloopError(f"{folder}: a file, where a folder is asked for")
    logs = [path for _, log in arguments.logs for path in log.paths]
    refuse_overwriting(filter(None, [folder, *pages]), filter(None, [*logs, arguments.prior]))


def calibrated(arguments):
    """Return the Result of all stages for the logs on the command line, in a temporary folder.

    `arguments` are those that `add_logs` declares, parsed.
    """
    logs = {kind: [] for kind in KINDS}
    for kind, log in arguments.logs:
        if path := log.samples_path():
            raise ImuloopError(f"{path}: samples of a run; give the raw log that they are from")
        logs[kind].append(log.files.get("log", log.files))
    with warnings.catch_warnings():
        # warnings are about numbers at their limits; failures and notes are in the result
        warnings.simplefilter("ignore")
        return calibrate(
            logs.pop("multi_position"),
            **logs,
            **arguments.declared,
            prior=arguments.prior,
            label=arguments.label or arguments.logs[0][1].paths[0].stem,
            progress=sys.stderr.isatty(),
        )
