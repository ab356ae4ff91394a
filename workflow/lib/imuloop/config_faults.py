"""The faults of a config, all at once: a line each, with file, line and key."""

import re
from dataclasses import fields, is_dataclass
from itertools import product
from pathlib import Path
from typing import get_args, get_origin

import yaml
from pydantic import Tag, ValidationError

from imuloop.config import OF_LOGS, merged_devices, without_dates
from imuloop.config_keys import BRANCH, is_branch
from imuloop.config_model import CALLED, Config
from imuloop.config_text import LOADER, key_lines, yaml_faults
from imuloop.core.errors import nearest, one_line
from imuloop.ingest.spellings import UNITS, is_iso, stated_unit

# words for an expected value, by a type of pydantic's errors; all others expect a mapping of keys
_KINDS = {"float": "a number", "int": "a whole number", "string": "text", "null": "null"}
_KINDS |= {"list": "a list", "tuple": "a list", "finite_number": "a finite number"}
# words for a number outside of a limit, by the type of pydantic's error, and the limit's name there
_LIMITS = {
    "greater_than": ("less than or equal to the minimum of", "gt"),
    "greater_than_equal": ("less than the minimum of", "ge"),
    "less_than": ("greater than or equal to the maximum of", "lt"),
    "less_than_equal": ("greater than the maximum of", "le"),
}
_CHOICES = {"kind": "kind of session", "gyroscope_bias": "source of the bias"}


def config_faults(config, files, replicas, mirror=None):
    """Return the faults of a config, one line each; an empty list for a sound config.

    ``config.yaml line 9: devices.my_imu.sessions.poses.units.time: 'sec' is not a unit; …``

    Parameters
    ----------
    config : dict
        The config as Snakemake merged it.
    files : dict of str to path-like
        The files that it came from, by the name that a fault shall show.
    replicas : dict of str to list of str
        Sessions of each simulated device that the workflow can make.
    mirror : str, optional
        Folder named by the environment variable IMULOOP_MIRROR.
    """
    config, contents, places, found = without_dates(config), {}, {}, {}
    for name, path in files.items():
        text = Path(path).read_text(encoding="utf-8")
        contents[name] = without_dates(yaml.load(text, LOADER)) or {}
        places[name] = key_lines(text)
        found |= {key: (name, fault) for key, fault in yaml_faults(text)}
    for key, fault in _model_faults(config, replicas):
        # the fault is in the file that holds the longest part of the key's path, the last such one
        depths = {name: _depth(contents[name], key) for name in reversed(contents)}
        found.setdefault(key, (max(depths, key=depths.get, default="config"), fault))
    lines = []
    for key, (name, fault) in found.items():
        # if a key is missing, the line is that of the mapping that needs it
        above = (key[:depth] for depth in range(len(key), 0, -1))
        line = next((places[name][k] for k in above if k in places.get(name, ())), None)
        place = f"{name} line {line}" if line else name
        lines.append(one_line(f"{place}: {'.'.join(map(str, key))}: {fault}"))
    if mirror and not Path(mirror).is_dir():
        lines.append(f"IMULOOP_MIRROR: there is no folder {mirror}")
    return lines


def _depth(content, key):
    """Return the number of parts of a key, from the first on, that exist in nested mappings."""
    for depth, part in enumerate(key):
        try:
            content = content[part]
        except (LookupError, TypeError):
            return depth
    return len(key)


def _model_faults(config, replicas):
    """Yield (key, text) for each fault that the model finds, with the key where it was written."""
    merged = config
    if isinstance(config.get("devices"), dict) and isinstance(config.get("defaults", {}), dict):
        merged = {**config, "devices": merged_devices(config)}
    for key, text in _validation_faults(merged, context={"replicas": replicas}):
        yield _where_written(config, key), text


def _validation_faults(config, context=None):
    """Yield (key, text) for each fault of a config whose devices hold the defaults already."""
    try:
        Config.model_validate(config, context=context)
    except ValidationError as error:
        for each in error.errors():
            # pydantic also names the alternative of a value with several types, which is not a key
            key = tuple(part for part in each["loc"] if not is_branch(part))
            if text := _describe(each, key):
                yield key, text


def device_faults(name, device):
    """Yield (key, text) for each fault of the keys of a device without sessions.

    `name` is the name of the device, and `device` a dict; a session is added for the check.
    """
    log = {"kind": "static", "file": "log"}
    for key, text in _validation_faults({"devices": {name: device | {"sessions": {"log": log}}}}):
        # the key without "devices" and the name; a fault of the name itself has no more parts
        yield key[2:] or ("name",), text


def _where_written(config, key):
    """Return the key in the config at which a key of a device with its defaults was written.

    The key may be written there, at the device of a session, or in the defaults.
    """
    if len(key) < 3 or key[0] != "devices" or _depth(config, key) == len(key):
        return key
    places = [("defaults", *key[2:])]
    if key[2] == "sessions" and key[4:5] and key[4] in OF_LOGS:
        places += [key[:2] + key[4:], ("defaults", *key[4:])]
    return next((place for place in places if _depth(config, place) == len(place)), key)


def _describe(error, key):
    """Return an error of pydantic for a key as text in words of a config.

    The result is None if another error says the same.
    """
    rule, value, context = error["type"], error["input"], error.get("ctx", {})
    shown, length = _shown(value), context.get("min_length", context.get("max_length"))
    if rule in ("extra_forbidden", "unexpected_keyword_argument"):
        return f"unknown key{nearest(key[-1], _known_keys(error['loc'][:-1]), 0.6)}"
    if rule == "missing":
        return f"missing; {key[-2] if key[1:] else 'the config'} needs it"
    if value is None:
        return "nothing is given"
    if rule == "literal_error":
        known = re.findall("'(.*?)'", context["expected"])
        if "units" in key:
            return f"{shown} is not a unit{_nearest_unit(str(value), known)}"
        name = _CHOICES.get(key[-1], key[-1])
        return f"{shown} is not a {name}{nearest(str(value), known, 0.4)}"
    if rule == "string_pattern_mismatch":
        return f"{shown} is not a {CALLED[context['pattern']]}"
    if rule in _LIMITS:
        words, limit = _LIMITS[rule]
        return f"{shown} is {words} {context[limit]:g}"
    if rule == "union_tag_invalid":
        tags = re.findall("'(.*?)'", context["expected_tags"])
        return f"{shown} is not {' or '.join(dict.fromkeys(map(_kind, tags)))}"
    if rule == "string_too_short" or (rule == "too_short" and isinstance(value, dict)):
        return "empty"
    if rule in ("too_short", "too_long"):
        # pydantic does not count wrong entries of a tuple, which have errors of their own
        enough = rule == "too_short" and len(value) >= length
        return None if enough else f"needs {length} entries, not {len(value)}"
    if rule == "string_too_long":
        return f"{shown} has more than {length} characters"
    return str(context["error"]) if "error" in context else f"{shown} is not {_kind(rule)}"


def _kind(name):
    """Return in words what was expected, such as "a number".

    `name` is the type of an error of pydantic, or the name of a branch, which is an alternative of
    a value that may have several types.
    """
    return _KINDS.get(name.removeprefix(BRANCH).removesuffix("_type"), "a mapping of keys")


def _known_keys(path):
    """Return the keys that a config may have at a path in an error of pydantic, a list.

    The path has keys, and branches: alternatives of a value that may have several types.
    """
    model = Config
    for part in path:
        if get_origin(model) in (dict, list):
            model = get_args(model)[-1]
        elif is_branch(part):
            members = get_args(model)
            model = next(get_args(each)[0] for each in members if Tag(part) in each.__metadata__)
        else:
            model = model.model_fields[part].annotation
    if is_dataclass(model):
        return [field.name for field in fields(model)]
    return [*model.model_fields]


def _shown(value):
    """Return a value as text of at most 80 characters."""
    text = repr(value)
    return text if len(text) < 80 else f"{text[:76]}…"


def _nearest_unit(name, known):
    """Return the end of a message that names the unit that `name` means, or the nearest one.

    `known` are the names of the possible units.
    """
    # the unit that `name` spells in another way comes first: by similarity, dps would be rad/s
    meant = "ISO 8601" if is_iso(name) else None
    for quantity, increments in product(UNITS, (True, False)):
        unit = stated_unit(quantity, name, increments)
        meant = meant or (unit if unit in known else None)
    return f"; did you mean '{meant}'?" if meant else nearest(name, known, 0.8)
