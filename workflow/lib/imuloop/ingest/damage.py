"""Rejection of damaged files, and of files that are made to break their reader."""

from importlib import import_module
from pathlib import Path

from imuloop.core.errors import ImuloopError, RejectedLog, one_line

# largest ratio of the unpacked to the packed size of a log: no log packs better
MOST_TIMES = 200
# number of bytes at the start of a file that show its format and its layout; a text without the end
# of a line in them is not a table
LONGEST_LINE = 1 << 16
SPREADSHEET = "the file is a spreadsheet, such as Excel's: save its table as CSV"


def check_unpacked(packed, unpacked):
    """Raise a RejectedLog if a file unpacks to more than `MOST_TIMES` times its packed size.

    `packed` and `unpacked` are the sizes of the file, bytes.
    """
    if unpacked > MOST_TIMES * packed:
        raise RejectedLog(
            f"unpacked, the file is more than {MOST_TIMES} times its {packed} bytes: refused, "
            "no log packs so well"
        )


def read_whole(name, form, paths, columns=None):
    """Return the RawLog of a file, or raise a RejectedLog with a remedy if it is damaged.

    A file counts as damaged if the library of its format fails. A package that is missing becomes
    an `ImuloopError` with the command that installs it.

    Parameters
    ----------
    name : str
        Name of the format.
    form : LogFormat
        The format with its reader and the remedy for a damaged file.
    paths : dict
        Path of the file under the key ``log``.
    columns : dict, optional
        Declared columns by quantity.
    """
    path, (module, read) = Path(paths["log"]), form.reader.split(".")
    try:
        return getattr(import_module(f"imuloop.ingest.{module}"), read)(paths, columns)
    except ImuloopError:
        raise
    except ImportError as error:
        package = str(error.name).partition(".")[0]
        # the extra of the project that installs a package has the name of the format
        raise ImuloopError(
            f"format {name} needs the package {package}, which is not installed: pip install "
            f"'.[{name}]'"
        ) from error
    except Exception as error:
        # a damaged file may announce any size
        large = isinstance(error, MemoryError)
        what = "does not fit the memory" if large else f"is damaged, or not of the format {name}"
        # C code wraps an error that it does not expect in a SystemError without its text
        cause = (isinstance(error, SystemError) and error.__cause__) or error
        why = f"{type(cause).__name__}: {cause}".replace(str(path), "the file")
        remedy = "save it in parts" if large else form.remedy
        raise RejectedLog(f"{path.name} {what} ({one_line(why)[:150]}): {remedy}") from error
