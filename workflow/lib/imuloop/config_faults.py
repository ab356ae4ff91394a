"""What is wrong in a config: every fault at once, one a line, each naming its key."""

import math
import os
from concurrent.futures import ProcessPoolExecutor
from datetime import datetime
from multiprocessing import get_start_method
from pathlib import Path

import yaml
from jsonschema import Draft202012Validator

from imuloop.config import merged_devices, without_dates
from imuloop.core.errors import nearest, one_line
from imuloop.file_faults import file_faults, marks_faults, path_fault
from imuloop.yaml_traps import by_libyaml, yaml_faults

# of so many sessions the logs are looked at by two processes
_MANY = 100

# a config of a thousand devices holds fewer
MOST_VALUES = 100_000

# other spellings of the units, in small letters: by similarity dps would be rad/s
_SPELLINGS = {
    "s": ("sec", "secs", "second", "seconds"),
    "ms": ("msec", "millis", "milliseconds"),
    "us": ("µs", "μs", "usec", "microseconds"),
    "ns": ("nsec", "nanoseconds"),
    "ISO 8601": ("iso", "iso8601", "iso-8601"),
    "m/s^2": ("m/s2", "m/s²", "m/s/s", "m/s**2", "mps2", "ms-2", "m s-2"),
    "g": ("g0", "gs"),
    "mg": ("milli-g",),
    "count": ("counts", "lsb", "raw"),
    "rad/s": ("rad/sec", "rads", "radians/s"),
    "deg/s": ("dps", "°/s", "deg/sec", "degrees/s", "degree/s"),
    "mrad/s": ("mrad/sec",),
    "deg/h": ("dph", "°/h", "deg/hr", "degrees/h"),
    "m/s": ("mps", "m/sec", "m s-1"),
    "mm/s": ("mmps", "mm/sec"),
    "rad": ("radian", "radians"),
    "mrad": ("milliradian", "milliradians"),
    "deg": ("°", "degree", "degrees"),
    "degC": ("c", "°c", "celsius"),
    "K": ("kelvin",),
}

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

    Returns
    -------
    list of str
        ``config.yaml: devices.my_imu.sessions.poses.units.time: 'sec' is not a unit; …``
    """
    config = without_dates(config)
    contents, found = {}, []
    for name, path in files.items():
        text = Path(path).read_text(encoding="utf-8")
        contents[name] = without_dates(by_libyaml(yaml.load, text)) or {}
        found += [(key, fault, name) for key, fault in yaml_faults(text)]
    trapped = {key for key, _, _ in found}
    unusable = [(key, text) for key, text in _unusable(config) if key not in trapped]
    found += [(key, text, _origin(contents, key)) for key, text in unusable]
    trapped |= {key for key, _ in unusable}
    declared = _schema_faults(config, by_libyaml(yaml.load, Path(schema).read_text("utf-8")))
    wrong = {key for key, _ in declared} | trapped
    declared += _meaning_faults(config, wrong, replicas)
    found += [(key, text, _origin(contents, key)) for key, text in declared if key not in trapped]
    lines = [one_line(f"{name}: {'.'.join(map(str, key))}: {text}") for key, text, name in found]
    if mirror and not Path(mirror).is_dir():
        lines.append(f"IMULOOP_MIRROR: there is no folder {mirror}")
    return list(dict.fromkeys(lines))


def _unusable(value, key=()):
    """Yield (key, text) for each number and text of a config that is none to what comes after."""
    if isinstance(value, dict):
        for name, item in value.items():
            yield from _unusable(item, (*key, name))
    elif isinstance(value, list):
        for i, item in enumerate(value):
            yield from _unusable(item, (*key, i))
    elif isinstance(value, str):
        if not value.isascii() and any("\ud800" <= c <= "\udfff" for c in value):
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


def unreadable(path):
    """Return why a file holds no config at all, in one line that names it; None if it does."""
    try:
        content = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        return f"{path}: there is no such file here; write one, or name one with --configfile"
    except (OSError, UnicodeDecodeError) as error:
        return f"{path}: cannot be read: {error}"
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        return one_line(f"{path}: {where}no YAML: {getattr(error, 'problem', None) or error}")
    except RecursionError:
        return f"{path}: nested too deeply"
    except Exception as error:
        # a date, a number, a truth value that is none
        return one_line(f"{path}: a value cannot be: {error}")
    if content is None:
        return f"{path}: empty; it needs devices"
    if not isinstance(content, dict):
        return f"{path}: not a mapping of keys; it needs devices"
    if _holds_more(content, MOST_VALUES):
        return f"{path}: more than {MOST_VALUES} values, aliases (*name) written out"
    return None


def _holds_more(content, most):
    """Tell whether there are more values than so many; in what holds itself there are."""
    left = [content]
    while left and most:
        value, most = left.pop(), most - 1
        if isinstance(value, (dict, list)):
            left += value.values() if isinstance(value, dict) else value
    return bool(left)


def shown_path(path):
    """Return a config file's path from here where that is shorter."""
    return min(os.path.relpath(path), str(path), key=len)


def _origin(contents, key):
    """Return the name of the last file that holds the most of a key's path."""
    return max(reversed(contents), key=lambda name: _depth(contents[name], key), default="config")


def _depth(content, key):
    """Return how many steps of a key's path exist in a mapping."""
    for depth, part in enumerate(key):
        if isinstance(content, dict) and part in content:
            content = content[part]
        elif isinstance(content, list) and isinstance(part, int) and part < len(content):
            content = content[part]
        else:
            return depth
    return len(key)


def _schema_faults(config, schema):
    """Return (key, text) for each way in which a config breaks the schema."""
    effective = config
    devices, defaults = config.get("devices"), config.get("defaults", {})
    if isinstance(devices, dict) and isinstance(defaults, dict):
        effective = {**config, "devices": merged_devices(config)}
    found = []
    for error in Draft202012Validator(schema).iter_errors(effective):
        for key, text in _texts(error):
            found.append((_declared(config, key), text))
    return list(dict.fromkeys(found))


def _declared(config, key):
    """Return where a key of a merged device was written: in the device or in the defaults."""
    if len(key) > 2 and key[0] == "devices":
        inherited = ("defaults", *key[2:])
        if _depth(config, inherited) == len(key) - 1 and _depth(config, key) < len(key):
            return inherited
    return key


def _texts(error):
    """Yield (key, text) of one error of the validator."""
    key, value, rule = tuple(error.absolute_path), error.instance, error.validator
    title = error.schema.get("title", "")
    shown = _shown(repr(value))
    if rule == "additionalProperties":
        known = error.schema.get("properties", {})
        for name in (name for name in value if name not in known):
            yield (*key, name), f"unknown key{nearest(name, known, 0.6)}"
    elif rule == "required":
        for name in error.validator_value:
            if name not in value:
                yield (*key, name), f"missing; {key[-1] if key else 'the config'} needs it"
    elif rule == "enum" and value is None:
        yield key, "nothing is given"
    elif rule == "enum":
        near = _nearest_unit if title == "unit" else nearest
        hint = near(str(value), error.validator_value, 0.4)
        yield key, f"{shown} is not a {title}{hint}"
    elif rule == "type":
        kinds = error.validator_value
        needed = " or ".join(
            _TYPES[kind] for kind in ([kinds] if isinstance(kinds, str) else kinds)
        )
        yield key, "nothing is given" if value is None else f"{shown} is not {needed}"
    elif rule == "pattern" and "propertyNames" in error.absolute_schema_path:
        yield (*key, value), f"{shown} is not a {title}"
    elif rule == "pattern":
        yield key, f"{shown} is not a {title}"
    elif rule in ("minProperties", "minLength"):
        yield key, "empty"
    elif rule == "uniqueItems":
        yield key, f"{shown} names a column twice"
    elif rule in ("minItems", "maxItems"):
        yield key, f"{len(value)} entries, {error.validator_value} needed"
    else:
        yield key, error.message.replace(repr(value), shown)


def _shown(text):
    return text if len(text) < 80 else f"{text[:76]}…"


def _nearest_unit(name, known, cutoff):
    """Return the unit that another spelling means; by similarity only what is hardly another."""
    small = name.lower()
    meant = [unit for unit in known if small == unit.lower() or small in _SPELLINGS[unit]]
    return f"; did you mean '{meant[0]}'?" if meant else nearest(name, known, 2 * cutoff)


def _meaning_faults(config, wrong, replicas):
    """Return (key, text) for what a schema cannot say, of everything that is not wrong yet."""
    found, given = [], {}
    if ("mirror",) not in wrong and "mirror" in config and not os.path.isdir(config["mirror"]):
        found.append((("mirror",), f"there is no folder {config['mirror']}"))
    cache = config.get("cache", "") if ("cache",) not in wrong else ""
    if text := path_fault(cache):
        found.append((("cache",), text))
    elif os.path.exists(cache) and not os.path.isdir(cache):
        found.append((("cache",), f"{cache} is a file, not a folder"))
    if not isinstance(config.get("devices"), dict) or ("defaults",) in wrong:
        return found
    for name, device in merged_devices(config).items():
        sessions = device.get("sessions") if isinstance(device, dict) else None
        for session, content in sessions.items() if isinstance(sessions, dict) else ():
            key = ("devices", name, "sessions", session)
            below = {
                bad[len(each) :]
                for bad in wrong
                for each in (key, ("defaults", *key[2:]))
                if bad[: len(each)] == each
            }
            if () not in below:
                sound = {
                    part: content[part] for part in content if not any(b[0] == part for b in below)
                }
                if isinstance(content.get("units"), dict):
                    # one wrong unit leaves the others to be judged
                    sound["units"] = {
                        quantity: unit
                        for quantity, unit in content["units"].items()
                        if ("units", quantity) not in below
                    }
                whole = not below and not any("nominal" in bad for bad in wrong)
                given[key] = session, sound, device, replicas, whole
    for key, faults in zip(given, _faults_of_each(list(given.values())), strict=True):
        found += [(_declared(config, (*key, *part)), text) for part, text in faults]
    return found


def _faults_of_each(given):
    """Return the faults of each session, of many by two processes where Python forks them."""
    if len(given) < _MANY or get_start_method() != "fork":
        return [_listed_faults(each) for each in given]
    with ProcessPoolExecutor(2) as pool:
        return list(pool.map(_listed_faults, given, chunksize=_MANY // 4))


def _listed_faults(session):
    return list(_session_faults(*session))


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
