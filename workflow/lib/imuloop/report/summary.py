"""A device's row of the comparison: verdicts, figures with unit and σ, rejected sessions."""

import numpy as np

from imuloop.report.allan_plot import curve
from imuloop.report.numbers import missing, sigma_of
from imuloop.report.results import FILE_UNITS, SENSORS, XYZ, base_parameters
from imuloop.report.verdict import PARTS, block_of, brief, quoted, sentence, verdict_of

# version of the JSON file
FORMAT = 1


def summarise(device):
    """Return what the comparison needs of a device.

    Parameters
    ----------
    device : Device
        Its results.

    Returns
    -------
    dict
        Content of summary.json: ``figures`` {name: {value, std, unit, axis, upper95}}, the
        largest of three axes; ``axes`` {name: {unit, value, std}} for all three; ``allan``
        {channel: {tau_s, adev}}; ``verdicts``, ``rejected``, ``logs``.
    """
    axes = _axes(device)
    return {
        "format": FORMAT,
        "device": device.name,
        "label": device.title,
        "simulated": device.simulated,
        "rejected": [
            {"session": s.name, "kind": s.kind, "reasons": s.quality.get("reasons") or []}
            for s in device.sessions
            if s.rejected
        ],
        "sessions": {
            s.name: {"kind": s.kind, "duration_s": s.quality.get("duration_s")}
            for s in device.sessions
        },
        "verdicts": {
            sensor: {
                part: {
                    "verdict": verdict_of(block),
                    "sentence": sentence(sensor, block),
                    "brief": brief(sensor, block),
                }
                for part in PARTS
                for block in [block_of(device.diagnosis, sensor, part)]
            }
            for sensor in SENSORS
        },
        "figures": _figures(device, axes),
        "axes": axes,
        "allan": _allan(device),
        "allan_csv": _allan_csv(device),
        "logs": [
            {"session": s.name, "file": file, "sha256": digest}
            for s in device.sessions
            for file, digest in (s.source.get("sha256") or {}).items()
        ],
    }


def _axes(device):
    """Return bias and scale factor error of each axis of the final calibration, SI."""
    calibration = device.calibrations.get("final")
    if calibration is None:
        return {}
    found = {}
    for sensor in SENSORS:
        content = getattr(calibration, sensor)
        base = base_parameters(content)
        for key, letter, unit in (("bias", "b", FILE_UNITS[sensor]), ("scale", "K", "1")):
            if f"{letter}0" in content.names:
                value, std = base[key]
                found[f"{sensor}_{key}"] = {"unit": unit, "value": value, "std": std}
    return found


def _figures(device, axes):
    """Return one figure for each column of the comparison."""
    figures = {}
    for sensor, channels in SENSORS.items():
        _, residual = quoted(sensor, block_of(device.diagnosis, sensor))
        if residual and not missing(residual.get("after")):
            # the root mean square of n normal errors has a relative σ of 1/sqrt(2 n)
            figures[f"{sensor}_residual"] = {
                "value": residual["after"],
                "std": residual["after"] / np.sqrt(2 * max(residual.get("n") or 1, 1)),
                "unit": residual["unit"],
                "floor": residual.get("floor"),
            }
        for key, unit in (("N", f"{FILE_UNITS[sensor]}/sqrt(Hz)"), ("B", FILE_UNITS[sensor])):
            logged = device.noise.get("axes", {})
            # what the added effects explain is no noise
            change = block_of(device.diagnosis, sensor, "static_record").get("noise") or {}
            cleaned = {
                c: (change.get(c) or {}).get("after") or logged.get(c) or {} for c in channels
            }
            figure = _largest_noise(cleaned, channels, key)
            if figure:
                before = _largest_noise(logged, channels, key) if change else None
                if before and before["value"] != figure["value"]:
                    figure["as_logged"] = before["value"]
                figures[f"{sensor}_{key}"] = {**figure, "unit": unit}
        for key in ("bias", "scale"):
            content = axes.get(f"{sensor}_{key}")
            if content:
                i = int(np.abs(content["value"]).argmax())
                figures[f"{sensor}_{key}"] = {
                    "value": content["value"][i],
                    "std": content["std"][i],
                    "unit": content["unit"],
                    "axis": XYZ[i],
                }
    return figures


def _largest_noise(axes, channels, key):
    """Return the largest of three axes, and the limit of another if that is larger."""
    found = [(axes.get(c, {}).get(key) or {}, a) for c, a in zip(channels, XYZ, strict=True)]
    values = [(c["value"], sigma_of(c), a) for c, a in found if not missing(c.get("value"))]
    limits = [
        (c["upper95"], a)
        for c, a in found
        if missing(c.get("value")) and not missing(c.get("upper95"))
    ]
    value, std, axis = max(values, key=lambda v: v[0], default=(None, None, None))
    upper, upper_axis = max(limits, default=(None, None))
    if value is None and upper is None:
        return None
    # an axis that is only limited may still be the worst
    if value is not None and upper is not None and upper <= value:
        upper = upper_axis = None
    return {
        "value": value,
        "std": std,
        "axis": axis,
        "upper95": upper,
        "upper95_axis": upper_axis,
    }


def _longest_record(device):
    """Return the session whose Allan curve reaches farthest, None without any."""
    records = [s for s in device.used if s.allan is not None and len(s.allan)]
    return max(records, key=lambda s: s.allan["tau_s"].max(), default=None)


def _allan_csv(device):
    """Return the file of the numbers behind the device's curve in the comparison."""
    record = _longest_record(device)
    return record and f"{device.name}/figures/{record.name}_allan.csv"


def _allan(device):
    """Return the Allan deviation of each channel, of the longest record."""
    record = _longest_record(device)
    if record is None:
        return {}
    curves = {c: curve(record.allan, c) for channels in SENSORS.values() for c in channels}
    return {
        channel: {"tau_s": rows["tau_s"], "adev": rows["adev"]}
        for channel, frame in curves.items()
        for rows in [{k: frame[k].to_numpy() for k in ("tau_s", "adev")}]
    }
