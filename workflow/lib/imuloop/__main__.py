"""The command line: ``python -m imuloop COMMAND``, and ``imuloop COMMAND`` where installed."""

import argparse
import io
import os
import sys

# matrices are small: threads would wait for each other, ten times as long beside other work
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from imuloop import __version__
from imuloop.commands import apply, calibrate, check, coach, info, noise, propose, report
from imuloop.core.errors import ImuloopError, one_line

COMMANDS = (apply, calibrate, check, coach, info, noise, propose, report)


class Parser(argparse.ArgumentParser):
    """A parser that says what is wrong in one line."""

    def error(self, message):
        """End with exit status 2."""
        self.exit(2, f"{self.prog}: {one_line(message)}; {self.prog} -h says more\n")


def main(argv=None):
    """Run one command; return the exit status: 0, 1 for an error in one line, or the command's."""
    parser = Parser(
        prog="imuloop",
        description="Calibrate, check and describe accelerometers and gyroscopes.",
        epilog="imuloop COMMAND -h says more, with an example",
    )
    parser.add_argument("--version", action="version", version=f"imuloop {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for each in COMMANDS:
        each.add(commands, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments = parser.parse_args(argv)
    # a file's encoding on Windows lacks signs: a question mark for each
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")
    try:
        return arguments.run(arguments) or 0
    except BrokenPipeError:
        # whoever reads the lines has enough of them
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (ImuloopError, ModuleNotFoundError, OSError) as error:
        named = f"{error.filename}: {error.strerror}" if getattr(error, "filename", 0) else error
        print(f"imuloop: {one_line(named)}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
