"""The config resolved: each device with its defaults, as plain data."""

import re
from datetime import date, datetime
from glob import glob
from pathlib import Path

from imuloop.core.errors import ImuloopError
from imuloop.core.units import STANDARD_GRAVITY
from imuloop.ingest.sources import file_name
from imuloop.local_gravity import normal_gravity
from imuloop.sensors import device_figures

# of all logs of a device, where a session does not say otherwise
OF_LOGS = ("columns", "units", "format", "rate")
# signs of a pattern of file names
_WILD = re.compile(r"[*?\[]")
STAGES = ("segment", "noise", "calibrate", "diagnose")


def merge(base, override):
    """Return `base` with `override` laid over it, mapping by mapping, key by key."""
    if not isinstance(base, dict) or not isinstance(override, dict):
        return override
    return base | {key: merge(base.get(key), value) for key, value in override.items()}


def without_dates(value):
    """Return `value` with dates, which YAML makes of bare stamps, and all keys as text."""
    if isinstance(value, dict):
        return {str(key): without_dates(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [without_dates(item) for item in value]
    return value.isoformat() if isinstance(value, (date, datetime)) else value


def merged_devices(config):
    """Return the devices by name, each laid over the defaults, each session over its device."""
    defaults = config.get("defaults") or {}
    merged = {name: merge(defaults, device) for name, device in config["devices"].items()}
    return {name: _expanded(device) for name, device in merged.items()}


def _expanded(device):
    """Return a device with all that is said of each session in it, and a session per file."""
    sessions = device.get("sessions") if isinstance(device, dict) else None
    if not isinstance(sessions, dict):
        return device
    shared, found = {key: device[key] for key in OF_LOGS if key in device}, {}
    for name, session in sessions.items():
        if not isinstance(session, dict):
            found[name] = session
            continue
        session = merge(shared, session)
        paths = _files(session.get("file"), session.get("format"))
        if paths is None:
            found[name] = session
        for path in paths or ():
            taken = {*sessions} - {name} | {*found}
            found[_session_name(path, name, taken)] = session | {"file": path}
    return device | {"sessions": found}


def _files(file, form):
    """Return the files of a pattern or a folder of logs, in order; None if `file` is one log."""
    if not isinstance(file, str) or is_stored(file) or "\0" in file:
        return None
    try:
        # a file may be called so
        if _WILD.search(file) and not Path(file).exists():
            return sorted(glob(file)) or None
        if not Path(file).is_dir():
            return None
        # takes long to import
        from imuloop.ingest.formats import find_format

        try:
            # some logs are folders
            find_format(form, {"log": file})
        except ImuloopError:
            inside = (path for path in Path(file).iterdir() if not path.name.startswith("."))
            return sorted(map(str, inside)) or None
    except OSError:
        # a name too long, a folder that may not be entered: a fault of the file
        pass
    return None


def _session_name(path, session, taken):
    """Return the name of a file's session: the file's name, as far as it can name a folder."""
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", Path(path).stem)[:48]
    if not re.match("[A-Za-z]", name) or name in taken or name == "exports":
        name = f"{session}_{name}"[:60]
    number, stem = 1, name
    while name in taken:
        number += 1
        name = f"{stem}_{number}"
    return name


def resolve(config):
    """Return every device of a config without faults, with all keys, as the stages need them.

    By device: ``label``, ``gravity`` (m/s^2), keys of `device_figures`, the stages' settings,
    ``type``, None where not given, ``prior`` with ``file`` and ``type``, empty where not given, and
    ``sessions`` with ``kind``, ``format``, ``sources`` (by role: ``log``, or ``acceleration`` and
    ``angular_rate``; ``pps`` and ``reference`` in their own files), ``columns``, ``units``,
    ``rate`` (Hz), ``time_range``, ``pps``, ``reference``, ``known_rotation``.
    """
    return {
        name: _device(name, each) for name, each in merged_devices(without_dates(config)).items()
    }


def _device(name, device):
    gravity, prior = device.get("gravity", STANDARD_GRAVITY), device.get("prior")
    if isinstance(gravity, dict):
        gravity = normal_gravity(gravity["latitude"], gravity["height"])
    return {
        "label": device.get("label", name),
        "type": device.get("type"),
        "prior": {"file": prior, "type": device.get("type")} if prior else {},
        "gravity": float(gravity),
        **known_figures(device),
        **{stage: device.get(stage) or {} for stage in STAGES},
        "sessions": {key: _session(session) for key, session in device["sessions"].items()},
    }


def known_figures(device):
    """Return the `device_figures` of a device with its keys."""
    return device_figures(*(device.get(k) for k in ("sensor", "range", "nominal", "full_scale")))


def _session(session):
    pps = dict(session.get("pps") or {})
    marks = {"pps": sources(pps.pop("file"))["log"]} if "file" in pps else {}
    reference = dict(session.get("reference") or {})
    if "file" in reference:
        marks["reference"] = sources(reference.pop("file"))["log"]
    known = session.get("sections") or [{k: session[k] for k in ("axis", "angle") if k in session}]
    return {
        "kind": session["kind"],
        "format": session.get("format"),
        "sources": sources(session["file"]) | marks,
        "columns": session.get("columns") or {},
        "units": session.get("units") or {},
        "rate": session.get("rate"),
        "time_range": session.get("time_range"),
        "pps": pps,
        "reference": reference,
        "known_rotation": known if session["kind"] == "known_rotation" else [],
    }


def sources(file):
    """Return the sources of a session's ``file`` by role: ``log``, or one for each sensor."""
    if isinstance(file, dict) and "acceleration" in file:
        return {role: sources(file[role])["log"] for role in ("acceleration", "angular_rate")}
    return {"log": {"path": file} if isinstance(file, str) else dict(file)}


def by_type(devices):
    """Return the names of the devices of each type that some devices name, in their order."""
    types = {}
    for name, device in devices.items():
        if device.get("type"):
            types.setdefault(device["type"], []).append(name)
    return types


def is_stored(path):
    """Tell whether a path is a query of one of Snakemake's storage plugins, as s3://bucket/key."""
    return "://" in path


def source_path(source, cache):
    """Return where a source lies in the working folder, once it is fetched."""
    return source.get("path") or f"{cache}/{source['sha256']}/{file_name(source)}"


def fetched(devices):
    """Return every source that has to be fetched, by its place ``<sha256>/<name>`` in the cache."""
    return {
        source_path(source, "").lstrip("/"): source
        for device in devices.values()
        for session in device["sessions"].values()
        for source in session["sources"].values()
        if "path" not in source
    }
