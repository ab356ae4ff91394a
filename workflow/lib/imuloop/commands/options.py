"""Options of commands: keys of a config, such as ``--units.time ms``, and numbers with limits."""

import argparse
import json

from imuloop.core.errors import ImuloopError
from imuloop.core.units import ACCELERATION, ANGULAR_RATE
from imuloop.ingest.spellings import UNITS
from imuloop.sensors import PARTS

# words for the help on each key of a log and its sensor
OF_LOG = {
    "format": "default: from the file's name and first bytes",
    "rate": "Hz, of a log without a time column",
    "columns.time": "a column, or SECONDS,NANOSECONDS; null for none",
    **{f"columns.time.{quantity}": "of its own table" for quantity in PARTS},
    **{f"columns.{q}": "X,Y,Z (-X turns a sign) or a stream; null for none" for q in PARTS},
    "columns.temperature": "a column; null for none",
    "columns.interval": "a column with the interval of increments",
    **{f"units.{quantity}": ", ".join(units) for quantity, units in UNITS.items()},
    "sensor": "its data sheet gives counts, tolerances and noise; imuloop sensors lists the names",
    **{f"range.{q}": "full scale, if the sensor has several: '16 g', '2000 deg/s'" for q in PARTS},
    **{f"nominal.{quantity}.scale": "SI units per count" for quantity in PARTS},
    **{f"nominal.{quantity}.offset": "the count at zero" for quantity in PARTS},
}
# shorter names of options that have one value
SHORT = {f"--{quantity.replace('_', '-')}-unit": f"--units.{quantity}" for quantity in UNITS} | {
    "--latitude": "--gravity.latitude",
    "--height": "--gravity.height",
}
# options that are followed by several words KEY=VALUE, with the text that is put before each key
SEVERAL = {"--set": "", "--columns": "columns.", "--counts": "nominal."}
GRAVITY = {
    "gravity": "local gravity, m/s^2; default: {}",
    "gravity.latitude": "degrees: it is computed for a place",
    "gravity.height": "m above the ellipsoid, with the latitude",
}


def add_arguments(command, gravity=""):
    """Add the options of a log, and of gravity if `gravity`, the text on its default, is given."""
    group = command.add_argument_group(
        "keys as in a config", "columns by name or, in a log without header, by number from 0"
    )
    for key, words in (OF_LOG | (GRAVITY if gravity else {})).items():
        group.add_argument(
            f"--{key}",
            type=read_value,
            default=argparse.SUPPRESS,
            metavar="VALUE",
            help=words.format(gravity),
        )


def expand_shorthands(words):
    """Return the words of a command line with shorthands written as keys of a config, a list.

    ``--set units.time=ms rate=100`` becomes ``--units.time ms --rate 100``, and ``--time-unit ms``
    becomes ``--units.time ms``. ``--range 16g,2000deg/s`` becomes an option for each sensor.
    ``--counts acceleration=SCALE,OFFSET`` becomes three options: the unit ``count``, its scale and
    its offset.
    """
    expanded, start = [], None
    for word in words:
        key, equals, value = word.partition("=")
        if word in SEVERAL:
            start = SEVERAL[word]
        elif start == "nominal." and equals and not key.startswith("--"):
            scale, _, offset = value.partition(",")
            expanded += [f"--units.{key}", "count", f"--nominal.{key}.scale", scale]
            expanded += [f"--nominal.{key}.offset", offset] if offset else []
        elif start is not None and equals and not key.startswith("--"):
            expanded += [f"--{start}{key}={value}"]
        elif expanded and expanded[-1] == "--range":
            units = dict(zip(PARTS, (ACCELERATION, ANGULAR_RATE), strict=True))
            ranges = {
                quantity: part.strip()
                for part in word.split(",")
                for quantity in PARTS
                if part.strip().lstrip("±.0123456789 ") in units[quantity]
            }
            # a word that is not a range stays with the option, which the parser then refuses
            expanded = expanded[:-1] if ranges else expanded
            expanded += [w for q, size in ranges.items() for w in (f"--range.{q}", size)] or [word]
        else:
            start = None
            expanded.append(SHORT.get(key, key) + equals + value)
    return expanded


def read_value(text):
    """Return the value of an option.

    A text that is JSON gives its value. Another text gives a list if it has commas, else itself.
    """
    try:
        return json.loads(text)
    except ValueError:
        parts = text.strip("[] ").split(",")
        return [read_value(part.strip()) for part in parts] if len(parts) > 1 else text


def declared_keys(arguments):
    """Return the keys of a device that the options declare, nested dicts as in a config.

    Raises an ImuloopError if a key and a key inside it are both given.
    """
    keys = {}
    for path in OF_LOG | GRAVITY:
        if path not in arguments:
            continue
        node, (*above, last) = keys, path.split(".")
        for name in above:
            node = node.setdefault(name, {})
            if not isinstance(node, dict):
                raise ImuloopError(f"--{path}: the option above it, --{name}, is given, too")
        node[last] = vars(arguments)[path]
    return keys


def between(low, high, count=1):
    """Return a function that reads an argument of `count` numbers from `low` to `high`."""

    def number(text):
        """Return the number in an argument, or a tuple of `count` numbers if these are several."""
        values = [float(value) for value in text.split(",")]
        if len(values) != count or not all(low <= value <= high for value in values):
            what = f"{count} numbers" if count > 1 else "a number"
            raise argparse.ArgumentTypeError(f"{text} is not {what} from {low:g} to {high:g}")
        return tuple(values) if count > 1 else values[0]

    return number
