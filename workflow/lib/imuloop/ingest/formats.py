"""The log formats: a name, a reader, and what shows them: first bytes, else the file's name."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path, PurePath

from imuloop.core.errors import ImuloopError, RejectedLog, did_you_mean
from imuloop.ingest import arrays, dataflash, delimited, json_lines, phone, ros, tables, ulog
from imuloop.ingest.text_layout import NO_LOGS

# roles of two files, of one sensor each
PAIR = ("acceleration", "angular_rate")
_PACKED = (".gz", ".bz2", ".zst", ".lz4")


@dataclass(frozen=True)
class LogFormat:
    """A log format: its reader, and what its files are called.

    ``read(paths, columns) -> RawLog`` takes the role of each file, `files`, to its
    path, and what the config says of columns. It raises ImuloopError where a declaration does not
    fit, RejectedLog for a broken file. `endings` are those of file names, lower case; a `folder`
    may hold files of them.
    """

    read: Callable
    endings: tuple[str, ...]
    files: tuple[str, ...] = ("log",)
    folder: bool = False


# a new format is a reader and a line here; SIGNATURES and tests: "Adding a format", docs/formats.md
FORMATS = {
    "csv": LogFormat(delimited.read, delimited.ENDINGS),
    # the separator is found in the file; the name is there for those who look for it
    "tsv": LogFormat(delimited.read, (".tsv", ".tab")),
    # the folder; its table alone is a csv
    "euroc": LogFormat(delimited.read, (), folder=True),
    "imu_tk": LogFormat(delimited.read, (), PAIR),
    "jsonl": LogFormat(json_lines.read, json_lines.ENDINGS),
    "parquet": LogFormat(tables.read_parquet, tables.PARQUET_ENDINGS),
    "feather": LogFormat(tables.read_feather, tables.FEATHER_ENDINGS),
    "numpy": LogFormat(arrays.read_numpy, arrays.NUMPY_ENDINGS),
    "netcdf": LogFormat(arrays.read_netcdf, arrays.NETCDF_ENDINGS),
    "matlab": LogFormat(arrays.read_matlab, arrays.MATLAB_ENDINGS),
    "ros": LogFormat(ros.read, ros.ENDINGS, folder=True),
    "phone": LogFormat(phone.read, phone.ENDINGS),
    "ulog": LogFormat(ulog.read, ulog.ENDINGS),
    "dataflash": LogFormat(dataflash.read, dataflash.ENDINGS),
}

# how files begin, whatever their name
SIGNATURES = {
    b"PAR1": "parquet",
    b"ARROW1": "feather",
    b"\x93NUMPY": "numpy",
    b"CDF": "netcdf",
    b"MATLAB ": "matlab",
    b"#ROSBAG": "ros",
    b"\x89MCAP0": "ros",
    b"SQLite format 3\0": "ros",
    b"PK\x03\x04": "phone",
    b"ULog\x01\x12\x35": "ulog",
    b"\xa3\x95\x80": "dataflash",
    b"FMT, 128": "dataflash",
}
_HEAD = 1 << 14
# where a zip has the length of the first member's name, and the name
_LENGTH, _NAME = slice(26, 28), 30


def find_format(name, paths):
    """Return the name of a format and the LogFormat: that declared, else that its files show.

    An ImuloopError where the name is unknown, or the files show none or are not the format's.
    """
    cause = next(filter(None, map(no_log, paths.values())), None)
    name = name or ("csv" if cause else guess_format(paths))
    if name not in FORMATS:
        hint = did_you_mean(str(name), FORMATS) or f"; use one of {', '.join(FORMATS)}"
        raise ImuloopError(f"'{name}' is not a format{hint}")
    form = FORMATS[name]
    if {*paths} == {*PAIR}:
        form = replace(form, read=partial(tables.read_pair, form.read), files=PAIR)
    if {*paths} != {*form.files}:
        raise ImuloopError(
            f"format {name} is read from {' and '.join(form.files)}, given {' and '.join(paths)}"
        )
    for path in paths.values():
        if Path(path).is_dir() and not form.folder:
            raise ImuloopError(f"{path} is a folder, not a file")
    return name, replace(form, read=partial(_reject, cause)) if cause else form


def no_log(path):
    """Return why a file that begins like this is a log of no format, or None."""
    head = _head(path)
    return next((why for start, why in NO_LOGS.items() if head.startswith(start)), None)


def _reject(cause, *given, **options):
    raise RejectedLog(cause)


def guess_format(paths):
    """Return the name of the format that the files' roles, first bytes or names stand for."""
    path = Path(next(iter(paths.values())))
    if path.is_dir():
        inside = {PurePath(p.name.removesuffix(".zstd")).suffix for p in path.iterdir()}
        for name, form in FORMATS.items():
            if form.folder and inside & {*form.endings}:
                return name
        if (path / delimited.IN_FOLDER).is_file():
            return "euroc"
        raise ImuloopError(f"{path} is a folder, not a file")
    if name := _by_first_bytes(path):
        return name
    bare = path.with_suffix("") if path.suffix.lower() in _PACKED else path
    if {*paths} == {*PAIR} and bare.suffix == ".mat":
        return "imu_tk"
    for name, form in FORMATS.items():
        if bare.suffix.lower() in form.endings:
            return name
    raise ImuloopError(
        f"the name {bare.name} does not say its format; give format: {' | '.join(FORMATS)}"
    )


def _by_first_bytes(path):
    """Return the format that a file's first bytes show, or None."""
    head = _head(path)
    for signature, name in SIGNATURES.items():
        if head.startswith(signature):
            # an .npz is a zip of arrays
            first = head[_NAME:][: int.from_bytes(head[_LENGTH], "little")]
            return "numpy" if name == "phone" and first.endswith(b".npy") else name
    return "jsonl" if json_lines.are_objects(head) else None


def _head(path):
    """Return the first bytes of a file; none of another thing, such as a pipe, is opened."""
    with suppress(OSError):
        if Path(path).is_file():
            with open(path, "rb") as file:
                return file.read(_HEAD)
    return b""
