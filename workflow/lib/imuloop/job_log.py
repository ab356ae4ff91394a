"""The log of a job: if it fails, a traceback goes to the log, and one line to the terminal."""

import logging
import sys
from pathlib import Path

from imuloop.core.errors import ImuloopError, one_line, printable

# reason of a job that Ctrl-C ended, or that did not start
INTERRUPTED = "the run stopped before this stage was done"


class Printable(logging.Formatter):
    """Formatter that removes control characters, which a terminal obeys, from log lines."""

    def format(self, record):
        """Return the text of `record`, a LogRecord, without control characters."""
        return printable(super().format(record))


def failure_line(error):
    """Return one line of text about an exception, `error`, for the user.

    The line is the text of the exception if this is an `ImuloopError` or an error of a file, of the
    machine or of a missing package. Other exceptions, such as errors of numerical libraries, are
    about the code: the line has only their type. After Ctrl-C the line says that the job was
    interrupted.
    """
    kind = type(error).__name__
    if isinstance(error, KeyboardInterrupt):
        return INTERRUPTED
    if isinstance(error, (ImuloopError, OSError, ImportError, MemoryError)):
        return one_line(error) or kind
    return f"an error in the code of imuloop ({kind})"


def open_log(path, job):
    """Send all log lines of a job, warnings and the traceback of a failure to a log file.

    `path` is the path of the file. When the job fails, the terminal gets one line that names `job`,
    a text with its stage and device.
    """
    logging.basicConfig(filename=path, filemode="w", level=logging.INFO, force=True)
    for handler in logging.getLogger().handlers:
        handler.setFormatter(Printable("%(asctime)s %(levelname)s %(message)s"))
    logging.captureWarnings(True)

    def fail(kind, error, traceback):
        """Log an exception, and show one line about it on the terminal.

        `kind` is its class, `error` the exception, and `traceback` its traceback.
        """
        logging.error("traceback", exc_info=(kind, error, traceback))
        line = failure_line(error)
        logging.critical(line)
        print(f"{job}: {line} (more in {path})", file=sys.__stderr__)

    sys.excepthook = fail


def last_words(path):
    """Return the reason at the end of the log file of a failed job, text; empty if there is none.

    `path` is the path of the log file, which may not exist.
    """
    if not Path(path).is_file():
        return ""
    lines = Path(path).read_text(encoding="utf-8", errors="replace").splitlines()
    return lines[-1].partition(f" {logging.getLevelName(logging.CRITICAL)} ")[2] if lines else ""


def say(line):
    """Write a line of text to the log file of the job and to the terminal."""
    logging.info(line)
    print(one_line(line), file=sys.__stderr__, flush=True)
