"""The log formats: a name, a reader, and what tells them: first bytes, else the file's name."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path, PurePath

from imuloop.core.errors import ImuloopError, did_you_mean
from imuloop.ingest import (
    dataflash,
    delimited,
    euroc,
    imu_tk,
    matlab,
    netcdf,
    parquet,
    phone,
    ros,
    sensorlog,
    ulog,
)

_PACKED = (".gz", ".bz2", ".zst", ".lz4")


@dataclass(frozen=True)
class Format:
    """A log format.

    Attributes
    ----------
    read : callable
        ``read(paths, columns, batch_rows) -> RawLog``; with `most` too where `whole`.
    endings : tuple of str
        Endings of the file names that stand for the format, lower case.
    files : tuple of str
        Roles of its files; ``("log",)`` for a format of one file.
    folder : bool
        Whether it may be a folder with files of these endings.
    whole : bool
        Whether `read` takes in the whole log unless `most` says how many bytes of it, about.
    """

    read: Callable
    endings: tuple[str, ...]
    files: tuple[str, ...] = ("log",)
    folder: bool = False
    whole: bool = False


# a new format is one reader and one line here
FORMATS = {
    "csv": Format(delimited.read, delimited.ENDINGS),
    # the separator is found in the file; the name is there for those who look for it
    "tsv": Format(delimited.read, (".tsv", ".tab")),
    # the folder; its table alone is a csv
    "euroc": Format(euroc.read, (), folder=True),
    "imu_tk": Format(imu_tk.read, (), imu_tk.FILES),
    "parquet": Format(parquet.read, parquet.ENDINGS),
    "netcdf": Format(netcdf.read, netcdf.ENDINGS),
    "matlab": Format(matlab.read, matlab.ENDINGS),
    "ros": Format(ros.read, ros.ENDINGS, folder=True, whole=True),
    "phone": Format(phone.read, phone.ENDINGS, whole=True),
    # a .csv as others; told by its name here or by what it holds
    "sensorlog": Format(sensorlog.read, sensorlog.ENDINGS, whole=True),
    "ulog": Format(ulog.read, ulog.ENDINGS, whole=True),
    "dataflash": Format(dataflash.read, dataflash.ENDINGS, whole=True),
}

# how files begin, whatever their name
SIGNATURES = {
    b"PAR1": "parquet",
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
# in the header of a text table that is SensorLog's
_SENSORLOG = (b"accelerometertimestamp_sincereboot", b"accelerometeraccelerationx")
_HEAD = 1 << 14


def find_format(name, paths):
    """Return the name of a format and the Format: that declared, else that its files tell.

    Parameters
    ----------
    name : str or None
        Declared name.
    paths : dict
        Role of the file to path.

    Raises
    ------
    ImuloopError
        If the name is unknown, the files do not say which format, or are not the format's.
    """
    name = name or guess_format(paths)
    if name not in FORMATS:
        hint = did_you_mean(str(name), FORMATS) or f"; use one of {', '.join(FORMATS)}"
        raise ImuloopError(f"'{name}' is not a format{hint}")
    if set(paths) != set(FORMATS[name].files):
        raise ImuloopError(
            f"format {name} is read from {' and '.join(FORMATS[name].files)}, "
            f"given {' and '.join(paths)}"
        )
    for path in paths.values():
        if Path(path).is_dir() and not FORMATS[name].folder:
            raise ImuloopError(f"{path} is a folder, not a file")
    return name, FORMATS[name]


def guess_format(paths):
    """Return the name of the format that the files' keys, first bytes or names stand for."""
    for name, form in FORMATS.items():
        if len(form.files) > 1 and set(form.files) == set(paths):
            return name
    path = PurePath(next(iter(paths.values())))
    if Path(path).is_dir():
        inside = {PurePath(p.name.removesuffix(".zstd")).suffix for p in Path(path).iterdir()}
        for name, form in FORMATS.items():
            if form.folder and inside & {*form.endings}:
                return name
        if Path(path, euroc.TABLE).is_file():
            return "euroc"
        raise ImuloopError(f"{path} is a folder, not a file")
    if told := _told(Path(path)):
        return told
    if path.suffix.lower() in _PACKED:
        path = path.with_suffix("")
    for name, form in FORMATS.items():
        if path.suffix.lower() in form.endings and len(form.files) == len(paths):
            return name
    raise ImuloopError(
        f"the name {path.name} does not say its format; add format: {' | '.join(FORMATS)}"
    )


def _told(path):
    """Return the format that a file's first bytes tell, or None."""
    if not path.is_file():
        return None
    try:
        with open(path, "rb") as file:
            head = file.read(_HEAD)
    except OSError:
        return None
    for signature, name in SIGNATURES.items():
        if head.startswith(signature):
            return name
    line = head.partition(b"\n")[0].lower()
    return "sensorlog" if all(word in line for word in _SENSORLOG) else None
