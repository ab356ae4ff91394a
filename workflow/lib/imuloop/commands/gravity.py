"""Local gravity on the command line: its size, or the place that it is computed for."""

import argparse

from imuloop.commands.options import between
from imuloop.core.errors import ImuloopError
from imuloop.declaration import gravity_of
from imuloop.local_gravity import HEIGHTS, LATITUDES


def add_gravity(command, default):
    """Add the options of local gravity; `default` says which one is used without."""
    command.add_argument(
        "--gravity", type=_size, metavar="M/S^2", help=f"local gravity; default {default}"
    )
    command.add_argument(
        "--latitude",
        type=between(*LATITUDES),
        metavar="DEGREES",
        help="in place of --gravity: it is computed from latitude and height",
    )
    command.add_argument("--height", type=between(*HEIGHTS), metavar="M", help="with --latitude")


def _size(text):
    """Return local gravity, m/s^2, of an argument, if it is plausible."""
    try:
        return gravity_of(float(text))
    except ImuloopError as error:
        raise argparse.ArgumentTypeError(f"{error}: --latitude, --height") from error
    except ValueError as error:
        degrees, comma, _ = text.partition(",")
        meant = (
            f": {text.replace(',', '.')} m/s^2, or --latitude {degrees}?" if comma else ", m/s^2"
        )
        raise argparse.ArgumentTypeError(f"{text} is not a number{meant}") from error


def local_gravity(arguments, default):
    """Return local gravity, m/s^2, as the options give it, else the default."""
    place = {"latitude": arguments.latitude, "height": arguments.height}
    given = [f"--{name}" for name, value in place.items() if value is not None]
    if given and arguments.gravity is not None:
        raise ImuloopError(f"--gravity and {given[0]}: give the size of gravity or the place")
    if len(given) == 1:
        raise ImuloopError(f"{given[0]} alone gives no gravity: --latitude and --height do")
    if given:
        return gravity_of(place)
    return default if arguments.gravity is None else arguments.gravity


def gravity_line(gravity):
    """Return the gravity that a result rests on, m/s^2, in words."""
    return f"gravity {gravity:.6g} m/s²"
