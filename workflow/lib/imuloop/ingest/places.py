"""Names of declarations in messages: as keys of a config, options, or Python arguments.

Code writes a key by its path in the config, with a value where there is one: ``columns.time``,
``units.acceleration: g``, ``rate in Hz``. `for_reader` turns that into ``--columns.time`` on the
command line and into ``columns={'time': …}`` in Python.
"""

import re
from contextlib import contextmanager
from contextvars import ContextVar

import yaml

from imuloop.core.units import ACCELERATION, ANGULAR_RATE, INCREMENTS, TEMPERATURE, TIME

CONFIG, COMMAND_LINE, PYTHON = "config", "command line", "Python"
_place = ContextVar("place", default=CONFIG)

# how a config declares a log in two files; `_PAIRS` has the same for other places
PAIR = "file: {acceleration: FILE, angular_rate: FILE}"
_PAIRS = {
    COMMAND_LINE: "acceleration=FILE,angular_rate=FILE",
    PYTHON: "{'acceleration': FILE, 'angular_rate': FILE}",
}
_units = {*TIME, *ACCELERATION, *ANGULAR_RATE, *TEMPERATURE, "count"}.union(*INCREMENTS.values())
_NUMBER = r"\d+(?:\.\d+)?(?:e[+-]?\d+)?"
_VALUE = "|".join((r"null", r"\[[^]]+\]", _NUMBER, *map(re.escape, sorted(_units))))
_QUANTITY = "acceleration|angular_rate|time|temperature|interval"
# the path of a key, with its value where there is one; or a key with any value
_KEY = re.compile(
    rf"(?<![\w.-])((?:columns|units|nominal|range)\.(?:{_QUANTITY})(?:\.\w+)*"
    rf"|rate(?= in Hz|: \d))(?:: ({_VALUE})(?![\w/^]))?|(?<![\w.])(format|prior): (?=[\w./])"
)
# a key by itself
_ALONE = re.compile(r"(?:rate|format|sensor|range|columns|units|nominal|gravity)(?:\.\w+)*")
# keys that only a config has
_NO_OPTION = re.compile(r"(?<![\w.])(?:time_range|full_scale)\b(?! \(only)")


@contextmanager
def read_in(place):
    """Within a ``with`` block, make messages name declarations as the user of `place` writes them.

    `place` is `COMMAND_LINE` or `PYTHON`, the place from which imuloop was called. In nested blocks
    the outermost place counts.
    """
    token = _place.set(place if _place.get() == CONFIG else _place.get())
    try:
        yield
    finally:
        _place.reset(token)


def in_config():
    """Return whether messages name declarations as keys of a config: outside of `read_in`."""
    return _place.get() == CONFIG


def for_reader(text):
    """Return a message, `text`, with its keys as the user writes them: keys, options, arguments.

    The block of `read_in` around the call decides. A message that already has this form does not
    change.
    """
    place = _place.get()
    if place == CONFIG:
        return text
    if place == COMMAND_LINE and _ALONE.fullmatch(text):
        return f"--{text}"
    named = {COMMAND_LINE: _option, PYTHON: _argument}[place]
    text = _KEY.sub(lambda key: named(*key.groups()), text.replace(PAIR, _PAIRS[place]))
    return _NO_OPTION.sub(r"\g<0> (only in a config)", text)


def _option(path, value, form):
    """Return the option of the command line for a key of the config, text.

    `path`, `value` and `form` are the groups of a match of `_KEY`: the path of the key and its
    value, or the name of a key with any value; a missing group is None.
    """
    value = (value or "").strip("[]").replace(", ", ",")
    return f"--{path} {value}".rstrip() if path else f"--{form} "


def _argument(path, value, form):
    """Return the Python argument for a key of the config, text.

    `path`, `value` and `form` are the groups of a match of `_KEY`: the path of the key and its
    value, or the name of a key with any value; a missing group is None.
    """
    key, *inside = (path or form).split(".")
    if form or not (inside or value):
        return f"{form}=" if form else key
    text = value or "…"
    if value and not re.fullmatch(_NUMBER, value):
        text = repr(yaml.safe_load(value))
    for name in reversed(inside):
        text = f"{{'{name}': {text}}}"
    return f"{key}={text}"
