"""The log of one job: a traceback goes there, one line goes to the terminal."""

import logging
import sys

from imuloop.core.errors import one_line


def open_log(path, job):
    """Send all that a job logs, warnings and a last traceback to its log file.

    Parameters
    ----------
    path : path-like
        Log file.
    job : str
        Stage and device, named in the one line that the terminal gets when the job fails.
    """
    logging.basicConfig(
        filename=path,
        filemode="w",
        level=logging.INFO,
        format="%(asctime)s %(levelname)s %(message)s",
        force=True,
    )
    logging.captureWarnings(True)

    def fail(kind, error, traceback):
        logging.critical("failed", exc_info=(kind, error, traceback))
        line = one_line(error) or kind.__name__
        print(f"{job}: {line} (more in {path})", file=sys.__stderr__)

    sys.excepthook = fail
