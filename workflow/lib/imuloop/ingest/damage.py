"""Files that are damaged, or made to break their reader: one line says so, and the log is rejected.

What ends the process, such as a lack of memory, ends that job alone.
"""

import functools
from pathlib import Path

import pyarrow as pa

from imuloop.core.errors import ImuloopError, RejectedLog, one_line

# no log packs better than this
MOST_TIMES = 200


def check_unpacked(packed, unpacked):
    """Refuse a file of `packed` bytes of which so far more than `MOST_TIMES` as many came out."""
    if unpacked > MOST_TIMES * packed:
        raise RejectedLog(
            f"unpacked, the file is more than {MOST_TIMES} times its {packed} bytes: refused, "
            "no log packs so well"
        )


def cause(error):
    """Return what an error of a library says, short and on one line."""
    return one_line(f"{type(error).__name__}: {error}")[:150]


def reject_damage(read):
    """Make a reader that leaves the file to a library reject one that the library cannot read.

    A package that is missing becomes an `ImuloopError` with the command that installs it.
    """
    form = read.__module__.rpartition(".")[2] if read.__name__ == "read" else read.__name__[5:]

    @functools.wraps(read)
    def reader(paths, columns=None):
        path = Path(paths["log"])
        try:
            return read(paths, columns)
        except pa.ArrowMemoryError as error:
            # a damaged file may announce any size
            why = f"the table does not fit the memory ({error}): save it anew"
            raise RejectedLog(why) from error
        except (ImuloopError, MemoryError):
            raise
        except ImportError as error:
            package = str(error.name).partition(".")[0]
            # an extra of the project is called as the format that needs it
            raise ImuloopError(
                f"format {form} needs the package {package}, which is not installed: pip "
                f"install '.[{form}]'"
            ) from error
        except Exception as error:
            why = cause(error).replace(str(path), "the file")
            raise RejectedLog(
                f"{path.name} is no whole file of the format {form} ({why}): copy it again, or "
                "save it anew"
            ) from error

    return reader
