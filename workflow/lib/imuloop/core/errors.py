"""Errors that a user can act on."""

import difflib


class ImuloopError(Exception):
    """What the user declared or gave cannot be used; one line, no traceback needed."""


class ImuloopWarning(UserWarning):
    """Something in a log that the user should look at; the work goes on."""


class Lacking(ImuloopError):
    """A log does not hold what was declared or is needed."""


class MachineFault(ImuloopError):
    """The machine lacks what a run needs, above all room on the disk: the run stops."""


class RejectedLog(ImuloopError):
    """What is wrong lies in the data: the session is rejected, the run goes on."""


def printable(text):
    """Return `text` without terminal control characters, lines kept: it may come from a log."""
    return "".join(c if c.isprintable() or c == "\n" else "?" for c in str(text))


def one_line(text):
    """Return `text` on one line, without terminal control characters: it may come from a log.

    Of a package that is not installed, with what installs it.
    """
    cure = "; pip install '.[all]'" if isinstance(text, ModuleNotFoundError) else ""
    return printable(" ".join(str(text).split())) + cure


def failure_line(error):
    """Return one line for the user about an exception; its traceback belongs into a log.

    The text of an `ImuloopError`, or of a file, a machine or a package that is missing. The text of
    any other exception, as those of numerical libraries, is about code and not shown.
    """
    kind = type(error).__name__
    if isinstance(error, (ImuloopError, OSError, ImportError, MemoryError)):
        return one_line(error) or kind
    return f"an error in the code of imuloop ({kind})"


def plural(count, noun, ending="s"):
    """Return a count with its noun."""
    return f"{count} {noun}{'' if count == 1 else ending}"


def joined(words):
    """Return words as a list in a sentence: a, b and c."""
    *first, last = words or [""]
    return f"{', '.join(first)} and {last}" if first else last


def did_you_mean(name, known, cutoff=0.6):
    """Return the end of a message that names the nearest of the known names; empty without one.

    The cutoff is the least similarity, 0 to 1, as `difflib` counts it.
    """
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=cutoff)
    return f"; did you mean '{near[0]}'?" if near else ""


def nearest(name, known, cutoff=0.6):
    """Return the end of a message that names the nearest of the known names, or all of them."""
    return did_you_mean(name, known, cutoff) or f"; use one of {', '.join(known)}"
