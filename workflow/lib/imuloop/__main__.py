"""The command line: ``python -m imuloop COMMAND``, and ``imuloop COMMAND`` where installed.

What takes time to load is loaded in `main`, where Ctrl-C is expected.
"""

import os
import signal
import sys

# exit status of a command that Ctrl-C ended, as shells have it
INTERRUPTED = 130


def main(argv=None):
    """Run one command; return the exit status.

    0, 1 for an error in one line, 130 after Ctrl-C, or the command's.
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
    """End at once, as libraries that are being loaded hide a KeyboardInterrupt."""
    os.write(2, b"imuloop: interrupted\n")
    os._exit(INTERRUPTED)


if __name__ == "__main__":
    sys.exit(main())
