"""A raw log on the command line: its files and its samples."""

import re
from contextlib import suppress
from pathlib import Path

from imuloop.commands.options import declared_keys
from imuloop.core.errors import ImuloopError
from imuloop.core.files import read_json
from imuloop.core.samples import read_metadata
from imuloop.ingest.formats import PAIR, guess_format, no_log
from imuloop.ingest.ingest import Declared, ingest
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from imuloop.sensors import PARTS, device_figures

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


def figures_of(arguments):
    """Return the figures of the data sheet of the sensor that the options name, by key."""
    keys = declared_keys(arguments)
    return device_figures(*map(keys.get, ("sensor", "range", "nominal")))


def declared(arguments, calibration=None, layout=None):
    """Return the keywords of `Declared` that the options give, without the scales of counts.

    Raw units without an option are those of the calibration, if one is given; all else without an
    option is taken from `layout`, the declaration of the calibration's log.
    """
    keys, found = declared_keys(arguments), dict(layout or {})
    # a log without declared units is in SI, and increments declare theirs
    own = raw_units(calibration).items()
    units = {q: u.name for q, u in own if u.scale != 1} | found.get("units", {})
    what = {"units": units | keys.get("units", {})}
    what["columns"] = found.get("columns", {}) | keys.get("columns", {})
    return what | {key: keys.get(key, found.get(key)) for key in ("format", "rate")}


def raw_units(calibration=None):
    """Return the RawUnit of each sensor of a calibration, if one is given, by its quantity."""
    parts = PARTS.items() if calibration else ()
    return {quantity: getattr(calibration, sensor).raw_unit for quantity, sensor in parts}


def log_samples(log, arguments, folder, calibration=None):
    """Return the path of the samples of a log, and the content of its quality.json, if any.

    A samples.parquet of ingest is used as it is; a raw log is read into `folder`.
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
        """Ingest the log with the declaration `layout`; return samples path and quality."""
        ingest(
            device=calibration.device if calibration else "log",
            session=name_of(log),
            # the motion of the device is not known
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
        # a log without the columns of the calibration's log is read without its declaration
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
    """Return the kind of a log and its segments; without a kind, several poses decide it."""
    how = kind or "multi_position"
    segments, found = segment_session(samples, how, SegmentSettings(), rails, stuck)
    if kind or found["poses"] > 1:
        return how, segments
    return "static", segment_session(samples, "static", SegmentSettings(), stuck=stuck)[0]
