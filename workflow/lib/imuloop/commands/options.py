"""The declaration of a log in a config, as options of a command."""

import argparse

import yaml

from imuloop.core.units import ACCELERATION, ANGULAR_RATE
from imuloop.declaration import KEYS
from imuloop.ingest.spellings import UNITS
from imuloop.sensors import PARTS

OF_UNIT = ("acceleration", "angular_rate", "time", "temperature")


def add_arguments(command):
    """Add the options that declare a log; `declared_keys` returns their values."""
    group = command.add_argument_group("what the log does not say itself")
    group.add_argument(
        "--set",
        nargs="+",
        type=assignment,
        default=[],
        metavar="KEY=VALUE",
        help=f"any key of {', '.join(KEYS)} as in the config: units.interval=ms, "
        "'columns.time=[sec, nsec]'; the options below are shorthands",
    )
    group.add_argument(
        "--columns",
        nargs="+",
        type=columns,
        default=[],
        metavar="QUANTITY=NAME",
        help="time=stamp acceleration=fx,fy,fz angular_rate=p,q,r temperature=T; -fx turns a sign; "
        "time=sec,nsec; time=null for none; time.acceleration=ta time.angular_rate=tg of two "
        "tables; a stream or variable that holds all three axes, acceleration=/imu_a; by number "
        "from 0 in a log without header",
    )
    for quantity in OF_UNIT:
        name = quantity.replace("_", "-")
        group.add_argument(f"--{name}-unit", metavar="UNIT", help=", ".join(UNITS[quantity]))
    group.add_argument(
        "--counts",
        nargs="+",
        type=counts,
        default=[],
        metavar="QUANTITY=SCALE,OFFSET",
        help="for acceleration and angular_rate: SI units per count, and the count at zero",
    )
    group.add_argument(
        "--sensor",
        metavar="NAME",
        help="a name that imuloop sensors lists: its data sheet gives counts, full scale, "
        "tolerances and noise",
    )
    group.add_argument(
        "--range",
        type=ranges,
        default={},
        metavar="RANGE,RANGE",
        help="full scales, if the sensor has several: '16 g,2000 deg/s'",
    )
    group.add_argument("--rate", type=float, metavar="HZ", help="of a log without a time column")
    group.add_argument("--format", help="default: from the file's name and first bytes")


def declared_keys(arguments):
    """Return the keys of a device's entry in a config that the options of a command give."""
    keys = {}
    for quantity, names in arguments.columns:
        put(keys, f"columns.{quantity}", names)
    for quantity, scale in arguments.counts:
        put(keys, f"units.{quantity}", "count")
        put(keys, f"nominal.{quantity}", scale)
    given = {f"units.{quantity}": getattr(arguments, f"{quantity}_unit") for quantity in OF_UNIT}
    given |= {key: getattr(arguments, key) for key in ("sensor", "range", "rate", "format")}
    for path, value in (*given.items(), *arguments.set):
        if value not in (None, {}):
            put(keys, path, value)
    return keys


def put(keys, path, value):
    """Put a value under a path of keys with dots, into nested dicts."""
    *above, last = path.split(".")
    for name in above:
        keys = keys.setdefault(name, {})
    keys[last] = value


def assignment(text):
    """Return the path of keys and the value, as in YAML, of an argument ``units.time=ms``."""
    path, equals, value = text.partition("=")
    try:
        value = yaml.safe_load(value)
    except yaml.YAMLError:
        equals = ""
    if not equals or path.partition(".")[0] not in KEYS:
        raise argparse.ArgumentTypeError(f"{text} is not KEY=VALUE, KEY one of {', '.join(KEYS)}")
    return path, value


def columns(text):
    """Return quantity and columns of an argument ``acceleration=fx,fy,fz``."""
    quantity, _, names = text.partition("=")
    found = [int(name) if name.isdecimal() else name for name in names.split(",")]
    if not all(map(str, found)):
        raise argparse.ArgumentTypeError(
            f"{text} is not QUANTITY=NAME, time=SECONDS,NANOSECONDS or acceleration=X,Y,Z"
        )
    return quantity, None if found == ["null"] else found if len(found) > 1 else found[0]


def counts(text):
    """Return quantity, scale and offset of an argument ``acceleration=0.0024,32768``."""
    quantity, _, values = text.partition("=")
    try:
        scale, offset = map(float, f"{values},0".split(",")[:2])
    except ValueError as error:
        what = "acceleration=SCALE,OFFSET (SI per count)"
        raise argparse.ArgumentTypeError(f"{text} is not {what}") from error
    return quantity, {"scale": scale, "offset": offset}


def ranges(text):
    """Return each range of an argument ``16 g,2000 deg/s`` by its quantity, known by the unit."""
    found = {}
    for part in text.split(","):
        unit = part.strip().lstrip("±.0123456789 ")
        for quantity, units in zip(PARTS, (ACCELERATION, ANGULAR_RATE), strict=True):
            if unit in units:
                found[quantity] = part.strip()
    if len(found) < len(text.split(",")):
        raise argparse.ArgumentTypeError(f"{text} is not RANGE,RANGE with units: 16 g,2000 deg/s")
    return found


def between(low, high, count=1):
    """Return a function that reads an argument: a number in a range, or several."""

    def number(text):
        """Return the number of an argument, or a tuple of `count` numbers."""
        values = [float(value) for value in text.split(",")]
        if len(values) != count or not all(low <= value <= high for value in values):
            what = f"{count} numbers" if count > 1 else "a number"
            raise argparse.ArgumentTypeError(f"{text} is not {what} from {low:g} to {high:g}")
        return tuple(values) if count > 1 else values[0]

    return number
