"""Declarations of a device without a config, which the model of a config checks, too."""

from collections.abc import Mapping
from numbers import Real

from imuloop.core.errors import ImuloopError, nearest
from imuloop.core.files import plain
from imuloop.ingest.places import for_reader
from imuloop.local_gravity import HEIGHTS, LATITUDES, STRONGEST, WEAKEST, normal_gravity

# keys of a device about its logs and its sensor
KEYS = ("format", "columns", "units", "rate", "sensor", "range", "nominal")


def check_declared(keys, name="device", settings=None):
    """Return declared keys as plain data; raise an ImuloopError for the first fault in them.

    Parameters
    ----------
    keys : mapping
        Keys of a device in a config, such as ``units``; None for a key that is not given.
    name : str, optional
        Name of the device.
    settings : mapping, optional
        Settings of the stages by their name.
    """
    declared = {key: plain(value) for key, value in keys.items() if value is not None}
    if not (declared or settings or name != "device"):
        # nothing is declared: the model, which takes long to import, is not needed
        return declared
    from imuloop.config import STAGES
    from imuloop.config_faults import device_faults

    if not isinstance(settings or {}, Mapping):
        raise ImuloopError(f"settings: {settings!r} is not a mapping")
    stages = plain(dict(settings or {}))
    for stage in {*stages} - {*STAGES}:
        raise ImuloopError(f"settings: '{stage}' is not a stage{nearest(str(stage), STAGES)}")
    for key, text in device_faults(name, declared | stages):
        path = for_reader(".".join(map(str, ("settings", *key) if key[0] in STAGES else key)))
        raise ImuloopError(f"{path}: {for_reader(text)}")
    return declared


def gravity_of(gravity):
    """Return local gravity, m/s^2; `gravity` is a number or ``{"latitude": …, "height": …}``.

    Raises an ImuloopError for a value out of its limits.
    """
    place = isinstance(gravity, Mapping)
    limits = {"latitude": LATITUDES, "height": HEIGHTS} if place else {"": (WEAKEST, STRONGEST)}
    values = gravity if place else {"": gravity}
    if {*values} != {*limits} or not all(
        isinstance(values[name], Real) and low <= values[name] <= high
        for name, (low, high) in limits.items()
    ):
        raise ImuloopError(
            f"gravity: {gravity!r} is neither {WEAKEST:g} to {STRONGEST:g} m/s^2 nor a place with "
            "latitude, degrees, and height, m"
        )
    return normal_gravity(**gravity) if place else float(gravity)
