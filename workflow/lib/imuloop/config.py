"""From a config to its devices, each with all defaults, as plain data."""

import re
from contextlib import suppress
from datetime import date, datetime
from glob import glob
from itertools import count
from pathlib import Path

from imuloop.core.errors import ImuloopError
from imuloop.core.units import STANDARD_GRAVITY
from imuloop.ingest.sources import file_name
from imuloop.local_gravity import normal_gravity
from imuloop.sensors import device_figures

# keys of a device that apply to all its logs, unless a session has its own
OF_LOGS = ("columns", "units", "format", "rate")
# characters that make a path a pattern of file names
_WILD = re.compile(r"[*?\[]")
STAGES = ("segment", "noise", "calibrate", "diagnose")


def merge(base, override):
    """Return `base` with the values of `override` in place of its own, key by key at any depth.

    Keys that only one of the two has are kept. If one of the two is not a mapping, the result is
    `override`.
    """
    if not isinstance(base, dict) or not isinstance(override, dict):
        return override
    return base | {key: merge(base.get(key), value) for key, value in override.items()}


def without_dates(value):
    """Return a config, or a part of it, in which all keys and all dates are text.

    `value` is the config or the part. YAML turns time stamps without quotes into dates.
    """
    if isinstance(value, dict):
        return {str(key): without_dates(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [without_dates(item) for item in value]
    return value.isoformat() if isinstance(value, (date, datetime)) else value


def merged_devices(config):
    """Return the devices of a config by name, a dict, with the config's defaults filled in.

    Each session also gets the keys of its device that apply to logs (`OF_LOGS`). `config` is the
    config as written.
    """
    defaults = config.get("defaults") or {}
    merged = {name: merge(defaults, device) for name, device in config["devices"].items()}
    return {name: _expand_sessions(device) for name, device in merged.items()}


def _expand_sessions(device):
    """Return a device of a config in which each session has one log, with the keys that it needs.

    `device` is the entry of the device in the config. A session whose ``file`` is a pattern of file
    names, such as ``logs/*.csv``, or a folder of logs becomes a session for each of these logs. A
    session gets the keys `OF_LOGS` of the device that it lacks. A device or session that is not a
    mapping stays as it is; `config_faults` reports it.
    """
    sessions = device.get("sessions") if isinstance(device, dict) else None
    if not isinstance(sessions, dict):
        return device
    shared, expanded = {key: device[key] for key in OF_LOGS if key in device}, {}
    for name, session in sessions.items():
        paths = ()
        if isinstance(session, dict):
            session = merge(shared, session)
            paths = _find_logs(session.get("file"), session.get("format"))
        if not paths:
            expanded[name] = session
        for path in paths:
            taken = {*sessions} - {name} | {*expanded}
            expanded[_session_name(path, name, taken)] = session | {"file": path}
    return device | {"sessions": expanded}


def _find_logs(file, form):
    """Return the sorted paths of the logs that a pattern or a folder stands for, a list.

    `file` is the value of ``file`` in the config: a pattern of file names, such as ``logs/*.csv``,
    or a folder of logs. For any other value, such as the path of one log, the list is empty. `form`
    is the name of the declared format, or None; by it a folder may itself be one log.
    """
    if not isinstance(file, str) or is_stored(file) or "\0" in file:
        return []
    # a name too long, or a folder that may not be entered, is reported as a fault of the file
    with suppress(OSError):
        # the name of a file may contain characters of patterns
        if _WILD.search(file) and not Path(file).exists():
            return sorted(glob(file))
        if Path(file).is_dir() and not _is_log(file, form):
            inside = (path for path in Path(file).iterdir() if not path.name.startswith("."))
            return sorted(map(str, inside))
    return []


def _is_log(folder, form):
    """Return whether a folder is itself one log, such as a recording of several files.

    `folder` is its path. `form` is the name of the declared format, or None for any format.
    """
    # imported late, as it takes long
    from imuloop.ingest.formats import find_format

    try:
        return bool(find_format(form, {"log": folder}))
    except ImuloopError:
        return False


def _session_name(path, session, taken):
    """Return the name of the session for one of several logs: the file's name, fit for a folder.

    `path` is the path of the log, and `session` is the name in the config of the session that
    stands for all these logs; it is put in front where the file's name cannot be used. `taken` are
    the names of other sessions, which the result must not have.
    """
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", Path(path).stem)[:48]
    if not re.match("[A-Za-z]", name) or name in taken or name == "exports":
        name = f"{session}_{name}"[:60]
    names = (f"{name}_{n}" if n > 1 else name for n in count(1))
    return next(name for name in names if name not in taken)


def resolve(config):
    """Return the devices of a config by name, each a dict with all defaults filled in.

    `config` is the config as Snakemake merged it, without faults. A device has ``label``, the keys
    of the result of `known_figures`, the settings of each stage, ``type`` (None if not given),
    ``prior`` with ``file`` and ``type`` (empty if not given), and ``sessions`` by name.

    A session has ``kind``, ``format``, ``sources``, ``columns``, ``units``, ``rate`` (Hz),
    ``time_range``, ``pps``, ``reference`` and ``known_rotation``. The sources are by role: ``log``,
    or ``acceleration`` and ``angular_rate``; ``pps`` and ``reference`` if they have their own file.
    """
    devices = merged_devices(without_dates(config))
    return {name: _resolve_device(name, device) for name, device in devices.items()}


def _resolve_device(name, device):
    """Return a device as `resolve` does; `name` is its name, `device` its entry in the config."""
    prior = device.get("prior")
    return {
        "label": device.get("label", name),
        "type": device.get("type"),
        "prior": {"file": prior, "type": device.get("type")} if prior else {},
        **known_figures(device),
        **{stage: device.get(stage) or {} for stage in STAGES},
        "sessions": {key: _resolve_session(plan) for key, plan in device["sessions"].items()},
    }


def known_figures(device):
    """Return the local gravity of a device and the figures of its sensor, a dict.

    The key ``gravity`` has local gravity, m/s^2. All other keys are from `device_figures`, such as
    scales and tolerances. `device` has the keys ``gravity``, ``sensor``, ``range``, ``nominal`` and
    ``full_scale`` of a config; a key may be absent.
    """
    gravity = device.get("gravity", STANDARD_GRAVITY)
    figures = device_figures(*map(device.get, ("sensor", "range", "nominal", "full_scale")))
    return figures | {
        "gravity": normal_gravity(**gravity) if isinstance(gravity, dict) else float(gravity)
    }


def _resolve_session(session):
    """Return a session as `resolve` does, with all defaults.

    `session` is its entry in the config.
    """
    resolved = {key: session.get(key) for key in ("kind", "format", "rate", "time_range")}
    for key in ("columns", "units", "pps", "reference"):
        resolved[key] = dict(session.get(key) or {})
    files = sources(session["file"])
    for key in ("pps", "reference"):
        if "file" in resolved[key]:
            files[key] = sources(resolved[key].pop("file"))["log"]
    turns = session.get("sections") or [{k: session[k] for k in ("axis", "angle") if k in session}]
    known_turns = turns if session["kind"] == "known_rotation" else []
    return resolved | {"sources": files, "known_rotation": known_turns}


def sources(file):
    """Return where the files of a log come from, a dict of sources by role.

    The role is ``log``, or ``acceleration`` and ``angular_rate`` for a log in two files. A source
    is a dict: a local file with the key ``path``, or a file to be fetched. `file` is the value of
    ``file`` in the config.
    """
    if isinstance(file, dict) and "acceleration" in file:
        return {role: sources(file[role])["log"] for role in ("acceleration", "angular_rate")}
    return {"log": {"path": file} if isinstance(file, str) else dict(file)}


def by_type(devices):
    """Return the names of the devices of each type, a dict of lists by type.

    `devices` are the devices by name, as `resolve` returns them. Devices without type are left out.
    """
    types = dict.fromkeys(device["type"] for device in devices.values() if device["type"])
    return {t: [n for n, device in devices.items() if device["type"] == t] for t in types}


def is_stored(path):
    """Return whether `path` is on a remote storage that Snakemake reads: s3://bucket/key."""
    return "://" in path


def source_path(source, cache):
    """Return the local path of a source of a log; a source to be fetched may not be there yet.

    `source` is a dict, as `sources` returns it, and `cache` is the folder for fetched files.
    """
    return source.get("path") or f"{cache}/{source['sha256']}/{file_name(source)}"


def fetched(devices):
    """Return the sources of logs that have to be fetched, a dict by the path of the fetched file.

    The path is relative to the folder of fetched files, and is ``<sha256>/<name>``. `devices` are
    the devices by name, as `resolve` returns them. A source is a dict, as `sources` returns it.
    """
    return {
        source_path(source, "").lstrip("/"): source
        for device in devices.values()
        for session in device["sessions"].values()
        for source in session["sources"].values()
        if "path" not in source
    }
