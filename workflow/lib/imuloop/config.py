"""The config resolved: each device with its defaults, as plain data."""

from datetime import date, datetime

from imuloop.core.gravity import normal_gravity
from imuloop.core.units import STANDARD_GRAVITY
from imuloop.ingest.sources import file_name

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
    """Return the devices by name, each laid over the defaults."""
    defaults = config.get("defaults") or {}
    return {name: merge(defaults, device) for name, device in config["devices"].items()}


def resolve(config):
    """Return every device of a config without faults, with all keys, as the stages need them.

    By device: ``label``, ``gravity`` (m/s^2), ``full_scale``, ``nominal``, the stages' settings,
    and ``sessions`` with ``kind``, ``format``, ``sources`` (by role: ``log``, or ``acceleration``
    and ``angular_rate``; ``pps`` of marks in a file), ``columns``, ``units``, ``rate`` (Hz),
    ``time_range``, ``pps``.
    """
    return {
        name: _device(name, each) for name, each in merged_devices(without_dates(config)).items()
    }


def _device(name, device):
    gravity = device.get("gravity", STANDARD_GRAVITY)
    if isinstance(gravity, dict):
        gravity = normal_gravity(gravity["latitude"], gravity["height"])
    return {
        "label": device.get("label", name),
        "gravity": float(gravity),
        "full_scale": device.get("full_scale", {}),
        "nominal": device.get("nominal", {}),
        **{stage: device.get(stage) or {} for stage in STAGES},
        "sessions": {key: _session(session) for key, session in device["sessions"].items()},
    }


def _session(session):
    pps = dict(session.get("pps") or {})
    marks = {"pps": sources(pps.pop("file"))["log"]} if "file" in pps else {}
    return {
        "kind": session["kind"],
        "format": session.get("format"),
        "sources": sources(session["file"]) | marks,
        "columns": session.get("columns") or {},
        "units": session.get("units") or {},
        "rate": session.get("rate"),
        "time_range": session.get("time_range"),
        "pps": pps,
    }


def sources(file):
    """Return the sources of a session's ``file`` by role: ``log``, or one for each sensor."""
    if isinstance(file, dict) and "acceleration" in file:
        return {role: sources(file[role])["log"] for role in ("acceleration", "angular_rate")}
    return {"log": {"path": file} if isinstance(file, str) else dict(file)}


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
