"""The program ``imuloop``: its commands, and one line for each error."""

import argparse
import io
import os
import sys
import tempfile
import traceback
from importlib import import_module

# matrices are small: threads would wait for each other, ten times as long next to other work
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from imuloop import __version__
from imuloop.commands.options import take_keys
from imuloop.core.errors import ImuloopError, one_line
from imuloop.declaration import check_declared
from imuloop.ingest.places import COMMAND_LINE, for_reader, read_in

# each is a module of imuloop.commands
COMMANDS = ("apply", "calibrate", "check", "coach", "info", "noise", "report", "sensors")


class Parser(argparse.ArgumentParser):
    """An argparse parser that reports an error in one line."""

    def error(self, message):
        """Print an error, `message`, in one line, and end with exit status 2."""
        self.exit(2, f"{self.prog}: {one_line(message)}; {self.prog} -h says more\n")


def run(argv=None):
    """Run one command; return its exit status, 0 for success, and 1 for an error in one line.

    A command may return other numbers. `argv` are the words of the command line, by default those
    of the process.
    """
    parser = Parser(
        prog="imuloop",
        description="Calibrate, check and describe accelerometers and gyroscopes.",
        epilog="imuloop COMMAND -h says more, with an example",
    )
    parser.add_argument("--version", action="version", version=f"imuloop {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    argv = sys.argv[1:] if argv is None else argv
    # only the command that is named is loaded, as the others use libraries that it may not need
    for name in argv[:1] if {*argv[:1]} & {*COMMANDS} else COMMANDS:
        module = import_module(f"imuloop.commands.{name}")
        # the docstring of a command's module is its help
        words, epilog = module.__doc__.split("\n\n", 1)
        command = commands.add_parser(
            name,
            help=words.partition(": ")[2].rstrip("."),
            epilog=epilog,
            usage="%(prog)s ARGUMENTS [OPTIONS]",
            # a key that is cut short is a mistake
            allow_abbrev=False,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        module.add(command)
        command.set_defaults(run=module.run)
    # the encoding of a file on Windows lacks some signs: print a question mark for each
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")
    status = 0
    try:
        try:
            with read_in(COMMAND_LINE):
                status = _status(_parse(parser, argv))
        finally:
            # a closed pipe shows here, not when Python ends; -h leaves by SystemExit
            sys.stdout.flush()
    except BrokenPipeError:
        # the reader of the lines, such as head, has enough of them
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return status


def _parse(parser, argv):
    """Return the arguments of a command, with the keys of a config in their field `declared`.

    `parser` is the parser of all commands, and `argv` are the words of the command line. The
    process ends with exit status 2 if an argument is wrong.
    """
    try:
        # the other commands read a log
        declared, words = ({}, argv) if argv[:1] == ["sensors"] else take_keys(argv)
        arguments = parser.parse_args(words)
        arguments.declared = check_declared(declared)
    except (ImuloopError, ModuleNotFoundError) as error:
        parser.error(str(error))
    return arguments


def _status(arguments):
    """Run a command; return its exit status, or 1 if it ended in an error, which is printed.

    `arguments` are its arguments, as `_parse` returns them.
    """
    try:
        return arguments.run(arguments) or 0
    except BrokenPipeError:
        raise
    except (ImuloopError, ModuleNotFoundError, OSError, MemoryError) as error:
        named = f"{error.filename}: {error.strerror}" if getattr(error, "filename", 0) else error
        line = for_reader(one_line(named)) or "not enough memory"
    except Exception as error:
        kept = {"prefix": "imuloop-", "suffix": ".log", "delete": False, "encoding": "utf-8"}
        with tempfile.NamedTemporaryFile("w", **kept) as log:
            traceback.print_exception(error, file=log)
        what = one_line(f"{type(error).__name__}: {error}")
        line = f"a bug of imuloop: {what}; please report it with its traceback, {log.name}"
    print(f"imuloop: {line}", file=sys.stderr)
    return 1
