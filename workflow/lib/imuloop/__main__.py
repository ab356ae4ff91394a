"""The command line: ``python -m imuloop apply CALIBRATION LOG -o OUT``."""

import argparse
import json
import sys
import tempfile
from pathlib import Path

from imuloop import Calibration
from imuloop.core.errors import ImuloopError
from imuloop.core.files import read_json, replaced
from imuloop.core.samples import read_metadata, read_samples
from imuloop.ingest.ingest import ingest


def read_log(path, calibration, columns, units, rate):
    """Return the samples of a log, read as ingest reads it.

    Parameters
    ----------
    path : Path
        Samples as ingest wrote them, or a raw log.
    calibration : Calibration
        Its raw units are taken where `units` says nothing.
    columns : dict
        Columns of each quantity that was given; the others have their usual names.
    units : dict
        Unit of each quantity that was given.
    rate : float or None
        Hz, where the log has no time column.
    """
    if path.suffix == ".parquet" and "raw_units" in read_metadata(path):
        return read_samples(path)
    sensors = {
        "acceleration": calibration.accelerometer.raw_unit,
        "angular_rate": calibration.gyroscope.raw_unit,
    }
    with tempfile.TemporaryDirectory() as folder:
        samples, quality = Path(folder) / "samples.parquet", Path(folder) / "quality.json"
        ingest(
            device=calibration.device,
            session=path.name,
            kind="static",
            paths=[path],
            samples_path=samples,
            quality_path=quality,
            columns=columns,
            # those in SI are what a log is in that says nothing, and increments do
            units={q: unit.name for q, unit in sensors.items() if unit.scale != 1} | units,
            nominal={
                quantity: {"scale": unit.scale, "offset": unit.offset}
                for quantity, unit in sensors.items()
            },
            rate=rate,
        )
        figures = read_json(quality)
        if figures["status"] == "rejected":
            raise ImuloopError(f"{path}: rejected: {'; '.join(figures['reasons'])}")
        return read_samples(samples)


def columns(text):
    """Return quantity and columns of an argument ``acceleration=fx,fy,fz``."""
    quantity, _, names = text.partition("=")
    known = ("time", "acceleration", "angular_rate", "temperature", "interval")
    if quantity not in known or not names:
        raise argparse.ArgumentTypeError(f"{text} is not QUANTITY=NAME or QUANTITY=NAME,NAME,NAME")
    found = [int(name) if name.isdecimal() else name for name in names.split(",")]
    return quantity, found if quantity in ("acceleration", "angular_rate") else found[0]


def apply(arguments):
    """Write the calibrated samples of a log as CSV or Parquet, by the ending of OUT."""
    calibration = Calibration.from_json(arguments.calibration)
    units = {
        "acceleration": arguments.acceleration_unit,
        "angular_rate": arguments.angular_rate_unit,
        "time": arguments.time_unit,
        "temperature": arguments.temperature_unit,
    }
    samples = read_log(
        arguments.log,
        calibration,
        dict(arguments.columns),
        {quantity: unit for quantity, unit in units.items() if unit},
        arguments.rate,
    )
    calibrated = calibration.apply(samples)
    with replaced(arguments.output) as temporary:
        if arguments.output.suffix == ".csv":
            calibrated.to_csv(temporary, index=False)
        else:
            calibrated.to_parquet(temporary, index=False)


def main(argv=None):
    """Run one command; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m imuloop")
    commands = parser.add_subparsers(required=True)
    command = commands.add_parser("apply", help="calibrate a log")
    command.add_argument("calibration", type=Path, help="calibration.json of the device")
    command.add_argument("log", type=Path, help="CSV, TSV, NetCDF or Parquet")
    command.add_argument("-o", "--output", type=Path, required=True, help=".csv or .parquet")
    command.add_argument(
        "--columns",
        nargs="+",
        type=columns,
        default=[],
        metavar="QUANTITY=NAME",
        help="as in the config: time=stamp acceleration=fx,fy,fz angular_rate=p,q,r temperature=T; "
        "by number from 0 in a log without header",
    )
    command.add_argument("--acceleration-unit", help="default: as in the calibration")
    command.add_argument("--angular-rate-unit", help="default: as in the calibration")
    command.add_argument("--time-unit", help="default: as the log says, else s")
    command.add_argument("--temperature-unit", help="default: as the log says, else degC")
    command.add_argument("--rate", type=float, help="Hz, where the log has no time column")
    command.set_defaults(run=apply)
    arguments = parser.parse_args(argv)
    try:
        arguments.run(arguments)
    except json.JSONDecodeError as error:
        print(f"imuloop: {arguments.calibration}: no JSON: {error}", file=sys.stderr)
        return 1
    except (ImuloopError, OSError) as error:
        print(f"imuloop: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
