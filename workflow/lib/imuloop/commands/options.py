"""Options of commands: keys of a config, such as ``--units.time ms``, and numbers with limits."""

import argparse
import math
import re
from functools import partial

import yaml

from imuloop.core.errors import ImuloopError
from imuloop.core.units import ACCELERATION, ANGULAR_RATE
from imuloop.declaration import KEYS
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
# options that several words KEY=VALUE may follow, with the start of the keys
SEVERAL = {"--set": "", "--columns": "columns.", "--counts": "nominal."}
# start of a word KEY=VALUE
KEY = rf"({'|'.join(KEYS)})\b[^=]*="
GRAVITY = {
    "gravity": "local gravity, m/s^2; default: {}",
    "gravity.latitude": "degrees: it is computed for a place",
    "gravity.height": "m above the ellipsoid, with the latitude",
}


def add_arguments(command, gravity=""):
    """Add the options of a log, and of gravity if `gravity`, the text on its default, is given."""
    group = command.add_argument_group(
        "keys as in a config",
        "columns by name or, in a log without header, by number from 0; several keys at once: "
        "--set units.time=ms rate=100, --columns time=stamp acceleration=-fx,fy,fz",
    )
    for key, words in (OF_LOG | (GRAVITY if gravity else {})).items():
        group.add_argument(
            f"--{key}",
            type=partial(read_value, key),
            default=argparse.SUPPRESS,
            metavar="VALUE",
            help=words.format(gravity),
        )
    group.add_argument(
        "--set",
        type=read_assignment,
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help=f"any key of {', '.join(KEYS)}",
    )


def expand_shorthands(words):
    """Return the words of a command line with shorthands written as keys of a config, a list.

    ``--set units.time=ms rate=100`` becomes ``--set=units.time=ms --set=rate=100``. ``--columns``
    gives keys that start with ``columns.``, and ``--time-unit ms`` becomes ``--units.time ms``.
    ``--range 16g,2000deg/s`` becomes a key for each sensor, and ``--counts
    acceleration=SCALE,OFFSET`` the unit, the scale and the offset of a count. Raises an
    ImuloopError for a shorthand that says nothing.
    """
    expanded, words = [], [*words]
    while words:
        name, equals, value = words.pop(0).partition("=")
        if name == "--range" and (equals or words):
            ranges = _ranges(value if equals else words.pop(0))
            expanded += [f"--set=range.{quantity}={size}" for quantity, size in ranges.items()]
        elif name in SEVERAL:
            start, assignments = SEVERAL[name], [value] if equals else []
            while words and re.match(KEY if name == "--set" else "[^-].*=", words[0]):
                assignments.append(words.pop(0))
            # without a word the option stays, and the parser refuses it
            options = [option for each in assignments for option in _expand(start, each)]
            expanded += options or [name]
        elif name.startswith("--columns.") and not equals and re.match("-[^-]", "".join(words[:1])):
            # a column whose sign is turned, as in -fx,fy,fz
            expanded.append(f"{name}={words.pop(0)}")
        else:
            expanded.append(SHORT.get(name, name) + equals + value)
    return expanded


def _expand(start, assignment):
    """Return the options, a list, of an assignment KEY=VALUE whose keys begin with `start`."""
    if start != "nominal.":
        return [f"--set={start}{assignment}"]
    quantity, _, values = assignment.partition("=")
    scale, _, offset = values.partition(",")
    options = [f"--set=units.{quantity}=count", f"--set=nominal.{quantity}.scale={scale}"]
    return options + ([f"--set=nominal.{quantity}.offset={offset}"] if offset else [])


def _ranges(text):
    """Return each range of an argument ``16 g,2000 deg/s`` by its quantity, which the unit tells.

    Raises an ImuloopError if a part has no such unit, or if two parts are of one quantity.
    """
    found, parts = {}, [part.strip() for part in text.split(",")]
    for part in parts:
        unit = part.lstrip("±.0123456789 ")
        for quantity, units in zip(PARTS, (ACCELERATION, ANGULAR_RATE), strict=True):
            if unit in units:
                found[quantity] = part
    if len(found) < len(parts):
        raise ImuloopError(f"--range: {text} is not RANGE,RANGE with units: 16 g,2000 deg/s")
    return found


def read_assignment(text):
    """Return the path of a key and its value, of an argument ``units.time=ms``."""
    key, equals, value = text.partition("=")
    if not equals or key.partition(".")[0] not in KEYS:
        raise argparse.ArgumentTypeError(f"{text} is not KEY=VALUE, KEY one of {', '.join(KEYS)}")
    return key, read_value(key, value)


def read_value(key, text):
    """Return the value of an option for a key: a number, null, a list or mapping, or text.

    Columns, whose ``key`` starts with ``columns.``, are separated by commas; a position is a number
    from 0, and a minus turns the sign of a column.
    """
    if text[:1] + text[-1:] in ("[]", "{}"):
        try:
            return yaml.safe_load(text)
        except yaml.YAMLError as error:
            raise argparse.ArgumentTypeError(f"{text} is not a list or mapping") from error
    if text == "null":
        return None
    if key.startswith("columns"):
        names = [name.strip() for name in text.split(",")]
        values = [int(name) if name.isdecimal() else name for name in names]
        return values if len(values) > 1 else values[0]
    try:
        number = float(text)
    except ValueError:
        return text
    if not math.isfinite(number):
        return text
    return int(text) if text.lstrip("-").isdecimal() else number


def declared_keys(arguments):
    """Return the keys of a device's entry in a config that the options give, nested dicts."""
    given = [(path, vars(arguments)[path]) for path in OF_LOG | GRAVITY if path in arguments]
    keys = {}
    for path, value in (*given, *vars(arguments).get("set", ())):
        # null says that a column is not there; another key with null is not given
        if value is None and not path.startswith("columns"):
            continue
        node, (*above, last) = keys, path.split(".")
        for depth, name in enumerate(above, 1):
            node = node.setdefault(name, {})
            if not isinstance(node, dict):
                raise ImuloopError(f"--{path}: --{'.'.join(above[:depth])} is given, too")
        node[last] = value
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
