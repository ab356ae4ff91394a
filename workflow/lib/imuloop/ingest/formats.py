"""The log formats: name, reader, and the first bytes or the file name that show each of them."""

from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from imuloop.core.errors import ImuloopError, RejectedLog, nearest
from imuloop.ingest.damage import LONGEST_LINE, SPREADSHEET, read_whole

# roles of the files of a log in two files, one for each sensor
PAIR = ("acceleration", "angular_rate")
# name of the table in the folder of a sensor in an EuRoC recording
IN_FOLDER = "data.csv"
_PACKED = (".gz", ".bz2", ".zst", ".lz4")


@dataclass(frozen=True)
class LogFormat:
    """A log format: its reader, and the names and first bytes of its files.

    `reader` is MODULE.FUNCTION in ingest; it is imported only when a log is read. The function
    ``read(paths, columns) -> RawLog`` takes the path of each file by its role, and the declared
    columns by quantity. It raises an ImuloopError if a declaration does not fit, and a RejectedLog
    for a broken file. `endings` are the ends of file names, in lower case. `starts` are the first
    bytes that show the format under any file name. `folder` tells whether a folder may be read.
    `remedy` is advice to a user with a broken file.
    """

    reader: str
    endings: tuple[str, ...]
    starts: tuple[bytes, ...] = ()
    folder: bool = False
    remedy: str = "copy it again, or save it anew"

    @property
    def module(self):
        """Name of the module of the reader, such as ``delimited``."""
        return self.reader.partition(".")[0]


# a new format is a reader and a line here; its tests: "Adding a format", docs/formats.md
FORMATS = {
    "csv": LogFormat("delimited.read", (".csv", ".txt", ".log", ".dat", ".asc", ".gcsv")),
    # the separator is found in the file; the name is there for those who look for it
    "tsv": LogFormat("delimited.read", (".tsv", ".tab")),
    # the folder; its table alone is a csv
    "euroc": LogFormat("delimited.read", (), folder=True),
    "imu_tk": LogFormat("delimited.read", ()),
    "jsonl": LogFormat("json_lines.read", (".jsonl", ".ndjson", ".json")),
    "parquet": LogFormat("arrays.read_parquet", (".parquet", ".pq"), (b"PAR1",)),
    "feather": LogFormat(
        "arrays.read_feather",
        (".feather", ".arrow"),
        (b"ARROW1",),
        remedy="copy it again, or save it anew, as Feather of version 2",
    ),
    "numpy": LogFormat("arrays.read_numpy", (".npy", ".npz"), (b"\x93NUMPY",)),
    "netcdf": LogFormat("arrays.read_netcdf", (".nc", ".nc4", ".cdf", ".netcdf"), (b"CDF",)),
    "matlab": LogFormat("arrays.read_matlab", (".mat",), (b"MATLAB ",)),
    "ros": LogFormat(
        "ros.read",
        (".bag", ".db3", ".mcap"),
        (b"#ROSBAG", b"SQLite format 3\0", b"\x89MCAP0"),
        folder=True,
        remedy="copy it again, or mend it, if its recording was cut off, with rosbag reindex, "
        "sqlite3 with .recover, or mcap recover; export an SQLite database of another kind as CSV",
    ),
    "phone": LogFormat("phone.read", (".zip",), (b"PK\x03\x04",)),
    "ulog": LogFormat("ulog.read", (".ulg", ".ulog"), (b"ULog\x01\x12\x35",)),
    "dataflash": LogFormat("dataflash.read", (".bin",), (b"\xa3\x95\x80",)),
}
READERS = {form.module for form in FORMATS.values()}
# readers that read text by the reader of text tables
_WITH_TEXT = {"arrays", "json_lines", "phone"}
SIGNATURES = {start: name for name, form in FORMATS.items() for start in form.starts}
# first bytes of files that are logs of no format, and the reason with a remedy
_NO_LOGS = {
    b"\xd0\xcf\x11\xe0": SPREADSHEET,
    b"version https://git-lfs.github.com/": (
        "the file is a pointer of Git LFS, not the log that it stands for: fetch that with git lfs "
        "pull"
    ),
    b"FMT, 128": "DataFlash as text is not read: give the binary log, .bin, that it was made from",
}


def find_format(name, paths):
    """Return the name and the reader of the format of a log.

    `name` is the declared name; if it is None, the format is guessed from the files. `paths` are
    the paths of the files by role. The reader is a function, ``read(paths, columns=None)``, that
    returns a RawLog. Raises an ImuloopError if the name is unknown, if the files show no format, or
    if a path is a folder, which most formats cannot read; raises a RejectedLog if a file is not a
    log of any format.
    """
    for path in paths.values():
        if cause := no_log(path):
            raise RejectedLog(cause)
    name = name or guess_format(paths)
    if name not in FORMATS:
        raise ImuloopError(f"'{name}' is not a format{nearest(str(name), FORMATS)}")
    for path in paths.values():
        if not FORMATS[name].folder and Path(path).is_dir():
            raise ImuloopError(f"{path} is a folder, not a file")
    read = partial(read_whole, name, FORMATS[name])
    if {*paths} == {*PAIR}:
        from imuloop.ingest.tables import read_pair

        read = partial(read_pair, read)
    return name, read


def unused_readers(session, paths):
    """Return the modules of the readers of log formats that a session does not use, a set of names.

    The job of the session does not depend on the code of these modules, so it need not run again if
    their code changes. `session` is the session as `config.resolve` returns it, and `paths` the
    path of each file by role. The set is empty if a file does not show its format, because any
    reader may then be the right one.
    """
    declared = {"reference": (session["reference"] or {}).get("format"), "pps": "csv"}
    try:
        names = [
            declared.get(role, session["format"]) or guess_format({role: path})
            for role, path in paths.items()
        ]
    except ImuloopError:
        return set()
    names += ["csv"] * bool(session["pps"]) + [declared["reference"]] * bool(declared["reference"])
    used = {FORMATS[name].module for name in names}
    return READERS - used - ({"delimited"} if used & _WITH_TEXT else set())


def no_log(path):
    """Return the reason if the first bytes show that the file at `path` is not a log, else None."""
    head = _head(path)
    return next((why for start, why in _NO_LOGS.items() if head.startswith(start)), None)


def guess_format(paths):
    """Return the name of the log format that the roles, first bytes or names of files show.

    `paths` are the paths of the files of one log by role: ``log``, or one file for each sensor.
    Raises an ImuloopError if they show no format.
    """
    path = Path(next(iter(paths.values())))
    if path.is_dir():
        inside = {ending for file in path.iterdir() for ending in file.suffixes}
        if inside & {*FORMATS["ros"].endings} or (path / "metadata.yaml").is_file():
            return "ros"
        if (path / IN_FOLDER).is_file():
            return "euroc"
        raise ImuloopError(f"{path} is a folder, not a file")
    head = _head(path)
    for signature, name in SIGNATURES.items():
        if head.startswith(signature):
            # an .npz is a zip of arrays
            return "numpy" if name == "phone" and path.suffix.lower() == ".npz" else name
    if head.lstrip().startswith(b"{"):
        from imuloop.ingest.json_lines import are_objects

        if are_objects(head):
            return "jsonl"
    bare = path.with_suffix("") if path.suffix.lower() in _PACKED else path
    if {*paths} == {*PAIR} and bare.suffix == ".mat":
        return "imu_tk"
    for name, form in FORMATS.items():
        if bare.suffix.lower() in form.endings:
            return name
    raise ImuloopError(
        f"the name {bare.name} does not say its format; give format: {' | '.join(FORMATS)}"
    )


def _head(path):
    """Return the first bytes of the file at `path`; for a pipe or a folder the result is empty."""
    with suppress(OSError):
        if Path(path).is_file():
            with open(path, "rb") as file:
                return file.read(LONGEST_LINE)
    return b""
