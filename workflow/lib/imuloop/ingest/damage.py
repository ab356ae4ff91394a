"""Damaged files, and files made to break their reader: one line says so, the log is rejected."""

from pathlib import Path

from imuloop.core.errors import ImuloopError, RejectedLog, one_line

# no log packs better than this
MOST_TIMES = 200
# bytes of a file that show its format and its layout; without a line end in them it is no table
LONGEST_LINE = 1 << 16
SPREADSHEET = "the file is a spreadsheet, such as Excel's: save its table as CSV"


def check_unpacked(packed, unpacked):
    """Refuse a file of `packed` bytes of which so far more than `MOST_TIMES` as many came out."""
    if unpacked > MOST_TIMES * packed:
        raise RejectedLog(
            f"unpacked, the file is more than {MOST_TIMES} times its {packed} bytes: refused, "
            "no log packs so well"
        )


def read_whole(name, form, paths, columns=None):
    """Return the RawLog of a file; reject one that the library of its format cannot read.

    A package that is missing becomes an `ImuloopError` with the command that installs it.

    Parameters
    ----------
    name, form : str, LogFormat
        Name of the format; its reader, and the remedy of a broken file.
    paths : dict
        The path under ``log``.
    columns : dict, optional
        As declared.
    """
    path = Path(paths["log"])
    try:
        return form.read(paths, columns)
    except ImuloopError:
        raise
    except ImportError as error:
        package = str(error.name).partition(".")[0]
        # an extra of the project is called as the format that needs it
        raise ImuloopError(
            f"format {name} needs the package {package}, which is not installed: pip install "
            f"'.[{name}]'"
        ) from error
    except Exception as error:
        # a damaged file may announce any size
        large = isinstance(error, MemoryError)
        what = "does not fit the memory" if large else f"is damaged, or not of the format {name}"
        why = f"{type(error).__name__}: {error}".replace(str(path), "the file")
        remedy = "save it in parts" if large else form.remedy
        raise RejectedLog(f"{path.name} {what} ({one_line(why)[:150]}): {remedy}") from error
