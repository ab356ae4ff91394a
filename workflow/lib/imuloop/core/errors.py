"""Errors that a user can act on."""

import difflib


class ImuloopError(Exception):
    """A fault of a declaration or an input, which the user can correct; its text is one line."""


class ImuloopWarning(UserWarning):
    """A fact about a log that the user should look at; the run continues."""


class Lacking(ImuloopError):
    """A log lacks data that were declared or are needed."""


class MachineFault(ImuloopError):
    """The machine lacks a resource, such as room on the disk: the run stops."""


class RejectedLog(ImuloopError):
    """The data of a session are unusable: the session is left out, and the run continues."""


def printable(text):
    """Return a text with a question mark for each control character that is not a line end.

    `text` is a text, or another object, which is converted to a text.
    """
    return "".join(c if c.isprintable() or c == "\n" else "?" for c in str(text))


def one_line(text):
    """Return a text on one line without control characters.

    So a text from a log cannot disturb a terminal. `text` is a text or an exception. For a
    ModuleNotFoundError, the line ends with the command that installs the missing package.
    """
    command = "; pip install '.[all]'" if isinstance(text, ModuleNotFoundError) else ""
    return printable(" ".join(str(text).split())) + command


def plural(count, noun, ending="s"):
    """Return a number with its noun, such as ``3 poses``.

    `count` is the number, `noun` the noun in singular, and `ending` is appended to it unless the
    number is 1.
    """
    return f"{count} {noun}{'' if count == 1 else ending}"


def joined(words):
    """Return a list of words as text for a sentence, such as ``a, b and c``; empty without words.

    `words` is the list.
    """
    *first, last = words or [""]
    return f"{', '.join(first)} and {last}" if first else last


def did_you_mean(name, names, cutoff=0.6):
    """Return the end of a message that names the known name nearest to an unknown one.

    An example is ``; did you mean 'ax'?``. `name` is the unknown name, and `names` are the known
    ones. The result is an empty text if no name has at least the similarity `cutoff`, 0 to 1, as
    `difflib` computes it.
    """
    near = difflib.get_close_matches(name, list(names), n=1, cutoff=cutoff)
    return f"; did you mean '{near[0]}'?" if near else ""


def nearest(name, names, cutoff=0.6):
    """Return the end of a message that names the nearest known name, or all known names.

    `name` is an unknown name, and `names` are the known ones. They are all named if no name is
    near. A name is near if it has at least the similarity `cutoff`, 0 to 1, as `difflib` computes
    it.
    """
    return did_you_mean(name, names, cutoff) or f"; use one of {', '.join(names)}"
