"""Options of commands: keys of a config, such as ``--units.time ms``, and numbers with limits."""

import argparse
import json
import re

from imuloop.commands.lines import aligned
from imuloop.core.errors import ImuloopError
from imuloop.core.units import ACCELERATION, ANGULAR_RATE, STANDARD_GRAVITY
from imuloop.declaration import KEYS
from imuloop.ingest.spellings import UNITS
from imuloop.sensors import PARTS

# words for the help on each key of a log and its sensor
HELP = {
    "format": "default: from the file's name and first bytes",
    "rate": "Hz, of a log without a time column",
    "columns.time": "a column, or SECONDS,NANOSECONDS; null for none",
    "columns.time.SENSOR": "of its own table",
    "columns.SENSOR": "X,Y,Z (-X turns a sign) or a stream; null for none",
    "columns.temperature": "a column; null for none",
    "columns.interval": "a column with the interval of increments",
    **{f"units.{quantity}": ", ".join(units) for quantity, units in UNITS.items()},
    "sensor": "its data sheet gives counts, tolerances and noise; imuloop sensors lists the names",
    "range.SENSOR": "full scale, if the sensor has several: '16 g', '2000 deg/s'",
    "nominal.SENSOR.scale": "SI units per count",
    "nominal.SENSOR.offset": "the count at zero",
    "gravity": f"local gravity, m/s^2; default: that of the calibration, or {STANDARD_GRAVITY}",
    "gravity.latitude": "degrees: gravity is computed for a place",
    "gravity.height": "m above the ellipsoid, with the latitude",
}
# a key of a config, as units.time
KEY = rf"(?:{'|'.join(KEYS)})(?:\.\w+)*"
# keys whose value is a mapping, which an option does not give; apply has an option --nominal
MAPPINGS = ("columns", "units", "range", "nominal")
# shorter names of options
SHORT = {f"--{quantity.replace('_', '-')}-unit": f"--units.{quantity}" for quantity in UNITS} | {
    "--latitude": "--gravity.latitude",
    "--height": "--gravity.height",
}
# options that several words KEY=VALUE may follow, with the start of the keys
SEVERAL = {"--set": "", "--columns": "columns.", "--counts": "nominal."}


def add_keys(command):
    """Add to the help of a command the options that are keys of a config, which `take_keys` reads.

    `command` is the argparse parser of the command.
    """
    rows = [(f"--{key} VALUE", words) for key, words in HELP.items()]
    command.add_argument_group(
        "keys as in a config",
        "\n".join(
            (
                "columns by name or, in a log without header, by number from 0; SENSOR is",
                "acceleration or angular_rate; several keys at once: --set units.time=ms rate=100",
                *aligned(rows),
            )
        ),
    )


def take_keys(words):
    """Return two results on a command line: its keys of a config, and all of its other words.

    The keys are nested dicts, the other words a list. `words` are the words of the command line. A
    key is an option, as ``--units.time ms``, or a word ``units.time=ms`` after ``--set``. Shorter
    forms are ``--time-unit ms``, ``--latitude`` and ``--height``, ``--columns time=stamp``,
    ``--range 16g,2000deg/s`` and ``--counts acceleration=SCALE,OFFSET``. Raises an ImuloopError for
    an option without a value, or a key that is given in two ways.
    """
    pairs, others, words = [], [], [*words]
    while words:
        name, equals, text = words.pop(0).partition("=")
        name = SHORT.get(name, name)
        path = name.removeprefix("--")
        if name in SEVERAL:
            start, several = SEVERAL[name], [text] if equals else []
            more = r"[\w.]+=" if start else f"{KEY}="
            while words and re.match(more if several else "[^-]", words[0]):
                several.append(words.pop(0))
            pairs += [pair for word in several for pair in _expand(start, word)]
            # the parser refuses an option without a word
            others += [] if several else [name]
        elif name == "--range" and (equals or words):
            pairs += _ranges(text if equals else words.pop(0))
        elif name != path and re.fullmatch(KEY, path) and path not in MAPPINGS:
            if not equals and (not words or re.fullmatch("--.*|-[a-z]", words[0])):
                raise ImuloopError(f"argument {name}: expected one argument")
            # the value may begin with a minus, which turns the sign of a column
            pairs.append(f"{path}={text if equals else words.pop(0)}")
        else:
            others.append(name + equals + text)
    return _nested(pairs), others


def _expand(start, word):
    """Return words KEY=VALUE with full keys, a list, for a word after an option of `SEVERAL`.

    `word` is the word, and `start` is the start of the keys of this option: ``x=1`` with the start
    ``columns.`` is ``columns.x=1``. With the start ``nominal.`` a word such as
    ``acceleration=0.01,5`` gives three words: that the unit is ``count``, that the scale is 0.01,
    and that the offset is 5. Raises an ImuloopError for a word that is not KEY=VALUE.
    """
    quantity, equals, value = word.partition("=")
    if not (equals and re.fullmatch(KEY, start + quantity)):
        raise ImuloopError(f"{start}{word} is not KEY=VALUE, KEY one of {', '.join(KEYS)}")
    if start != "nominal.":
        return [start + word]
    # a scale, or a scale and an offset
    values = zip(("scale", "offset"), value.split(","), strict=False)
    return [f"units.{quantity}=count", *(f"nominal.{quantity}.{n}={x}" for n, x in values)]


def _ranges(text):
    """Return words KEY=VALUE, a list, for the value of --range, such as ``16 g,2000 deg/s``.

    `text` is the value. The unit of each part between commas shows which sensor it is for. Raises
    an ImuloopError if a part has no unit of a sensor.
    """
    pairs, parts = [], [part.strip() for part in text.split(",")]
    for quantity, units in zip(PARTS, (ACCELERATION, ANGULAR_RATE), strict=True):
        ranges = [part for part in parts if part.lstrip("±.0123456789 ") in units]
        pairs += [f"range.{quantity}={part}" for part in ranges]
    if len(pairs) < len(parts):
        raise ImuloopError(f"--range: {text} is not RANGE,RANGE with units: 16 g,2000 deg/s")
    return pairs


def _nested(pairs):
    """Return words KEY=VALUE, `pairs`, as nested dicts: units.time=ms is {"units": {"time": "ms"}}.

    Raises an ImuloopError for a key that is given in two ways.
    """
    keys = {}
    for pair in pairs:
        path, _, text = pair.partition("=")
        node, (*above, last) = keys, path.split(".")
        for depth, name in enumerate(above, 1):
            node = node.setdefault(name, {})
            if not isinstance(node, dict):
                raise ImuloopError(f"--{path}: --{'.'.join(above[:depth])} is given, too")
        node[last] = read_value(path, text)
    return keys


def read_value(path, text):
    """Return the value of a key of a config from its text on the command line.

    `path` is the key, such as ``columns.time``, and `text` its value: JSON, or columns separated by
    commas, or any other text. A column is a name, or a position from 0.
    """
    try:
        return json.loads(text)
    except ValueError:
        if not path.startswith("columns") or "," not in text:
            return text
    names = [name.strip() for name in text.strip("[]").split(",")]
    return [int(name) if name.isdecimal() else name for name in names]


def between(low, high, count=1):
    """Return a function that reads an argument of `count` numbers, each from `low` to `high`."""

    def number(text):
        """Return the number in an argument, or a tuple of `count` numbers if `count` is above 1.

        `text` is the argument. Raises an ArgumentTypeError if it has more or fewer numbers, or one
        that is not from `low` to `high`.
        """
        values = [float(value) for value in text.split(",")]
        if len(values) != count or not all(low <= value <= high for value in values):
            what = f"{count} numbers" if count > 1 else "a number"
            raise argparse.ArgumentTypeError(f"{text} is not {what} from {low:g} to {high:g}")
        return tuple(values) if count > 1 else values[0]

    return number
