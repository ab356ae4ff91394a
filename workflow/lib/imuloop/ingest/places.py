"""Names of the keys of a log in messages: as keys of a config, options, or Python arguments.

Code writes a key by its path in the config, with a value where there is one: ``columns.time``,
``units.acceleration: g``, ``rate in Hz``. `for_reader` turns that into ``--columns time=…`` on the
command line and into ``columns={'time': …}`` in Python.
"""

import re
from contextlib import contextmanager
from contextvars import ContextVar

from imuloop.core.units import ACCELERATION, ANGULAR_RATE, INCREMENTS, TEMPERATURE, TIME

CONFIG, COMMAND_LINE, PYTHON = "config", "command line", "Python"
_place = ContextVar("place", default=CONFIG)

# both files of a log in two files
PAIR = "file: {acceleration: FILE, angular_rate: FILE}"
_PAIRS = {
    COMMAND_LINE: "acceleration=FILE,angular_rate=FILE",
    PYTHON: "{'acceleration': FILE, 'angular_rate': FILE}",
}
_units = {*TIME, *ACCELERATION, *ANGULAR_RATE, *TEMPERATURE, "count"}.union(*INCREMENTS.values())
_VALUE = "|".join(
    (r"null", r"\[[^]]+\]", r"\d+(?:\.\d+)?(?:e[+-]?\d+)?", *map(re.escape, sorted(_units)))
)
_QUANTITY = "acceleration|angular_rate|time|temperature|interval"
_KEY = re.compile(
    rf"(?<![\w.-])(?:(columns|units|nominal|range)\.({_QUANTITY})((?:\.\w+)*)"
    r"|(rate)(?= in Hz|: \d))"
    rf"(?:: ({_VALUE})(?![\w/^]))?|(?<![\w.])(format|prior): (?=[\w./])"
)
# a key by itself that is none of those, and its option
_ALONE = re.compile(r"(rate|format|sensor|range|columns|units|nominal)(?:\.(\w+))?")
_OPTIONS = {"columns": "--columns ", "nominal": "--counts "}
# keys that only a config has
_NO_OPTION = re.compile(r"(?<![\w.])(?:time_range|full_scale)\b(?! \(only)")


@contextmanager
def read_in(place):
    """Use the names of a place, `COMMAND_LINE` or `PYTHON`, in messages of the block.

    In nested blocks the outermost place counts.
    """
    token = _place.set(place if _place.get() == CONFIG else _place.get())
    try:
        yield
    finally:
        _place.reset(token)


def in_config():
    """Return whether messages are about a config."""
    return _place.get() == CONFIG


def for_reader(text):
    """Return a message with its keys in the form that the user writes in the current place.

    A message that already has this form does not change.
    """
    if in_config():
        return text
    place = _place.get()
    named = {COMMAND_LINE: _option, PYTHON: _argument}[place]
    if place == COMMAND_LINE and (key := _ALONE.fullmatch(text)) and not _KEY.fullmatch(text):
        name, part = key.groups()
        return f"{_OPTIONS.get(name, f'--set {name}.')}{part}" if part else f"--{name}"
    text = text.replace(PAIR, _PAIRS[place])
    text = _KEY.sub(lambda found: named(*found.groups()), text)
    return _NO_OPTION.sub(r"\g<0> (only in a config)", text)


def _option(key, quantity, part, rate, value, form):
    """Return the option of the command line for the groups of a match of `_KEY`, text."""
    if form:
        return f"--{form} "
    if rate:
        return f"--rate {value}" if value else "--rate"
    if key == "units":
        option = f"--{quantity.replace('_', '-')}-unit"
        return f"{option} {value}" if value else option
    if key == "range":
        return "--range"
    if key == "columns":
        quantity += part
    option = {"columns": "--columns", "nominal": "--counts"}[key]
    return f"{option} {quantity}={re.sub(', ', ',', value.strip('[]')) if value else '…'}"


def _argument(key, quantity, part, rate, value, form):
    """Return the Python argument for the groups of a match of `_KEY`, text."""
    if form:
        return f"{form}="
    if value is None or re.fullmatch(r"[\d.e+-]+", value):
        value = value or "…"
    elif value.startswith("["):
        value = str(value[1:-1].split(", "))
    else:
        value = {"null": "None"}.get(value, repr(value))
    if rate:
        return "rate" if value == "…" else f"rate={value}"
    for name in reversed([quantity, *part.split(".")[1:]]):
        value = f"{{'{name}': {value}}}"
    return f"{key}={value}"
