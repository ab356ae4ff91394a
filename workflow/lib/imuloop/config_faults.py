"""What is wrong in a config: every fault at once, one a line, each naming its key."""

import os
import re
from dataclasses import fields, is_dataclass
from datetime import datetime
from functools import partial
from itertools import product
from pathlib import Path
from typing import get_args, get_origin

import yaml
from pydantic import Tag, ValidationError

from imuloop.config import OF_LOGS, known_figures, merged_devices, without_dates
from imuloop.config_model import BRANCH, CALLED, Config
from imuloop.config_text import LOADER, key_lines, yaml_faults
from imuloop.core.errors import ImuloopError, nearest, one_line
from imuloop.core.units import needed_by_counts
from imuloop.file_faults import file_faults, path_fault, prior_fault
from imuloop.ingest.spellings import UNITS, is_iso, stated_unit
from imuloop.sensors import PARTS, find_sensor

# words for the expected kind of a value; all other kinds are a mapping of keys
_KINDS = {"float": "a number", "int": "a whole number", "string": "text", "null": "null"}
_KINDS |= {"list": "a list", "tuple": "a list", "finite_number": "a finite number"}
# words for a number outside of a limit, by the type of pydantic's error, and the limit's name there
_LIMITS = {
    "greater_than": ("less than or equal to the minimum of", "gt"),
    "greater_than_equal": ("less than the minimum of", "ge"),
    "less_than": ("greater than or equal to the maximum of", "lt"),
    "less_than_equal": ("greater than the maximum of", "le"),
}
# keys of a device that `_sensor_faults` looks at
OF_SENSOR = ("sensor", "range", "nominal")
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
    for check in (_model_faults, partial(_meaning_faults, replicas=replicas, wrong=found)):
        for key, fault in list(check(config)):
            # of the last file that holds the most of the key's path
            depths = {name: _depth(contents[name], key) for name in reversed(contents)}
            found.setdefault(key, (max(depths, key=depths.get, default="config"), fault))
    lines = []
    for key, (name, fault) in found.items():
        # a missing key: the line of the one that needs it
        above = (key[:depth] for depth in range(len(key), 0, -1))
        line = next((places[name][k] for k in above if k in places.get(name, ())), None)
        place = f"{name} line {line}" if line else name
        lines.append(one_line(f"{place}: {'.'.join(map(str, key))}: {fault}"))
    if mirror and not Path(mirror).is_dir():
        lines.append(f"IMULOOP_MIRROR: there is no folder {mirror}")
    return lines


def _depth(content, key):
    """Return the number of steps of a key's path that exist in a mapping."""
    for depth, part in enumerate(key):
        try:
            content = content[part]
        except (LookupError, TypeError):
            return depth
    return len(key)


def _model_faults(config):
    """Yield (key, text) for each way in which a config breaks the model."""
    effective = config
    if isinstance(config.get("devices"), dict) and isinstance(config.get("defaults", {}), dict):
        effective = {**config, "devices": merged_devices(config)}
    for key, text in _validation_faults(effective):
        yield _declared(config, key), text


def _validation_faults(config):
    """Yield (key, text) for each way in which a config without defaults breaks the model."""
    try:
        Config.model_validate(config)
    except ValidationError as error:
        for each in error.errors():
            # the branches of a type of several kinds are not keys
            key = tuple(part for part in each["loc"] if not _is_branch(part))
            if text := _text(each, key):
                yield key, text


def device_faults(name, device):
    """Yield (key, text) for the faults in the keys of a device without sessions."""
    log = {"kind": "static", "file": "log"}
    wrong = set()
    for key, text in _validation_faults({"devices": {name: device | {"sessions": {"log": log}}}}):
        wrong.add(key[2:3])
        yield key[2:] or ("name",), text
    if not wrong & {(key,) for key in OF_SENSOR}:
        yield from _sensor_faults(device)


def _declared(config, key):
    """Return where a key of a merged device was written: there, at its device, in the defaults."""
    if len(key) < 3 or key[0] != "devices" or _depth(config, key) == len(key):
        return key
    places = [("defaults", *key[2:])]
    if key[2] == "sessions" and key[4:5] and key[4] in OF_LOGS:
        places += [key[:2] + key[4:], ("defaults", *key[4:])]
    return next((place for place in places if _depth(config, place) == len(place)), key)


def _text(error, key):
    """Return one error of pydantic in words of a config; None where another error says it."""
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
        # of a tuple entries that are wrong are not counted
        enough = rule == "too_short" and len(value) >= length
        return None if enough else f"needs {length} entries, not {len(value)}"
    if rule == "string_too_long":
        return f"{shown} has more than {length} characters"
    return str(context["error"]) if "error" in context else f"{shown} is not {_kind(rule)}"


def _is_branch(part):
    """Return whether a part of a path in pydantic's error is a branch, not a key of the config."""
    return part == "[key]" or str(part).startswith(BRANCH)


def _kind(name):
    """Return words for the expected kind, by the type of pydantic's error or a type's branch."""
    return _KINDS.get(name.removeprefix(BRANCH).removesuffix("_type"), "a mapping of keys")


def _known_keys(path):
    """Return the keys that a config may have at a path of the model, branches included."""
    model = Config
    for part in path:
        if get_origin(model) in (dict, list):
            model = get_args(model)[-1]
        elif _is_branch(part):
            members = get_args(model)
            model = next(get_args(each)[0] for each in members if Tag(part) in each.__metadata__)
        else:
            model = model.model_fields[part].annotation
    if is_dataclass(model):
        return [field.name for field in fields(model)]
    return [*model.model_fields]


def _shown(value):
    text = repr(value)
    return text if len(text) < 80 else f"{text[:76]}…"


def _nearest_unit(name, known):
    """Return the unit that another spelling means; by similarity only a very close one."""
    # by similarity dps would be rad/s
    meant = "ISO 8601" if is_iso(name) else None
    for quantity, increments in product(UNITS, (True, False)):
        unit = stated_unit(quantity, name, increments)
        meant = meant or (unit if unit in known else None)
    return f"; did you mean '{meant}'?" if meant else nearest(name, known, 0.8)


def _meaning_faults(config, wrong, replicas):
    """Yield (key, text) for faults that a model cannot find, in keys that are not wrong yet."""
    wrong = {*wrong}
    mirror, cache = (
        ("" if (key,) in wrong else config.get(key, "")) for key in ("mirror", "cache")
    )
    if mirror and not os.path.isdir(mirror):
        yield ("mirror",), f"there is no folder {mirror}"
    if text := path_fault(cache):
        yield ("cache",), text
    elif os.path.exists(cache) and not os.path.isdir(cache):
        yield ("cache",), f"{cache} is a file, not a folder"
    if not isinstance(config.get("devices"), dict) or ("defaults",) in wrong:
        return
    merged = merged_devices(config)
    for name, device in merged.items():
        prior = device.get("prior") if isinstance(device, dict) else None
        if isinstance(prior, str) and (text := prior_fault(prior)):
            yield _declared(config, ("devices", name, "prior")), text
        if name in ("figures", "types"):
            text = f"'{name}' is reserved for results of several devices; name it otherwise"
            yield ("devices", name), text
        nominal = None
        places = {key[2:3] for key in wrong if key[:2] == ("devices", name)}
        places |= {key[1:2] for key in wrong if key[:1] == ("defaults",)}
        if isinstance(device, dict) and not places & {(key,) for key in OF_SENSOR}:
            faults = list(_sensor_faults(device))
            for key, text in faults:
                yield _declared(config, ("devices", name, *key)), text
            nominal = None if faults else known_figures(device)["nominal"]
        sessions = device.get("sessions") if isinstance(device, dict) else None
        for session, content in sessions.items() if isinstance(sessions, dict) else ():
            key = ("devices", name, "sessions", session)
            below = {bad[4:] for bad in wrong if bad[:4] == key}
            below |= {bad[3:] for bad in wrong if bad[:3] == ("defaults", *key[2:])}
            below |= {(k,) for k in OF_LOGS if {("devices", name, k), ("defaults", k)} & wrong}
            if () in below:
                continue
            # one wrong unit leaves the others to be judged
            bad = {part[: 2 if part[0] == "units" else 1] for part in below}
            sound = {part: value for part, value in content.items() if (part,) not in bad}
            if "units" in sound:
                units = sound["units"].items()
                sound["units"] = {q: unit for q, unit in units if ("units", q) not in bad}
            faults = [*_missing_keys(session, content)]
            faults += _session_faults(session, sound, nominal, replicas)
            for part, text in faults:
                yield _declared(config, (*key, *part)), text


def _sensor_faults(device):
    """Yield (key below the device, text) for its sensor, ranges and scales of counts."""
    sensor, ranges = device.get("sensor"), device.get("range") or {}
    if sensor is None and ranges:
        yield ("range",), "needs the device's sensor"
    elif sensor is not None:
        try:
            sheet = find_sensor(sensor)
        except ImuloopError as error:
            yield ("sensor",), str(error)
            return
        for quantity, wanted in ranges.items():
            try:
                sheet.choose_range(quantity, wanted)
            except ImuloopError as error:
                yield ("range", quantity), str(error)
    for quantity, counts in (device.get("nominal") or {}).items():
        if sensor is None and "offset" in counts and "scale" not in counts:
            yield ("nominal", quantity, "scale"), "missing; offset needs it"


def _missing_keys(name, session):
    """Yield (key below the session, text) for keys that a session needs because of its others."""
    needed = ["reference"] if session.get("kind") == "reference_motion" else []
    if session.get("kind") == "known_rotation" and "sections" not in session:
        needed = ["axis", "angle"]
    for key in needed:
        if key not in session:
            yield (key,), f"missing; {name} needs it"
    sections = session.get("sections")
    for at, section in enumerate(sections if isinstance(sections, list) else ()):
        if isinstance(section, dict) and not {"angle", "rate"} & {*section}:
            yield ("sections", at, "angle"), "missing; give an angle or a rate"


def _session_faults(name, session, nominal, replicas):
    """Yield (key below the session, text) for the sound keys of a session.

    `nominal` are the device's scales of counts, None where they are faulty.
    """
    if name == "exports":
        yield (), "'exports' is reserved for a folder of results; name the session otherwise"
    for quantity in PARTS if nominal is not None else ():
        scales = nominal.get(quantity, {})
        if session.get("units", {}).get(quantity) == "count" and "scale" not in scales:
            needed = needed_by_counts(quantity, scales)
            yield ("units", quantity), f"'count' needs the device's {needed}"
    if "time_range" in session and (text := _time_range_fault(session["time_range"])):
        yield ("time_range",), text
    if "reference" in session and session.get("kind") != "reference_motion":
        yield ("reference",), "only a session of kind reference_motion has one"
    marks = session.get("pps") or {}
    for key in {"counter", "time"} - {*marks} if marks and "file" not in marks else ():
        yield ("pps", key), "missing; marks are two columns of the log, or a file"
    for owner in ((), ("pps",), ("reference",)):
        file = (session.get(owner[0]) or {} if owner else session).get("file")
        for key, text in file_faults(file, replicas, folder=not owner) if file else ():
            yield (*owner, "file", *key), text


def _time_range_fault(limits):
    """Return the fault of a time range, or None."""
    try:
        start, end = (datetime.fromisoformat(x) if isinstance(x, str) else x for x in limits)
    except ValueError as error:
        return f"not ISO 8601: {error}"
    if start is None or end is None:
        return None
    dates = [x for x in (start, end) if isinstance(x, datetime)]
    if len(dates) == 1:
        return "start and end must both be seconds or both be ISO 8601"
    if dates and (start.tzinfo is None) != (end.tzinfo is None):
        return "start and end must both name their time zone, or neither"
    return None if start < end else "the start is not before the end"
