"""What is wrong in a config: every fault at once, one a line, each naming its key."""

import math
import os
from datetime import datetime
from itertools import product
from pathlib import Path

import yaml
from jsonschema import Draft202012Validator

from imuloop.config import OF_LOGS, merged_devices, without_dates
from imuloop.core.errors import nearest, one_line
from imuloop.file_faults import file_faults, marks_faults, path_fault, reference_faults
from imuloop.ingest.spellings import UNITS, stated_unit
from imuloop.ingest.stamps import is_iso
from imuloop.yaml_traps import yaml_faults

# a config of a thousand devices holds fewer
MOST_VALUES = 100_000
_TYPES = {
    "number": "a number",
    "integer": "a whole number",
    "string": "text",
    "object": "a mapping of keys",
    "array": "a list",
    "null": "null",
}


def config_faults(config, files, schema, replicas, mirror=None):
    """Return the faults of a config, one line each; empty if there is none.

    ``config.yaml: devices.my_imu.sessions.poses.units.time: 'sec' is not a unit; …``

    Parameters
    ----------
    config : dict
        The config as Snakemake merged it.
    files : dict of str to path-like
        The files that it came from, by the name that a fault shall show.
    schema : path-like
        The config's JSON schema (YAML).
    replicas : dict of str to list of str
        Sessions of each simulated device that the workflow can make.
    mirror : str, optional
        Folder named by the environment variable IMULOOP_MIRROR.
    """
    config, contents, found = without_dates(config), {}, {}
    for name, path in files.items():
        text = Path(path).read_text(encoding="utf-8")
        contents[name] = without_dates(yaml.safe_load(text)) or {}
        found |= {key: (name, fault) for key, fault in yaml_faults(text)}
    checks = (
        _unusable,
        lambda config: _schema_faults(config, yaml.safe_load(Path(schema).read_text("utf-8"))),
        lambda config: _meaning_faults(config, set(found), replicas),
    )
    for check in checks:
        for key, fault in list(check(config)):
            # of the last file that holds the most of the key's path
            depths = {name: _depth(contents[name], key) for name in reversed(contents)}
            found.setdefault(key, (max(depths, key=depths.get, default="config"), fault))
    lines = [
        one_line(f"{name}: {'.'.join(map(str, key))}: {fault}")
        for key, (name, fault) in found.items()
    ]
    if mirror and not Path(mirror).is_dir():
        lines.append(f"IMULOOP_MIRROR: there is no folder {mirror}")
    return lines


def unreadable(path):
    """Return why a file holds no config at all, in one line that names it; None if it does."""
    try:
        content = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        return f"{path}: there is no such file here; write one, or name one with --configfile"
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        return one_line(f"{path}: {where}no YAML: {getattr(error, 'problem', None) or error}")
    except Exception as error:
        # a text that is no UTF-8; a date, a number, a truth value that is none
        return one_line(f"{path}: cannot be read: {error}")
    if not isinstance(content, dict):
        kind = "empty" if content is None else "not a mapping of keys"
        return f"{path}: {kind}; it needs devices"
    if _holds_more(content, MOST_VALUES):
        return f"{path}: more than {MOST_VALUES} values, aliases (*name) written out"
    return None


def _holds_more(content, most):
    """Return whether there are more values than so many; in what holds itself there are."""
    left = [content]
    while left and most:
        value, most = left.pop(), most - 1
        if isinstance(value, (dict, list)):
            left += value.values() if isinstance(value, dict) else value
    return bool(left)


def shown_path(path):
    """Return a config file's path from here where that is shorter."""
    return min(os.path.relpath(path), str(path), key=len)


def _unusable(value, key=()):
    """Yield (key, text) for each number and text of a config that is none to what comes after."""
    if isinstance(value, (dict, list)):
        for name, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _unusable(item, (*key, name))
    elif isinstance(value, str):
        if any("\ud800" <= c <= "\udfff" for c in value):
            yield key, f"{_shown(ascii(value))} holds half of a character, which is no Unicode"
        elif "\0" in value:
            yield key, f"{_shown(repr(value))} holds a zero byte"
        elif key[-1:] == ("label",) and not value.isprintable():
            yield key, f"{_shown(ascii(value))} holds what cannot be printed"
    elif isinstance(value, (int, float)):
        try:
            fits = math.isfinite(value)
        except OverflowError:
            fits = False
        if not fits:
            yield key, f"{_shown(repr(value))} is no finite number of double precision"


def _depth(content, key):
    """Return how many steps of a key's path exist in a mapping."""
    for depth, part in enumerate(key):
        try:
            content = content[part]
        except (LookupError, TypeError):
            return depth
    return len(key)


def _schema_faults(config, schema):
    """Yield (key, text) for each way in which a config breaks the schema."""
    effective = config
    devices, defaults = config.get("devices"), config.get("defaults", {})
    if isinstance(devices, dict) and isinstance(defaults, dict):
        effective = {**config, "devices": merged_devices(config)}
    for error in Draft202012Validator(schema).iter_errors(effective):
        for key, text in _texts(error):
            yield _declared(config, key), text


def _declared(config, key):
    """Return where a key of a merged device was written: there, at its device, in the defaults."""
    if len(key) < 3 or key[0] != "devices" or _depth(config, key) == len(key):
        return key
    places = [("defaults", *key[2:])]
    if key[2] == "sessions" and key[4:5] and key[4] in OF_LOGS:
        places += [key[:2] + key[4:], ("defaults", *key[4:])]
    return next((place for place in places if _depth(config, place) == len(place)), key)


def _texts(error):
    """Yield (key, text) of one error of the validator."""
    key, value, rule = tuple(error.absolute_path), error.instance, error.validator
    title, needed = error.schema.get("title", ""), error.validator_value
    shown = _shown(repr(value))
    if rule == "additionalProperties":
        known = error.schema.get("properties", {})
        for name in (name for name in value if name not in known):
            yield (*key, name), f"unknown key{nearest(name, known, 0.6)}"
    elif rule == "required":
        for name in (name for name in needed if name not in value):
            yield (*key, name), f"missing; {key[-1] if key else 'the config'} needs it"
    elif rule in ("enum", "type") and value is None:
        yield key, "nothing is given"
    elif rule == "enum":
        near = _nearest_unit if title == "unit" else nearest
        yield key, f"{shown} is not a {title}{near(str(value), needed, 0.4)}"
    elif rule == "type":
        kinds = [needed] if isinstance(needed, str) else needed
        yield key, f"{shown} is not {' or '.join(_TYPES[kind] for kind in kinds)}"
    elif rule == "pattern":
        of_name = "propertyNames" in error.absolute_schema_path
        yield (*key, value) if of_name else key, f"{shown} is not a {title}"
    elif rule in ("minProperties", "minLength"):
        yield key, "empty"
    elif rule == "uniqueItems":
        yield key, f"{shown} names a column twice"
    elif rule in ("minItems", "maxItems"):
        yield key, f"{len(value)} entries, {needed} needed"
    else:
        yield key, error.message.replace(repr(value), shown)


def _shown(text):
    return text if len(text) < 80 else f"{text[:76]}…"


def _nearest_unit(name, known, cutoff):
    """Return the unit that another spelling means; by similarity only what is hardly another."""
    # by similarity dps would be rad/s
    meant = "ISO 8601" if is_iso(name) else None
    for quantity, increments in product(UNITS, (True, False)):
        unit = stated_unit(quantity, name, increments)
        meant = meant or (unit if unit in known else None)
    return f"; did you mean '{meant}'?" if meant else nearest(name, known, 2 * cutoff)


def _meaning_faults(config, wrong, replicas):
    """Yield (key, text) for what a schema cannot say, of everything that is not wrong yet."""
    if ("mirror",) not in wrong and "mirror" in config and not os.path.isdir(config["mirror"]):
        yield ("mirror",), f"there is no folder {config['mirror']}"
    cache = config.get("cache", "") if ("cache",) not in wrong else ""
    if text := path_fault(cache):
        yield ("cache",), text
    elif os.path.exists(cache) and not os.path.isdir(cache):
        yield ("cache",), f"{cache} is a file, not a folder"
    if not isinstance(config.get("devices"), dict) or ("defaults",) in wrong:
        return
    devices = merged_devices(config)
    for name in ("figures", "types"):
        if name in devices:
            text = f"'{name}' is reserved for results of several devices; name it otherwise"
            yield ("devices", name), text
    for name, device in devices.items():
        sessions = device.get("sessions") if isinstance(device, dict) else None
        for session, content in sessions.items() if isinstance(sessions, dict) else ():
            key = ("devices", name, "sessions", session)
            places = (key, ("defaults", *key[2:]))
            below = {bad[4:] for bad in wrong if bad[:4] == key}
            below |= {bad[3:] for bad in wrong if bad[:3] == places[1]}
            if () in below:
                continue
            bad = {part[0] for part in below} - {"units"}
            sound = {part: value for part, value in content.items() if part not in bad}
            if ("units",) in below:
                del sound["units"]
            elif "units" in sound:
                # one wrong unit leaves the others to be judged
                units = sound["units"].items()
                sound["units"] = {q: u for q, u in units if ("units", q) not in below}
            whole = not below and not any("nominal" in each for each in wrong)
            for part, text in _session_faults(session, sound, device, replicas, whole):
                yield _declared(config, (*key, *part)), text


def _session_faults(name, session, device, replicas, whole):
    """Yield (key below the session, text) for the sound keys of a session; `whole` if all are."""
    if name == "exports":
        yield (), "'exports' is reserved for a folder of results; name the session otherwise"
    nominal = device.get("nominal") if isinstance(device.get("nominal"), dict) else {}
    for quantity in ("acceleration", "angular_rate"):
        if session.get("units", {}).get(quantity) == "count" and quantity not in nominal:
            whole = False
            yield ("units", quantity), f"'count' needs the device's nominal.{quantity}"
    text = "time_range" in session and _time_range_fault(session["time_range"])
    if text:
        yield ("time_range",), text
    if isinstance(session.get("reference"), dict):
        yield from reference_faults(session, replicas)
    unmarked = list(marks_faults(session.get("pps") or {}, replicas))
    yield from unmarked
    if "file" in session:
        yield from file_faults(session, nominal, replicas, whole and not text, not unmarked)


def _time_range_fault(limits):
    """Return what is wrong with a time range, or None."""
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
