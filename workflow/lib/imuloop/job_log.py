"""The log of one job: a traceback goes there, one line goes to the terminal."""

import logging
import sys

from imuloop.core.errors import failure_line, one_line, printable


class Printable(logging.Formatter):
    """Lines, tracebacks too, without what a terminal would obey that shows the log."""

    def format(self, record):
        """Return the text of a record."""
        return printable(super().format(record))


def open_log(path, job):
    """Begin a job: send all that it logs, warnings and a last traceback to its log file.

    `job`, stage and device, is named in the one line that the terminal gets when the job fails.
    """
    logging.basicConfig(filename=path, filemode="w", level=logging.INFO, force=True)
    for handler in logging.getLogger().handlers:
        handler.setFormatter(Printable("%(asctime)s %(levelname)s %(message)s"))
    logging.captureWarnings(True)

    def fail(kind, error, traceback):
        logging.critical("failed", exc_info=(kind, error, traceback))
        print(f"{job}: {failure_line(error)} (more in {path})", file=sys.__stderr__)

    sys.excepthook = fail


def run_stage(stage, device, *arguments):
    """Run a stage, a function of `imuloop.chain`, as a job; say what failed. Return its failures.

    The device has a log; `arguments` are those of the stage after the device.
    """
    open_log(device.log, f"{stage.__name__} {device.name}")
    failures = stage(device, *arguments)
    for failure in failures:
        say(f"{device.name}: {failure}; the traceback is in {failure.log}")
    return failures


def say(line):
    """Write a line to the job's log and to the terminal."""
    logging.info(line)
    print(one_line(line), file=sys.__stderr__, flush=True)
