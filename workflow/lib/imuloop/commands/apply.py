"""``imuloop apply``: write the calibrated samples of a log."""

import tempfile
from pathlib import Path

from imuloop import Calibration
from imuloop.commands.lines import say
from imuloop.commands.logs import (
    LOG,
    files_of,
    log_of,
    log_samples,
    refuse_rejected,
    refuse_swapped,
)
from imuloop.commands.options import add_arguments
from imuloop.core.errors import ImuloopError, one_line, plural
from imuloop.core.files import read_json, refuse_overwriting
from imuloop.export.export import reference_parameters

EXAMPLE = """example:
  imuloop apply results/my_imu/calibration.json flight.csv -o calibrated.csv

Reads every format that imuloop reads, raw or as samples.parquet. Writes t (s), ax ay az (m/s^2),
gx gy gz (rad/s), and temperature (degC) if logged. A .csv has one more column,
calibrated_by_imuloop, so that imuloop does not calibrate the file a second time."""


def add(commands, **how):
    """Add the command and its arguments."""
    command = commands.add_parser("apply", help="calibrate a log", epilog=EXAMPLE, **how)
    command.add_argument("calibration", type=Path, help="calibration.json of the device")
    command.add_argument(
        "log", type=log_of, help=f"log of the same device, in the same units: {LOG}"
    )
    command.add_argument(
        "-o", "--output", type=Path, required=True, help="file to write, .csv or .parquet"
    )
    command.add_argument(
        "--nominal",
        action="store_true",
        help="apply the calibration even if nothing of it was measured",
    )
    command.add_argument(
        "--shift",
        action="store_true",
        help="add the time offset that was found with a reference to the time stamps",
    )
    add_arguments(command)
    command.set_defaults(run=run)


def run(arguments):
    """Write the calibrated samples of a log."""
    refuse_swapped(arguments.calibration, arguments.log)
    calibration, output = Calibration.from_json(arguments.calibration), arguments.output
    # refuse before reading the log, which may take long
    if not arguments.nominal:
        calibration.refuse_nominal(arguments.calibration)
    shift = offset_in_time(arguments.calibration)
    if arguments.shift and not shift:
        raise ImuloopError(
            f"{arguments.calibration}: --shift: the diagnosis.json next to it has no time offset"
        )
    logs = files_of(arguments.log)
    beside = logs[0].with_name("quality.json")
    refuse_overwriting([output], [arguments.calibration, *logs, beside])
    output.parent.mkdir(parents=True, exist_ok=True)
    # temporary files are next to the output, where there is room for a file as large
    with tempfile.TemporaryDirectory(dir=output.parent, prefix=".imuloop-") as folder:
        samples, quality = log_samples(
            arguments.log, arguments, Path(folder), calibration=calibration
        )
        refuse_rejected(arguments.log, quality)
        added = shift if arguments.shift else 0.0
        clamped = calibration.apply_file(samples, output, nominal=arguments.nominal, shift=added)
    say(*map(one_line, calibration.limits()))
    if added:
        say(f"stamps were moved by {1e3 * added:.3g} ms, the gyroscope's offset from the reference")
    elif shift:
        say(
            f"the gyroscope's stamps are {1e3 * shift:.3g} ms from the reference's and were "
            "not moved; --shift moves them"
        )
    for (sensor, name), count in clamped.items():
        say(f"{sensor}: {name} clamped to the fitted range in {plural(count, 'sample')}")


def offset_in_time(calibration):
    """Return the offset of the gyroscope's stamps, s, found with a reference, else 0."""
    diagnosis = calibration.with_name("diagnosis.json")
    if not diagnosis.is_file():
        return 0.0
    qualities = map(read_json, calibration.parent.glob("*/quality.json"))
    found = reference_parameters(read_json(diagnosis), [*qualities])
    return found.get(("gyroscope", "time_offset"), {}).get("dt", 0.0)
