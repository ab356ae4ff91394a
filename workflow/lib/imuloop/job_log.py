"""The log of one job: a traceback goes there, one line goes to the terminal."""

import atexit
import gc
import logging
import sys
import time

from imuloop.core.errors import one_line, printable
from imuloop.without_pandas import hide_pandas

FORMAT = "%(asctime)s %(levelname)s %(message)s"


class Printable(logging.Formatter):
    """Lines, tracebacks too, without what a terminal would obey that shows the log."""

    def format(self, record):
        """Return the text of a record."""
        return printable(super().format(record))


def open_log(path, job):
    """Begin a job: send all that it logs, warnings and a last traceback to its log file.

    Parameters
    ----------
    path : path-like
        Log file.
    job : str
        Stage and device, named in the one line that the terminal gets when the job fails.
    """
    hide_pandas()
    # after one large block glibc keeps what is freed, and arrays come back without page faults
    bytes(32_000_000)
    # the thousands of objects of modules end with the process, none gone through for circles
    atexit.register(gc.freeze)
    logging.basicConfig(
        filename=path,
        filemode="w",
        level=logging.INFO,
        force=True,
    )
    for handler in logging.getLogger().handlers:
        handler.setFormatter(Printable(FORMAT))
    logging.captureWarnings(True)

    def fail(kind, error, traceback):
        logging.critical("failed", exc_info=(kind, error, traceback))
        line = one_line(error) or kind.__name__
        print(f"{job}: {line} (more in {path})", file=sys.__stderr__)

    sys.excepthook = fail


def tell(line):
    """Say a line in the job's log and on the terminal."""
    logging.info(line)
    print(one_line(line), file=sys.__stderr__, flush=True)


def tell_failures(device, failures):
    """Say what went wrong in a stage of a device, which the report names first."""
    for failure in failures:
        tell(f"{device}: {failure}; the traceback is in {failure.log}")


def teller(job, seconds=10.0, clock=time.monotonic):
    """Return ``progress(what, done, total)``, in bytes, that tells how far a job is.

    Each line goes to the job's log and to the terminal:
    ``imu/still: read 3.2 of 10.0 GB, 104 MB/s, 65 s left``.

    Parameters
    ----------
    job : str
        What the lines begin with.
    seconds : float
        From line to line, and to the first one: what is short is not told.
    clock : callable
        The time now, s.
    """
    begun, last = {}, clock()

    def progress(what, done, total):
        nonlocal last
        now = clock()
        begin = begun.setdefault(what, now)
        if now - max(begin, last) < seconds or not done:
            return
        last, rate = now, done / (now - begin)
        line = f"{job}: {what} {done / 1e9:.1f} of {total / 1e9:.1f} GB, {rate / 1e6:.0f} MB/s"
        line += f", {(total - done) / rate:.0f} s left"
        tell(line)

    return progress
