"""Errors that a user can act on."""

import difflib


class ImuloopError(Exception):
    """A fault of a declaration or an input; its text is one line, without a traceback."""


class ImuloopWarning(UserWarning):
    """A fact about a log that the user should look at; the run continues."""


class Lacking(ImuloopError):
    """A log lacks data that were declared or are needed."""


class MachineFault(ImuloopError):
    """The machine lacks a resource, above all room on the disk: the run stops."""


class RejectedLog(ImuloopError):
    """The data of a session are unusable: the session is rejected, the run continues."""


def printable(text):
    """Return `text`, which may come from a log, without control characters but line ends."""
    return "".join(c if c.isprintable() or c == "\n" else "?" for c in str(text))


def one_line(text):
    """Return `text`, which may come from a log, on one line without control characters.

    `text` may be an exception. For a ModuleNotFoundError, the line ends with the command that
    installs the package.
    """
    command = "; pip install '.[all]'" if isinstance(text, ModuleNotFoundError) else ""
    return printable(" ".join(str(text).split())) + command


def plural(count, noun, ending="s"):
    """Return a count with its noun, such as ``3 poses``; one has no ending."""
    return f"{count} {noun}{'' if count == 1 else ending}"


def joined(words):
    """Return words as a list in a sentence: a, b and c."""
    *first, last = words or [""]
    return f"{', '.join(first)} and {last}" if first else last


def did_you_mean(name, known, cutoff=0.6):
    """Return the end of a message that names the nearest of the known names.

    It is empty if no name is near. The cutoff is the least similarity, 0 to 1, as `difflib` counts
    it.
    """
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=cutoff)
    return f"; did you mean '{near[0]}'?" if near else ""


def nearest(name, known, cutoff=0.6):
    """Return the end of a message that names the nearest of the known names, or all of them.

    A name is near from the similarity `cutoff` on, 0 to 1, as `difflib` counts it.
    """
    return did_you_mean(name, known, cutoff) or f"; use one of {', '.join(known)}"
