"""``imuloop coach``: guide a recording.

For example:
  imuloop coach poses.csv
  cat /dev/ttyACM0 | imuloop coach - --units.acceleration g --units.angular_rate deg/s

Follows a log that grows, or lines on standard input. Prints the poses so far, how well the
parameters are known and what to do next, until every parameter is as good as asked for. Exit
status: 0 done, 3 the log ended before that, 1 error, 2 usage.
"""

import shutil
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

from imuloop.calibrate.sessions import raw_units
from imuloop.commands.lines import say
from imuloop.commands.logs import Log, write_samples
from imuloop.commands.options import add_keys, between
from imuloop.config import known_figures
from imuloop.core.errors import ImuloopError, plural
from imuloop.core.samples import read_samples
from imuloop.plan.coach import progress, rest_noise
from imuloop.report.numbers import number

# exit status if the session ended too early
EARLY = 3


def add(command):
    """Add the arguments of ``imuloop coach`` to `command`, its argparse parser."""
    command.add_argument(
        "log", type=Log.parse, help="multi_position log that grows, or - for stdin"
    )
    command.add_argument(
        "--within",
        type=between(1e-4, 10),
        default=0.2,
        metavar="%",
        help="standard error to reach for scale factors and misalignments; default 0.2 percent",
    )
    command.add_argument(
        "--every", type=between(0.01, 60), default=2.0, metavar="S", help="time between looks"
    )
    command.add_argument(
        "--patience",
        type=between(0.1, 1e5),
        default=60.0,
        metavar="S",
        help="end when the log has not grown for this time; default 60",
    )
    add_keys(command)


def run(arguments):
    """Follow a log until every parameter is good enough or the log ends; return the exit status.

    `arguments` are those that `add` declares, parsed.
    """
    with tempfile.TemporaryDirectory(prefix="imuloop-") as folder:
        log = arguments.log
        if str(log) == "-":
            log = Log.parse(f"{folder}/input.csv")
            [path] = log.paths
            path.touch()
            # a buffered stream would be locked by the thread when the program ends
            source = sys.stdin.buffer.raw
            threading.Thread(target=_copy, args=(source, path), daemon=True).start()
        log.refuse_no_log()
        return follow(log, arguments, Path(folder) / "samples")


def _copy(source, target):
    """Copy a binary stream, `source`, into a file, `target`, until it ends, without buffering."""
    with open(target, "wb", buffering=0) as file:
        shutil.copyfileobj(source, file, 1 << 12)


def follow(log, arguments, folder):
    """Print, while a log grows, how well it determines the parameters, and the next step.

    A line is printed when the number of poses or the next step has changed. `log` is the Log,
    `arguments` are the arguments of the command, parsed, and `folder` is a folder for the samples.
    Returns the exit status: 0 when every parameter is good enough, `EARLY` if the log stops growing
    before. Raises an ImuloopError if the log cannot be used.
    """
    size, said, noise, why = -1, None, None, ""
    gravity = known_figures(arguments.declared)["gravity"]
    say(f"gravity {gravity:.6g} m/s²")
    grown = time.monotonic()
    while True:
        now = sum(path.stat().st_size for path in log.paths)
        if now != size:
            size, grown = now, time.monotonic()
            path, quality = write_samples(log, arguments.declared, folder)
            why = "; ".join(quality["reasons"])
            if not why:
                samples = read_samples(path)
                units = raw_units({"": {"kind": "multi_position", "samples": path}})
                state = progress(samples, gravity, units, noise, arguments.within / 100)
                if state.done and noise is None:
                    # slow noise makes a session look worse than its samples do
                    noise = rest_noise(samples)
                    state = progress(samples, gravity, units, noise, arguments.within / 100)
                if (len(state.up), state.advice) != said:
                    say(line(state))
                    said = len(state.up), state.advice
                if state.done:
                    return 0
        elif time.monotonic() - grown > arguments.patience:
            if why:
                raise ImuloopError(f"{log}: {why}")
            say("the log ended before every parameter was as good as asked for")
            return EARLY
        time.sleep(arguments.every)


def line(state):
    """Return the state of a recording as a line of text; `state` is a Progress."""
    errors = [f"{s} {number(100 * x, 2)} %" for s, x in state.worst.items() if np.isfinite(x)]
    text = f"{state.duration_s / 60:.1f} min, {plural(len(state.up), 'pose')}"
    text += f"; scale factor and misalignment good to: {', '.join(errors)}" if errors else ""
    if state.done:
        return f"{text}. Done."
    return f"{text}. Next: {state.advice}."
