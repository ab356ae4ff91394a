"""What is wrong in a config: every fault at once, one a line, each naming its key."""

import os
import re
from contextlib import suppress
from datetime import datetime
from pathlib import Path

import yaml
from jsonschema import Draft202012Validator

from imuloop.config import merged_devices, sources, without_dates
from imuloop.core.errors import ImuloopError, RejectedLog, did_you_mean, one_line
from imuloop.core.units import raw_unit
from imuloop.ingest.convert import Counts, si_batches
from imuloop.ingest.formats import find_format
from imuloop.ingest.ingest import used_units
from imuloop.ingest.pps import read_marks
from imuloop.ingest.sources import file_name
from imuloop.yaml_traps import yaml_faults

# where the simulate rule puts a replica's log, relative to the working folder
SIMULATED = re.compile(r"data/simulated/([^/]+)/([^/]+)\.parquet")

# most bytes judged before the run of a log that is read as a whole, unless a fault is in them
CHECKED = 1 << 23

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
        contents[name] = without_dates(yaml.safe_load(text)) or {}
        found += [(key, fault, name) for key, fault in yaml_faults(text)]
    trapped = {key for key, _, _ in found}
    declared = _schema_faults(config, yaml.safe_load(Path(schema).read_text(encoding="utf-8")))
    wrong = {key for key, _ in declared} | trapped
    declared += _meaning_faults(config, wrong, replicas)
    found += [(key, text, _origin(contents, key)) for key, text in declared if key not in trapped]
    lines = [one_line(f"{name}: {'.'.join(map(str, key))}: {text}") for key, text, name in found]
    if mirror and not Path(mirror).is_dir():
        lines.append(f"IMULOOP_MIRROR: there is no folder {mirror}")
    return list(dict.fromkeys(lines))


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


def as_given(path, arguments):
    """Return a config file's name as the command line gave it, else its own."""
    absolute = f"/{os.path.abspath(path).lstrip('/')}"
    values = [argument.rpartition("=")[2] for argument in arguments]
    ends = [value for value in values if value and absolute.endswith(_anchored(value))]
    return max(ends, key=len, default=str(path))


def _anchored(value):
    return "/" + os.path.normpath(value).removeprefix("../").lstrip("/")


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
    shown = repr(value) if len(repr(value)) < 80 else f"{repr(value)[:76]}…"
    if rule == "additionalProperties":
        known = error.schema.get("properties", {})
        for name in (name for name in value if name not in known):
            yield (*key, name), f"unknown key{_nearest(name, known, 0.6)}"
    elif rule == "required":
        for name in error.validator_value:
            if name not in value:
                yield (*key, name), f"missing; {key[-1] if key else 'the config'} needs it"
    elif rule == "enum":
        near = _nearest_unit if title == "unit" else _nearest
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
        yield key, error.message


def _nearest(name, known, cutoff):
    return did_you_mean(name, known, cutoff) or f"; use one of {', '.join(known)}"


def _nearest_unit(name, known, cutoff):
    """Return the unit that another spelling means; by similarity only what is hardly another."""
    small = name.lower()
    meant = [unit for unit in known if small == unit.lower() or small in _SPELLINGS[unit]]
    return f"; did you mean '{meant[0]}'?" if meant else _nearest(name, known, 2 * cutoff)


def _meaning_faults(config, wrong, replicas):
    """Return (key, text) for what a schema cannot say, of everything that is not wrong yet."""
    found = []
    if ("mirror",) not in wrong and "mirror" in config and not os.path.isdir(config["mirror"]):
        found.append((("mirror",), f"there is no folder {config['mirror']}"))
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
                found += [
                    (_declared(config, (*key, *part)), text)
                    for part, text in _session_faults(session, sound, device, replicas, whole)
                ]
    return found


def _session_faults(name, session, device, replicas, whole):
    """Yield (key below the session, text) for the sound keys of a session; `whole` if all are."""
    if name == "exports":
        yield (), "'exports' is reserved for a folder of results; name the session otherwise"
    nominal = device.get("nominal") if isinstance(device.get("nominal"), dict) else {}
    for quantity in ("acceleration", "angular_rate"):
        if session.get("units", {}).get(quantity) == "count" and quantity not in nominal:
            whole = False
            yield ("units", quantity), f"'count' needs the device's nominal.{quantity}"
    text = "time_range" in session and _time_range_fault(*session["time_range"])
    if text:
        yield ("time_range",), text
    unmarked = list(_marks_faults(session.get("pps") or {}, replicas))
    yield from unmarked
    if "file" in session:
        yield from _file_faults(session, nominal, replicas, whole and not text, not unmarked)


def _marks_faults(marks, replicas):
    """Yield what is wrong with 1PPS marks, as far as it can be seen without the log."""
    if not marks:
        return
    if "file" not in marks:
        for key in ("counter", "time"):
            if key not in marks:
                yield ("pps", key), "missing; marks are two columns of the log, or a file"
        return
    source = sources(marks["file"])["log"]
    path = source.get("path")
    if path is None:
        return
    if not Path(path).is_file():
        yield ("pps", "file"), _missing(path, replicas) or f"{path} is no table of marks"
        return
    try:
        read_marks(path, marks)
    except ImuloopError as error:
        key, _, text = str(error).partition(": ")
        yield (
            (tuple(key.split(".")), text)
            if key.startswith("pps.")
            else (
                ("pps", "file"),
                str(error),
            )
        )
    except OSError as error:
        yield ("pps", "file"), f"{path} cannot be read: {error.strerror}"


def _file_faults(session, nominal, replicas, whole, marked):
    """Yield what is wrong with a session's file, as far as it can be seen before the run."""
    given = sources(session["file"])
    names = {role: source.get("path") or file_name(source) for role, source in given.items()}
    try:
        _, log_format = find_format(session.get("format"), names)
    except ImuloopError as error:
        yield ("file",), str(error)
        return
    except OSError as error:
        # a name too long, a folder that may not be entered
        yield ("file",), f"cannot be read: {error.strerror}"
        return
    there = [role for role, source in given.items() if _is_there(source.get("path"))]
    for role in (role for role in given if role not in there):
        text = "path" in given[role] and _missing(names[role], replicas)
        if text:
            yield ("file", *(() if role == "log" else (role,))), text
    locked = [names[role] for role in there if not os.access(names[role], os.R_OK)]
    if locked:
        yield ("file",), f"{locked[0]} cannot be read: permission denied"
    elif len(there) == len(given):
        yield from _log_faults(session, nominal, log_format, names, whole and marked)


def _size(names):
    """Return the bytes of a session's files, those inside of folders too."""
    paths = [Path(name) for name in names.values()]
    files = [f for path in paths for f in (path.iterdir() if path.is_dir() else [path])]
    return sum(file.stat().st_size for file in files if file.is_file())


def _is_there(path):
    return path is not None and (Path(path).is_file() or Path(path).is_dir())


def _log_faults(session, nominal, log_format, names, whole):
    """Yield which of the declared columns a log lacks, and what of the rest does not fit it."""
    declared = dict(session.get("columns") or {})
    marks = session.get("pps") or {}
    if {"counter", "time"} == {*marks}:
        declared["pps"] = marks
    wrong = set()
    while True:
        try:
            log = _read(log_format, names, declared, 1 << 10)
            break
        except RejectedLog:
            # a fault of the data, for the job to find
            return
        except ImuloopError as error:
            quantity, _, text = str(error).removeprefix("columns.").partition(": ")
            if quantity.startswith("pps."):
                yield tuple(quantity.split(".")), text
                wrong.add("pps")
                del declared["pps"]
                continue
            if quantity not in declared:
                # without a column that was declared wrongly, the log may well lack others
                if not wrong:
                    yield ("file",), str(error)
                return
            yield ("columns", quantity), text
            # the others may be wrong too
            wrong.add(quantity)
            del declared[quantity]
    timed = {"time", "interval"} & {*log.found, *wrong}
    if "log" in names and not timed and "rate" not in session:
        yield ("rate",), f"missing; {names['log']} has no time column"
    elif marks and "time" not in {*log.found, *wrong}:
        yield ("pps",), "the log has no time column, which is to be the local counter"
    elif "pps" in declared and "pps" not in log.found:
        yield ("pps",), "only tables hold columns of marks; name a file in pps.file"
    elif whole and not wrong:
        text = _fitting_fault(session, nominal, log)
        if text:
            # stamps may be missing at first: what few rows show counts where it does for the job
            log = _read(log_format, names, declared, 1 << 16)
            text = _fitting_fault(session, nominal, log)
        key, _, rest = (text or "").partition(": ")
        if text:
            told = re.fullmatch(r"time_range|units\.\w+", key)
            yield (tuple(key.split(".")), rest) if told else (("file",), text)


def _fitting_fault(session, nominal, log):
    """Return why units or range do not fit a log's first rows, or None."""
    try:
        units, _ = used_units(log, session.get("units") or {})
        sensors = ("acceleration", "angular_rate")
        raw_units = {q: raw_unit(q, units[q], nominal.get(q)) for q in sensors}
        declared = {key: session.get(key) for key in ("rate", "time_range")}
        if session.get("pps"):
            # dates are the marks', not the stamps'
            declared["time_range"] = None
        batches = si_batches(log, units=units, raw_units=raw_units, counts=Counts(), **declared)
        next(batches, None)
    except RejectedLog:
        return None
    except ImuloopError as error:
        return str(error)
    return None


def _read(log_format, names, declared, rows):
    """Return the log, of a large one the head where nothing is amiss in it."""
    if log_format.whole and _size(names) > CHECKED:
        # a stream that the head lacks may come later
        with suppress(ImuloopError):
            return log_format.read(names, declared, rows, most=CHECKED)
    return log_format.read(names, declared, rows)


def _time_range_fault(start, end):
    """Return what is wrong with a time range, or None."""
    if start is None or end is None:
        return None
    if isinstance(start, str) != isinstance(end, str):
        return "start and end must both be seconds or both be ISO 8601"
    if isinstance(start, str):
        try:
            start, end = datetime.fromisoformat(start), datetime.fromisoformat(end)
        except ValueError as error:
            return f"not ISO 8601: {error}"
        if (start.tzinfo is None) != (end.tzinfo is None):
            return "start and end must both name their time zone, or neither"
    return None if start < end else "the start is not before the end"


def _missing(path, replicas):
    """Return why a local file cannot be had, or None if the workflow makes it."""
    simulated = SIMULATED.fullmatch(os.path.normpath(path))
    if not simulated:
        if Path(path).is_dir():
            return f"{path} is a folder, not a file"
        if Path(path).is_symlink() and not Path(path).exists():
            return f"{path} is a link that leads to no file"
        return (
            f"{path} is not a regular file" if Path(path).exists() else f"there is no file {path}"
        )
    replica, session = simulated.groups()
    if replica not in replicas:
        return f"there is no replica '{replica}'{_nearest(replica, replicas, 0.6)}"
    if session not in replicas[replica]:
        return f"{replica} has no session '{session}'{_nearest(session, replicas[replica], 0.6)}"
    return None
