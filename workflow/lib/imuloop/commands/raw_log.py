"""A raw log on the command line: how it is declared, and its samples."""

import argparse
import re
from contextlib import suppress
from pathlib import Path

from imuloop.core.errors import ImuloopError
from imuloop.core.files import read_json
from imuloop.core.samples import read_metadata
from imuloop.core.units import ACCELERATION, ANGULAR_RATE, MOST_COUNT_OFFSET, SCALE_OF_COUNTS
from imuloop.ingest.formats import PAIR, guess_format, no_log
from imuloop.ingest.ingest import Declared, ingest
from imuloop.ingest.spellings import UNITS
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from imuloop.sensors import PARTS, device_figures

QUANTITIES = ("time", "acceleration", "angular_rate", "temperature", "interval")


# how a log is given
LOG = "LOG or acceleration=FILE,angular_rate=FILE"


def log_of(text):
    """Return the path of a log, or of a file of each sensor, ``acceleration=a,angular_rate=b``."""
    two = re.fullmatch(r"acceleration=(.+),angular_rate=(.+)", text)
    return dict(zip(PAIR, map(Path, two.groups()), strict=True)) if two else Path(text)


def refuse_swapped(calibration, log):
    """Raise an ImuloopError where a log stands in the place of the calibration."""
    if any(path.suffix == ".json" for path in files_of(log)) and calibration.suffix != ".json":
        raise ImuloopError(f"{calibration}: no calibration.json: it comes first, then the log")


def files_of(log):
    """Return the paths of a log, one or two."""
    return [*log.values()] if isinstance(log, dict) else [log]


def name_of(log):
    """Return the names of a log's files."""
    return " and ".join(path.name for path in files_of(log))


def paths_of(log):
    """Return the paths of a log's files as text."""
    return " and ".join(map(str, files_of(log)))


def columns(text):
    """Return quantity and columns of an argument ``acceleration=fx,fy,fz``, as in the config."""
    quantity, _, names = text.partition("=")
    found = [int(name) if name.isdecimal() else name for name in names.split(",")]
    counts = {"time": (1, 2), **dict.fromkeys(PARTS, (1, 3))}.get(quantity, (1,))
    of_one = [f"{q}.{sensor}" for q in ("time", "interval") for sensor in PARTS]
    known = quantity in (*QUANTITIES, *of_one)
    if not known or not all(map(str, found)) or len(found) not in counts:
        raise argparse.ArgumentTypeError(
            f"{text} is not QUANTITY=NAME, time=SECONDS,NANOSECONDS or acceleration=X,Y,Z"
        )
    if found == ["null"]:
        return quantity, None
    return quantity, found if len(found) > 1 else found[0]


def counts(text):
    """Return quantity, scale and offset of an argument ``acceleration=0.0024,32768``."""
    quantity, _, values = text.partition("=")
    try:
        scale, offset = map(float, f"{values},0".split(",")[:2])
    except ValueError:
        scale = 0.0
    least, most = SCALE_OF_COUNTS
    if quantity not in PARTS or not (least <= scale <= most and abs(offset) <= MOST_COUNT_OFFSET):
        raise argparse.ArgumentTypeError(f"{text} is not acceleration=SCALE,OFFSET (SI a count)")
    return quantity, {"scale": scale, "offset": offset}


def ranges(text):
    """Return the quantity, by the unit, and each range of an argument ``16 g,2000 deg/s``."""
    found = {}
    for part in text.split(","):
        unit = part.strip().lstrip("±.0123456789 ")
        for quantity, units in (("acceleration", ACCELERATION), ("angular_rate", ANGULAR_RATE)):
            if unit in units:
                found[quantity] = part.strip()
    if len(found) < len(text.split(",")):
        raise argparse.ArgumentTypeError(f"{text} is not RANGE,RANGE with units: 16 g,2000 deg/s")
    return found


def between(low, high, count=1):
    """Return what takes an argument that is a number in a range, or several."""

    def number(text):
        values = [float(value) for value in text.split(",")]
        if len(values) != count or not all(low <= value <= high for value in values):
            what = f"{count} numbers" if count > 1 else "a number"
            raise argparse.ArgumentTypeError(f"{text} is not {what} from {low:g} to {high:g}")
        return tuple(values) if count > 1 else values[0]

    return number


def add_arguments(command):
    """Add what the config would say of a log to a command's arguments."""
    group = command.add_argument_group("the log, where it does not say so itself")
    group.add_argument(
        "--columns",
        nargs="+",
        type=columns,
        default=[],
        metavar="QUANTITY=NAME",
        help="as in the config: time=stamp acceleration=fx,fy,fz angular_rate=p,q,r temperature=T; "
        "-fx turns a sign; time=sec,nsec; time=null for none; time.acceleration=ta "
        "time.angular_rate=tg of two tables; a stream or variable that holds all "
        "three axes, acceleration=/imu_a; by number from 0 in a log without header",
    )
    group.add_argument("--acceleration-unit", metavar="UNIT", help=", ".join(UNITS["acceleration"]))
    group.add_argument("--angular-rate-unit", metavar="UNIT", help=", ".join(UNITS["angular_rate"]))
    group.add_argument(
        "--time-unit", metavar="UNIT", help=f"{', '.join(UNITS['time'])}; default: s"
    )
    group.add_argument(
        "--temperature-unit",
        metavar="UNIT",
        help=f"{', '.join(UNITS['temperature'])}; default: degC",
    )
    group.add_argument(
        "--counts",
        nargs="+",
        type=counts,
        default=[],
        metavar="QUANTITY=SCALE,OFFSET",
        help="SI units a count and count of zero, for acceleration and angular_rate",
    )
    group.add_argument(
        "--sensor",
        metavar="NAME",
        help="of those that imuloop sensors lists: counts, full scale, tolerances and noise of its "
        "data sheet",
    )
    group.add_argument(
        "--range",
        type=ranges,
        default={},
        metavar="RANGE,RANGE",
        help="of the sensor, where it has several: '16 g,2000 deg/s'",
    )
    group.add_argument(
        "--rate", type=between(1e-6, 1e9), metavar="HZ", help="where the log has no time column"
    )
    group.add_argument("--format", help="default: from the file's name and first bytes")


def figures_of(arguments):
    """Return the `device_figures` of the sensor that the arguments name."""
    return device_figures(arguments.sensor, arguments.range, dict(arguments.counts))


def declared(arguments, calibration=None, layout=None):
    """Return what the arguments declare of a log, as in `ingest`, without the scales of counts.

    Where they say nothing, the raw units are those of the calibration, if one is given, and the
    rest is as the `layout` of the log that it is from has it.
    """
    layout = layout or {}
    units = {
        "acceleration": arguments.acceleration_unit,
        "angular_rate": arguments.angular_rate_unit,
        "time": arguments.time_unit,
        "temperature": arguments.temperature_unit,
    }
    units = {q: unit for q, unit in units.items() if unit}
    units = dict.fromkeys(dict(arguments.counts), "count") | units
    # those in SI are what a log is in that says nothing, and increments do
    own = raw_units(calibration).items()
    units = {q: u.name for q, u in own if u.scale != 1} | layout.get("units", {}) | units
    what = {"format": arguments.format or layout.get("format"), "units": units}
    given = {}
    for quantity, names in arguments.columns:
        quantity, _, sensor = quantity.partition(".")
        given[quantity] = {**given.get(quantity, {}), sensor: names} if sensor else names
    what["columns"] = layout.get("columns", {}) | given
    return what | {"rate": arguments.rate or layout.get("rate")}


def raw_units(calibration=None):
    """Return the RawUnit of each sensor of a calibration, if one is given, by its quantity."""
    parts = PARTS.items() if calibration else ()
    return {quantity: getattr(calibration, sensor).raw_unit for quantity, sensor in parts}


def log_samples(log, arguments, folder, calibration=None):
    """Return the samples file of a log, and its quality figures as far as there are any.

    Samples as ingest wrote them are taken as they are; of a raw log they go to the folder.
    """
    paths = files_of(log)
    for path in paths:
        if not path.exists():
            raise ImuloopError(f"{path}: there is no such file")
    if len(paths) == 1 and log.suffix == ".parquet" and log.is_file() and is_samples(log):
        beside = log.with_name("quality.json")
        return log, read_json(beside) if beside.is_file() else {}
    samples, quality = folder / "samples.parquet", folder / "quality.json"
    known, figures = calibration.log if calibration else {}, figures_of(arguments)
    nominal = figures["nominal"]
    for quantity, unit in raw_units(calibration).items():
        own = {"scale": unit.scale, "offset": unit.offset}
        nominal[quantity] = own | nominal.get(quantity, {})
    full_scale = known.get("full_scale", {}) | figures["full_scale"]

    def read(layout=None):
        ingest(
            device=calibration.device if calibration else "log",
            session=name_of(log),
            # what was done with the device is not known
            kind=None,
            paths=paths,
            samples_path=samples,
            quality_path=quality,
            declared=Declared(
                nominal=nominal,
                full_scale=full_scale,
                **declared(arguments, calibration, layout),
            ),
        )
        return samples, read_json(quality)

    if known and known.get("format") in (None, _format(log)):
        # one without these columns is read as if nothing were known
        with suppress(ImuloopError):
            return read(known)
    return read()


def _format(log):
    """Return the format that a log shows, or None."""
    with suppress(ImuloopError):
        return guess_format(log if isinstance(log, dict) else {"log": log})


def is_samples(path):
    """Return whether a Parquet file holds samples as ingest writes them."""
    if no_log(path):
        return False
    try:
        return "raw_units" in read_metadata(path)
    except (ValueError, OSError):
        return False


def refuse_rejected(log, quality):
    """Raise an error for a log that ingest rejected, with the reasons."""
    if quality.get("status") == "rejected":
        raise ImuloopError(f"{paths_of(log)}: rejected: {'; '.join(quality['reasons'])}")


def segmented(samples, kind, rails, stuck):
    """Return the kind of a log and its segments; poses if it has several and no kind is given."""
    how = kind or "multi_position"
    segments, found = segment_session(samples, how, SegmentSettings(), rails, stuck)
    if kind or found["poses"] > 1:
        return how, segments
    return "static", segment_session(samples, "static", SegmentSettings(), stuck=stuck)[0]
