"""``imuloop apply``: calibrate a log.

For example:
  imuloop apply results/my_imu/calibration.json flight.csv -o calibrated.csv

Reads every format that imuloop reads, raw or as samples.parquet. Writes t (s), ax ay az (m/s^2),
gx gy gz (rad/s), and temperature (degC) if logged. A .csv has one more column,
calibrated_by_imuloop, so that imuloop does not calibrate the file a second time.
"""

import tempfile
from pathlib import Path

from imuloop import Calibration
from imuloop.commands.lines import say
from imuloop.commands.logs import LOG, Log, refuse_swapped, write_samples
from imuloop.commands.options import add_keys
from imuloop.core.errors import ImuloopError, one_line, plural
from imuloop.core.files import read_json, refuse_overwriting
from imuloop.export.export import reference_parameters


def add(command):
    """Add the arguments of ``imuloop apply`` to `command`, its argparse parser."""
    command.add_argument("calibration", type=Path, help="calibration.json of the device")
    command.add_argument(
        "log", type=Log.parse, help=f"log of the same device, in the same units: {LOG}"
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
    add_keys(command)


def run(arguments):
    """Write the calibrated samples of a log; `arguments` are those that `add` declares, parsed."""
    path, log, output = arguments.calibration, arguments.log, arguments.output
    refuse_swapped(path, log)
    calibration = Calibration.from_json(path)
    # refuse before reading the log, which may take long
    if not arguments.nominal:
        calibration.refuse_nominal(path)
    shift = offset_in_time(path)
    if arguments.shift and not shift:
        raise ImuloopError(f"{path}: --shift: the diagnosis.json next to it has no time offset")
    refuse_overwriting([output], [path, *log.paths, log.paths[0].with_name("quality.json")])
    output.parent.mkdir(parents=True, exist_ok=True)
    # temporary files are next to the output, where there is room for a file as large
    with tempfile.TemporaryDirectory(dir=output.parent, prefix=".imuloop-") as folder:
        samples, quality = write_samples(log, arguments.declared, Path(folder), calibration)
        log.refuse_rejected(quality)
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
    """Return the offset of the gyroscope's stamps from a reference's clock, s; 0 if not estimated.

    The offset, positive or negative, is added to the stamps to get the time of the reference.
    `calibration` is the path of calibration.json; the offset is in the diagnosis.json next to it.
    """
    diagnosis = calibration.with_name("diagnosis.json")
    if not diagnosis.is_file():
        return 0.0
    qualities = [*map(read_json, calibration.parent.glob("*/quality.json"))]
    estimates = reference_parameters(read_json(diagnosis), qualities)
    return estimates.get(("gyroscope", "time_offset"), {}).get("dt", 0.0)
