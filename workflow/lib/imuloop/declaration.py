"""Declarations about a device without a config: options of a command, or Python arguments."""

from collections.abc import Mapping

from imuloop.config import STAGES
from imuloop.core.errors import ImuloopError, nearest
from imuloop.core.files import plain
from imuloop.ingest.places import for_reader

# keys of a device about its logs, its sensor and its place
KEYS = ("format", "columns", "units", "rate", "sensor", "range", "nominal", "gravity")


def check_declared(keys, name="device", settings=None):
    """Return declared keys as plain data; raise an ImuloopError for the first fault in them.

    The keys are checked by the rules for a config.

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
    if not isinstance(settings or {}, Mapping):
        raise ImuloopError(f"settings: {settings!r} is not a mapping")
    stages = plain(dict(settings or {}))
    if not declared and not stages and name == "device":
        # a small installation lacks pydantic, with which the models are written
        return declared
    from imuloop.config_faults import device_faults

    for stage in {*stages} - {*STAGES}:
        raise ImuloopError(f"settings: '{stage}' is not a stage{nearest(str(stage), STAGES)}")
    for key, text in device_faults(name, declared | stages):
        path = for_reader(".".join(map(str, ("settings", *key) if key[0] in STAGES else key)))
        raise ImuloopError(f"{path}: {for_reader(text)}")
    return declared
