"""A device's row of the comparison: verdicts, figures with unit and σ, rejected sessions."""

from dataclasses import asdict

import numpy as np

from imuloop.core.noise_model import AxisNoise
from imuloop.export.densities import UNITS, for_filter, of_calibrated
from imuloop.report.card import card
from imuloop.report.figures.allan import curve, longest_curve_first
from imuloop.report.figures.loop import loop_errors
from imuloop.report.numbers import sigma_of
from imuloop.report.results import SENSORS, XYZ, base_parameters, of_axes
from imuloop.report.verdict import BOTH, QUOTED, answers, block_of, blocks, quoted

# version of the JSON file
FORMAT = 1
# terms of misalignment, in the order of every list of them
PAIRS = ("xy", "xz", "yx", "yz", "zx", "zy")
# what the comparison holds of each sensor, with the unit in files
FIGURE_UNITS = {
    sensor: {"residual": residual, "bias": UNITS[sensor]["B"], "scale": "1", "misalignment": "rad"}
    | UNITS[sensor]
    for sensor, residual in (("accelerometer", "m/s^2"), ("gyroscope", "rad"))
}


def summarise(device, steps=()):
    """Return what the comparison needs of a device, the content of summary.json.

    ``figures`` {name: {value, std, unit, axis, upper95}}, the largest of three axes; ``axes``
    {name: {unit, value, std}} for all three, or for the six pairs of a misalignment; ``filter``
    {name: {value, axis, limit, raised_from}}, noise as a filter takes it; ``allan`` {channel:
    {tau_s, adev}}; ``status``, ``answers``, ``card``, ``calibrated``, whether there
    is a calibration to use, ``loop`` (see `loop_errors`), ``verdicts``, ``rejected``, ``logs``.
    `steps` are those of `next_steps`.
    """
    axes, final = _axes(device), device.calibrations.get("final")
    loop = loop_errors(device) if device.calibrations else []
    record = next(iter(longest_curve_first(device.used)), None)
    return {
        "format": FORMAT,
        "device": device.name,
        "label": device.title,
        "simulated": device.simulated,
        "status": "ok" if device.used else "rejected",
        "rejected": [
            {"session": s.name, "kind": s.kind, "reasons": s.reasons}
            for s in device.sessions
            if s.rejected
        ],
        "verdicts": {
            sensor: {
                part: block["verdict"]
                for of, part, block in blocks(device.diagnosis)
                if of in (sensor, BOTH)
            }
            for sensor in SENSORS
        },
        "answers": answers(device.diagnosis),
        "card": card(device.diagnosis, loop, final),
        "calibrated": bool(final and final.measured),
        "loop": loop,
        "advised": bool(steps),
        "figures": _figures(device, axes),
        "filter": _filter(device),
        "axes": axes,
        "allan": {c: curve(record.allan, c)[["tau_s", "adev"]].to_dict("list") for c in device.axes}
        if record
        else {},
        "allan_csv": record and f"{device.name}/figures/{record.name}_allan.csv",
        "logs": [
            {"session": s.name, "file": file, "sha256": digest}
            for s in device.sessions
            for file, digest in s.source["sha256"].items()
        ],
    }


def _axes(device):
    """Return bias, scale factor error and misalignment of the final calibration, SI."""
    calibration, found = device.calibrations.get("final"), {}
    for sensor in SENSORS if calibration else ():
        content = getattr(calibration, sensor)
        base = base_parameters(content)
        for key, letter in (("bias", "b"), ("scale", "K")):
            if f"{letter}0" in content.names:
                value, std = base[key]
                unit = FIGURE_UNITS[sensor][key]
                found[f"{sensor}_{key}"] = {"unit": unit, "value": value, "std": std}
        pairs = [
            base["misalignment"][i, j] if f"T{i}{j}" in content.names else (None, None)
            for i, j in (map(XYZ.index, pair) for pair in PAIRS)
        ]
        value, std = zip(*pairs, strict=True)
        if any(v is not None for v in value):
            found[f"{sensor}_misalignment"] = {"unit": "rad", "value": value, "std": std}
    return found


def _figures(device, axes):
    """Return one figure for each column of the comparison.

    The held-out residual twice: ``residual``, the same kind for all devices, and ``quoted``, the
    kind that the verdict quotes.
    """
    figures = {}
    for sensor in SENSORS:
        block = block_of(device.diagnosis, sensor)
        kinds = {"residual": QUOTED[sensor][0], "quoted": quoted(sensor, block)[0]}
        for key, name in kinds.items():
            if residual := block["residuals"].get(name):
                # the root mean square of n normal errors has a relative σ of 1/sqrt(2 n)
                figures[f"{sensor}_{key}"] = {
                    "value": residual["after"],
                    "std": residual["after"] / np.sqrt(2 * max(residual["n"], 1)),
                    "unit": residual["unit"],
                    "floor": residual["floor"],
                }
        # what the added effects explain is no noise
        change = block_of(device.diagnosis, sensor, "static_record").get("noise", {})
        logged = of_axes(device.axes, sensor)
        cleaned = [
            (axis, AxisNoise.from_dict(own["after"]) if own else noise)
            for (axis, noise), (_, own) in zip(logged, of_axes(change, sensor), strict=True)
        ]
        for key, unit in UNITS[sensor].items():
            if figure := _largest_noise(cleaned, key):
                before = _largest_noise(logged, key) if change else None
                if before and before["value"] not in (None, figure["value"]):
                    figure["as_logged"] = before["value"]
                figures[f"{sensor}_{key}"] = {**figure, "unit": unit}
        for key, names in (("bias", XYZ), ("scale", XYZ), ("misalignment", PAIRS)):
            if content := axes.get(f"{sensor}_{key}"):
                i = int(np.nanargmax(np.abs(np.array(content["value"], float))))
                figures[f"{sensor}_{key}"] = {
                    "value": content["value"][i],
                    "std": content["std"][i],
                    "unit": content["unit"],
                    "axis": names[i],
                }
    return figures


def _filter(device):
    """Return white noise and random walk as a filter takes them, SI; rate_hz where it is known.

    One number per sensor, that of the worst axis of calibrated samples; of a term that was not seen
    the 95 % upper limit; raised where N and K would not bound the Allan curve. The exports give the
    same.
    """
    final = device.calibrations.get("final")
    rates = [s.quality["rate_hz"] for s in device.used]
    found = {"rate_hz": device.noise.get("rate_hz") or next(iter(rates), None)}
    for sensor in SENSORS:
        known = [
            (noise, axis)
            for axis, noise in of_axes(device.axes, sensor)
            if None not in (noise.N.size, noise.K.size)
        ]
        for key in "NK" if known else "":
            densities = [for_filter(noise, axis, key) for noise, axis in known]
            if final:
                densities = of_calibrated(getattr(final, sensor), densities)
            found[f"{sensor}_{key}"] = asdict(max(densities, key=lambda d: d.value))
    return found


def _largest_noise(axes, key):
    """Return the largest of three axes, and the limit of another if that is larger."""
    found = [(getattr(noise, key), axis) for axis, noise in axes]
    known = [(c.value, sigma_of(c), a) for c, a in found if c.value is not None]
    limits = [(c.upper95, a) for c, a in found if c.value is None and c.upper95 is not None]
    if not known and not limits:
        return None
    value, std, axis = max(known, key=lambda v: v[0], default=(None, None, None))
    upper, upper_axis = max(limits, default=(None, None))
    # an axis that is only limited may still be the worst
    if known and limits and upper <= value:
        upper = upper_axis = None
    return {"value": value, "std": std, "axis": axis, "upper95": upper, "upper95_axis": upper_axis}
