"""The log formats: a name, a reader, the endings of file names that stand for it."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path, PurePath

from imuloop.core.errors import ImuloopError, did_you_mean
from imuloop.ingest import dataflash, delimited, imu_tk, matlab, netcdf, parquet, phone, ros, ulog

_PACKED = (".gz", ".bz2", ".zst", ".lz4")


@dataclass(frozen=True)
class Format:
    """A log format.

    Attributes
    ----------
    read : callable
        ``read(paths, columns, batch_rows) -> RawLog``.
    endings : tuple of str
        Endings of the file names that stand for the format, lower case.
    files : tuple of str
        Roles of its files; ``("log",)`` for a format of one file.
    folder : bool
        Whether it may be a folder with files of these endings.
    """

    read: Callable
    endings: tuple[str, ...]
    files: tuple[str, ...] = ("log",)
    folder: bool = False


# a new format is one reader and one line here
FORMATS = {
    "csv": Format(delimited.read, delimited.ENDINGS),
    # the separator is found in the file; the name is there for those who look for it
    "tsv": Format(delimited.read, (".tsv", ".tab")),
    "imu_tk": Format(imu_tk.read, imu_tk.ENDINGS, imu_tk.FILES),
    "parquet": Format(parquet.read, parquet.ENDINGS),
    "netcdf": Format(netcdf.read, netcdf.ENDINGS),
    "matlab": Format(matlab.read, matlab.ENDINGS),
    "ros": Format(ros.read, ros.ENDINGS, folder=True),
    "phone": Format(phone.read, phone.ENDINGS),
    # a .csv as others; told by its name here or by what it holds
    "sensorlog": Format(phone.read_sensorlog, ()),
    "ulog": Format(ulog.read, ulog.ENDINGS),
    "dataflash": Format(dataflash.read, dataflash.ENDINGS),
}


def find_format(name, paths):
    """Return a format by its declared name, or by its files where none is declared.

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
    return FORMATS[name]


def guess_format(paths):
    """Return the name of the format that the files' keys or names stand for."""
    for name, form in FORMATS.items():
        if len(form.files) > 1 and set(form.files) == set(paths):
            return name
    path = PurePath(next(iter(paths.values())))
    if Path(path).is_dir():
        inside = {PurePath(p.name.removesuffix(".zstd")).suffix for p in Path(path).iterdir()}
        for name, form in FORMATS.items():
            if form.folder and inside & {*form.endings}:
                return name
        raise ImuloopError(f"{path} is a folder, not a file")
    if path.suffix.lower() in _PACKED:
        path = path.with_suffix("")
    for name, form in FORMATS.items():
        if path.suffix.lower() in form.endings and len(form.files) == len(paths):
            return name
    raise ImuloopError(
        f"the name {path.name} does not say its format; add format: {' | '.join(FORMATS)}"
    )
