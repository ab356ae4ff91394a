"""The faults of a config, all at once: a line each, with file, line and key."""

import re
from dataclasses import fields
from itertools import product
from pathlib import Path

from pydantic import ValidationError

from imuloop.config import OF_LOGS, merged_devices, without_dates
from imuloop.config_keys import BRANCH, is_branch
from imuloop.config_model import Config, Device
from imuloop.config_text import read_keys
from imuloop.core.errors import nearest, one_line
from imuloop.ingest.spellings import UNITS, is_iso, stated_unit


def config_faults(config, files, replicas, mirror=None):
    """Return the faults of a config, a list with a line for each; empty for a config without fault.

    A line is such as ``config.yaml line 9: devices.imu.units.time: 'sec' is not a unit; …``

    Parameters
    ----------
    config : dict
        The config as Snakemake merged it.
    files : dict of str to path-like
        Paths of the files that the config came from, by the name that a message shows.
    replicas : dict of str to list of str
        Names of the sessions of each replica, a simulated device that the workflow can make.
    mirror : str, optional
        Folder of copies of downloads, named by the environment variable IMULOOP_MIRROR.
    """
    config, lines, faults = without_dates(config), {}, {}
    for name, path in files.items():
        of_keys, of_text = read_keys(Path(path).read_text(encoding="utf-8"))
        # if several files have a key, the last one counts
        lines |= {key: f"{name} line {line}" for key, line in of_keys.items()}
        faults |= of_text
    merged = config
    if isinstance(config.get("devices"), dict) and isinstance(config.get("defaults", {}), dict):
        merged = {**config, "devices": merged_devices(config)}
    for key, text in _validation_faults(merged, context={"replicas": replicas}):
        faults.setdefault(_where_written(lines, key), text)
    whole = next(iter(files), "config")
    # the line of a missing key is the line of the mapping that needs it
    above = {key: [key[:depth] for depth in range(len(key), 0, -1)] for key in faults}
    places = {key: next((lines[k] for k in above[key] if k in lines), whole) for key in faults}
    messages = [f"{places[key]}: {'.'.join(map(str, key))}: {text}" for key, text in faults.items()]
    if mirror and not Path(mirror).is_dir():
        messages.append(f"IMULOOP_MIRROR: there is no folder {mirror}")
    return [*map(one_line, messages)]


def _validation_faults(config, context=None):
    """Yield (key, text) for each fault of a config whose devices already have the defaults.

    `config` is this config. The key is a tuple of the names that lead to the value with the fault.
    `context` is None if the files that the config names are not checked. If they have to exist, it
    is ``{"replicas": …}``, with the simulated devices of `config_faults`, whose files a job will
    make.
    """
    try:
        Config.model_validate(config, context=context)
    except ValidationError as error:
        for fault in error.errors():
            # pydantic also names the alternative of a value with several types, which is not a key
            key = tuple(part for part in fault["loc"] if not is_branch(part))
            yield key, _describe(fault, key)


def device_faults(name, device):
    """Yield (key, text) for each fault of a device that is declared without a config.

    `name` is the name of the device, and `device` has its keys, a dict without sessions. The key is
    a tuple of the names that lead to the value with the fault.
    """
    log = {"kind": "static", "file": "log"}
    for key, text in _validation_faults({"devices": {name: device | {"sessions": {"log": log}}}}):
        # the key without "devices" and the name; a fault of the name itself has no more parts
        yield key[2:] or ("name",), text


def _where_written(written, key):
    """Return the key under which the user wrote the value of `key`, a key of a merged config.

    In a merged config each session has the keys of its device and of the defaults. So the value may
    be written under the key itself, a key of the device, or a key of the defaults. `written` are
    all keys of the config before the merge. Keys are tuples of names.
    """
    if key in written or len(key) < 3 or key[0] != "devices":
        return key
    places = [("defaults", *key[2:])]
    if key[2] == "sessions" and key[4:5] and key[4] in OF_LOGS:
        places += [key[:2] + key[4:], ("defaults", *key[4:])]
    return next((place for place in places if place in written), key)


def _describe(error, key):
    """Return the text of a fault in a config.

    `error` is an error of pydantic about the value of `key`, a tuple of the names that lead to it.
    """
    rule, value, context = error["type"], error["input"], error.get("ctx", {})
    shown = repr(value) if len(repr(value)) < 80 else f"{repr(value)[:76]}…"
    if rule == "unexpected_keyword_argument":
        names = [field.name for field in fields(Device.model_fields[key[-2]].annotation)]
        return f"unknown key{nearest(key[-1], names)}"
    if rule == "missing":
        return "missing"
    if value is None:
        return "nothing is given"
    if rule == "literal_error":
        names = re.findall("'(.*?)'", context["expected"])
        if "units" in key:
            return f"{shown} is not a unit{_nearest_unit(str(value), names)}"
        return f"{shown} is not a {key[-1]}{nearest(str(value), names, 0.4)}"
    if rule == "union_tag_invalid":
        return f"{shown} is none of {context['expected_tags'].replace(BRANCH, '')}"
    if "error" in context:
        return str(context["error"])
    words = re.sub("a (valid )?dictionary.*", "a mapping of keys", error["msg"])
    return f"{shown} {re.sub('^.*?(?=should)', '', words)}"


def _nearest_unit(name, units):
    """Return the end of a message on an unknown unit: "; did you mean …?".

    `name` is the unknown unit, and `units` are the possible ones. The text names the unit that
    `name` is another spelling of, or else the most similar one; it is empty if none is similar.
    """
    # the unit that `name` spells in another way comes first: by similarity, dps would be rad/s
    meant = "ISO 8601" if is_iso(name) else None
    for quantity, increments in product(UNITS, (True, False)):
        unit = stated_unit(quantity, name, increments)
        meant = meant or (unit if unit in units else None)
    return f"; did you mean '{meant}'?" if meant else nearest(name, units, 0.8)
