"""The command line: ``python -m imuloop COMMAND``, and ``imuloop COMMAND`` where installed.

Modules that take time to load are loaded in `main`, which handles Ctrl-C.
"""

import os
import signal
import sys

# exit status of a command that Ctrl-C ended, by the convention of shells
INTERRUPTED = 130


def main(argv=None):
    """Run one command of imuloop; return the exit status.

    The status is 0 for success, 1 after an error that is shown in one line, 130 after Ctrl-C, or
    another number that the command returns. `argv` are the words of the command line, by default
    those of the process.
    """
    before = signal.signal(signal.SIGINT, _leave)
    try:
        from imuloop.commands.program import run
    finally:
        signal.signal(signal.SIGINT, before)
    try:
        return run(argv)
    except KeyboardInterrupt:
        print("imuloop: interrupted", file=sys.stderr)
        return INTERRUPTED


def _leave(*_):
    """End the process at once on Ctrl-C, with a line on the terminal; the arguments are not used.

    Libraries that are being loaded would hide a KeyboardInterrupt.
    """
    os.write(2, b"imuloop: interrupted\n")
    os._exit(INTERRUPTED)


if __name__ == "__main__":
    sys.exit(main())
