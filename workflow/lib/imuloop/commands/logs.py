"""A raw log on the command line: its files and its samples."""

import re
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from imuloop import chain
from imuloop.config import OF_LOGS, known_figures, merge
from imuloop.core.errors import ImuloopError
from imuloop.core.files import read_json
from imuloop.core.samples import read_metadata, read_samples
from imuloop.ingest.formats import PAIR, guess_format, no_log
from imuloop.ingest.json_lines import holds_log
from imuloop.noise.records import RecordedSession
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from imuloop.sensors import PARTS

# words of the help on how a log is given
LOG = "LOG or acceleration=FILE,angular_rate=FILE"


@dataclass(frozen=True)
class Log:
    """A log that an argument of a command names, in one file or in a file for each sensor."""

    files: dict  # path by role: ``log``, or ``acceleration`` and ``angular_rate``

    @classmethod
    def parse(cls, text):
        """Return the Log of an argument, `text`: LOG, or acceleration=FILE,angular_rate=FILE."""
        two = re.fullmatch(r"acceleration=(.+),angular_rate=(.+)", text)
        files = dict(zip(PAIR, two.groups(), strict=True)) if two else {"log": text}
        return cls({role: Path(path) for role, path in files.items()})

    @property
    def paths(self):
        """Paths of the files, a list."""
        return [*self.files.values()]

    @property
    def name(self):
        """Names of the files without their folders, text."""
        return " and ".join(path.name for path in self.paths)

    def __str__(self):
        return " and ".join(map(str, self.paths))

    def refuse_no_log(self):
        """Raise an ImuloopError if a file of the log does not exist, or is a JSON result."""
        for path in self.paths:
            if not path.exists():
                raise ImuloopError(f"{path}: there is no such file")
            if path.suffix == ".json" and path.is_file() and not holds_log(path):
                raise ImuloopError(f"{path}: not a log; imuloop info describes results")

    def samples_path(self):
        """Return the path of the log if it is a samples.parquet, written by ingest, else None."""
        path = self.files.get("log", Path())
        return path if "raw_units" in metadata_of(path) else None

    def refuse_rejected(self, quality):
        """Raise an ImuloopError with the reasons if ingest rejected the log.

        `quality` is the content of its quality.json.
        """
        if quality.get("status") == "rejected":
            raise ImuloopError(f"{self}: rejected: {'; '.join(quality['reasons'])}")


def metadata_of(path):
    """Return the metadata that imuloop wrote into a Parquet file, a dict; empty for another file.

    `path` is the path of the file.
    """
    if path.suffix == ".parquet" and path.is_file() and not no_log(path):
        with suppress(ValueError, OSError):
            return read_metadata(path)
    return {}


def refuse_swapped(calibration, log):
    """Raise an ImuloopError if the arguments for calibration and log seem to be swapped.

    `calibration` is the path where calibration.json is expected, and `log` is the Log. They are
    swapped if the log is a .json file and the calibration is not.
    """
    if any(path.suffix == ".json" for path in log.paths) and calibration.suffix != ".json":
        raise ImuloopError(f"{calibration}: no calibration.json: it comes first, then the log")


def write_samples(log, declared, folder, calibration=None):
    """Return the path of the samples of a log, and the content of its quality.json.

    `log` is the Log. A samples.parquet of ingest is used as it is; its quality is empty if there is
    no quality.json next to it. The samples of a raw log are written into `folder`. `declared` are
    declarations about the log, keys of a config. If a Calibration is given, `calibration`, all keys
    that are not declared are taken from the log that it was fitted to.
    """
    log.refuse_no_log()
    if path := log.samples_path():
        beside = path.with_name("quality.json")
        return path, read_json(beside) if beside.is_file() else {}
    log_keys, figures = calibration.log if calibration else {}, known_figures(declared)
    parts = PARTS.items() if calibration else ()
    raw = {quantity: getattr(calibration, sensor).raw_unit for quantity, sensor in parts}
    counts = {quantity: {"scale": u.scale, "offset": u.offset} for quantity, u in raw.items()}
    # a log without declared units is in SI, and increments declare theirs
    units = {"units": {quantity: unit.name for quantity, unit in raw.items() if unit.scale != 1}}
    device = chain.Device(
        calibration.device if calibration else "log",
        folder,
        # the motion of the device is not known
        {log.name: None},
        gravity=figures["gravity"],
        nominal=merge(counts, figures["nominal"]),
        full_scale=log_keys.get("full_scale", {}) | figures["full_scale"],
    )
    files = device.sessions[log.name]

    def read(layout):
        """Ingest the log with the declarations `layout`, and return samples path and quality.

        `layout` are keys of a config.
        """
        keys = merge(merge(units, layout), declared)
        chain.ingest(device, log.name, {key: keys.get(key) for key in OF_LOGS}, log.paths)
        return files["samples"], read_json(files["quality"])

    # a log without the columns of the calibration's log is read without its declaration
    with suppress(ImuloopError):
        if log_keys and log_keys.get("format") in (None, guess_format(log.files)):
            return read(log_keys)
    return read({})


def read_log(log, declared, calibration=None):
    """Return three results on a log: its samples, the metadata of the samples, and its quality.

    The samples are a table. The metadata are a dict, read from samples.parquet. The quality is a
    dict, the content of quality.json. `log` is the Log. `declared` are declarations about it, keys
    of a config. If a Calibration is given, `calibration`, all keys that are not declared are taken
    from the log that it was fitted to. Raises an ImuloopError if the log is rejected.
    """
    with tempfile.TemporaryDirectory(prefix="imuloop-") as folder:
        path, quality = write_samples(log, declared, Path(folder), calibration)
        log.refuse_rejected(quality)
        return read_samples(path), read_metadata(path), quality


def recorded(log, samples, metadata, kind):
    """Return the RecordedSession of a log, its samples with its rests, and the number of its poses.

    `log` is the Log, and `samples` and `metadata` are from `read_log`. `kind` is the kind of the
    session, such as ``static``, by which its rests are found.
    """
    faults = {name: metadata[name] for name in ("rails", "stuck") if name in metadata}
    segments, figures = segment_session(samples, kind, SegmentSettings(), **faults)
    return RecordedSession(log.name, kind, samples, segments), figures["poses"]
