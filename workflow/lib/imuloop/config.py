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
    """Return `base` with the values of `override`; two mappings are merged key by key."""
    if not isinstance(base, dict) or not isinstance(override, dict):
        return override
    return base | {key: merge(base.get(key), value) for key, value in override.items()}


def without_dates(value):
    """Return a config, or a part of it, with all keys and dates as text.

    YAML turns stamps without quotes into dates.
    """
    if isinstance(value, dict):
        return {str(key): without_dates(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [without_dates(item) for item in value]
    return value.isoformat() if isinstance(value, (date, datetime)) else value


def merged_devices(config):
    """Return the devices of a config by name, with the defaults, a dict.

    Each session has the keys of its device that apply to logs (`OF_LOGS`).
    """
    defaults = config.get("defaults") or {}
    merged = {name: merge(defaults, device) for name, device in config["devices"].items()}
    return {name: _expand_sessions(device) for name, device in merged.items()}


def _expand_sessions(device):
    """Return a device of a config in which each session has one log and the keys of the device.

    A session whose ``file`` is a pattern or a folder of logs becomes a session for each of these.
    Only the keys `OF_LOGS` of the device are copied. A device or session that is not a mapping
    stays as it is; `config_faults` reports it.
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
    """Return the sorted paths of the logs in a pattern or a folder; empty if `file` is one log.

    `form` is the name of the format that is declared, or None.
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
    """Return whether a folder is one log, of the declared format `form` if this is not None."""
    # imported late, as it takes long
    from imuloop.ingest.formats import find_format

    try:
        return bool(find_format(form, {"log": folder}))
    except ImuloopError:
        return False


def _session_name(path, session, taken):
    """Return the name of the session for one of several files: its name, made fit for a folder.

    `path` is the path of the file, and `session` the name of the session in the config. `taken` are
    the names of other sessions, which the result must not have.
    """
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", Path(path).stem)[:48]
    if not re.match("[A-Za-z]", name) or name in taken or name == "exports":
        name = f"{session}_{name}"[:60]
    names = (f"{name}_{n}" if n > 1 else name for n in count(1))
    return next(name for name in names if name not in taken)


def resolve(config):
    """Return the devices of a config without faults by name, each a dict with all defaults.

    A device has ``label``, the keys of the result of `known_figures`, the settings of each stage,
    ``type`` (None if not given), ``prior`` with ``file`` and ``type`` (empty if not given), and
    ``sessions`` by name.

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
    """Return the local gravity of a device, m/s^2, and the figures of its sensor, a dict.

    The figures are the result of `device_figures`. `device` has the keys ``gravity``, ``sensor``,
    ``range``, ``nominal`` and ``full_scale`` of a config; a key may be absent.
    """
    gravity = device.get("gravity", STANDARD_GRAVITY)
    figures = device_figures(*map(device.get, ("sensor", "range", "nominal", "full_scale")))
    return figures | {
        "gravity": normal_gravity(**gravity) if isinstance(gravity, dict) else float(gravity)
    }


def _resolve_session(session):
    """Return a session as `resolve` does; `session` is its entry in the config."""
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
    """Return the sources of a log by role, a dict of dicts; `file` is its entry in the config.

    The role is ``log``, or ``acceleration`` and ``angular_rate`` for a log in two files. A source
    is a local file with the key ``path``, or a file to be fetched.
    """
    if isinstance(file, dict) and "acceleration" in file:
        return {role: sources(file[role])["log"] for role in ("acceleration", "angular_rate")}
    return {"log": {"path": file} if isinstance(file, str) else dict(file)}


def by_type(devices):
    """Return the names of the devices of each type, a dict; devices without type are left out."""
    types = dict.fromkeys(device["type"] for device in devices.values() if device["type"])
    return {t: [n for n, device in devices.items() if device["type"] == t] for t in types}


def is_stored(path):
    """Return whether a path, such as s3://bucket/key, is one of a storage plugin of Snakemake."""
    return "://" in path


def source_path(source, cache):
    """Return the path of a source: a local file, or its place in the folder `cache` once fetched.

    `source` is a dict, as `sources` returns it.
    """
    return source.get("path") or f"{cache}/{source['sha256']}/{file_name(source)}"


def fetched(devices):
    """Return the sources that have to be fetched, by their path ``<sha256>/<name>`` in the cache.

    `devices` are the devices by name, as `resolve` returns them.
    """
    return {
        source_path(source, "").lstrip("/"): source
        for device in devices.values()
        for session in device["sessions"].values()
        for source in session["sources"].values()
        if "path" not in source
    }
