"""A static record in tables: held-out error of each axis, coefficients by session, noise after."""

import numpy as np

from imuloop.core.samples import ACCELERATION
from imuloop.report.columns import rows
from imuloop.report.effect_units import data_sheet
from imuloop.report.noise_units import COEFFICIENTS, quantities
from imuloop.report.numbers import (
    NO_NUMBER,
    RESIDUAL,
    coefficient_text,
    missing,
    number,
    with_sigma,
)
from imuloop.report.results import SENSORS, XYZ
from imuloop.report.table import Sized, Table, sized

# cosine of the angle within which a session lies on an axis, 20 degrees
ON_AXIS = 0.94


def orientation(session):
    """Return which axis pointed up in a session at rest: ``+z up``; empty where none did."""
    still = rows(session.segments, session.segments["kind"] == "static")
    if not len(still["n"]):
        return ""
    mean = [np.average(still[f"{c}_mean"], weights=still["n"]) for c in ACCELERATION]
    up = mean / np.linalg.norm(mean)
    axis = int(np.abs(up).argmax())
    if abs(up[axis]) < ON_AXIS:
        return ""
    return f"{'+' if up[axis] > 0 else '−'}{XYZ[axis]} up"


def orientations(device):
    """Return which axis pointed up in each session, those where one did."""
    found = {s.name: orientation(s) for s in device.used if s.kind == "static"}
    return {name: words for name, words in found.items() if words}


def heldout_by_session(device, sensor, block):
    """Return the held-out error of each session and axis with its floor; None where not given."""
    residual = (block.get("residuals") or {}).get("bias") or {}
    sessions = residual.get("sessions")
    if not sessions:
        return None
    unit, up = RESIDUAL[residual["unit"]], orientations(device)
    rows, gains = [], []
    for session, axes in sessions.items():
        for axis, figures in axes.items():
            before, after, floor = (figures.get(k) for k in ("before", "after", "floor"))
            known = not missing(before) and not missing(after) and after > 0
            name = axis[-1]
            if known:
                gains.append((before / after, f"{session}, {name}"))
            rows.append(
                (
                    session,
                    up.get(session, NO_NUMBER),
                    name,
                    *(sized(v, unit.factor) for v in (before, after, floor)),
                    Sized(f"{number(before / after, 2)} ×", before / after) if known else NO_NUMBER,
                )
            )
    best = max(gains, default=None)
    told = f" Most is gained by {best[1]}: {number(best[0], 2)} times." if best else ""
    return Table(
        f"{sensor.capitalize()}, static record: held-out error of the means, root mean square, "
        f"{unit.unit}",
        (
            *("Session", "Attitude", "Axis"),
            *(f"{w}, {unit.unit}" for w in ("Before", "After", "Floor")),
            "Smaller by",
        ),
        tuple(rows),
        "Each block of time is predicted by a bias and effects that were fitted to the other "
        f"blocks. Floor: what the noise alone gives.{told}",
        sorts=tuple(range(7)),
    )


def session_tables(device, sensor, block, units):
    """Return a table for each effect: its parameters fitted to each session alone.

    Parameters
    ----------
    device : Device
        The device.
    sensor : str
        Its sensor.
    block : dict
        The diagnosis of its static record.
    units : dict of str to dict
        SI unit of each parameter of each effect.
    """
    up = orientations(device)
    tables = []
    for effect, sessions in (block.get("by_session") or {}).items():
        if len(sessions) < 2:
            continue
        names = list(dict.fromkeys(name for fitted in sessions.values() for name in fitted))
        rows = []
        for name in names:
            display = data_sheet((units.get(effect) or {}).get(name))
            cells = [fitted.get(name) or {} for fitted in sessions.values()]
            rows.append(
                (
                    name,
                    display.unit,
                    *(_cell(c, display.factor) for c in cells),
                    number(_largest_difference(cells), 2),
                )
            )
        heads = (f"{s}, {up[s]}" if s in up else s for s in sessions)
        tables.append(
            Table(
                f"{sensor.capitalize()}: {effect}, fitted to each session alone, value ± 1 σ",
                ("Parameter", "Unit", *heads, "Largest difference, σ"),
                tuple(rows),
                "An effect of the bias alone has the same parameters in every attitude. Where two "
                "sessions differ by many σ, the scale factor changes too (the axis that points up "
                "differs from the others), or the cause is another one that went along.",
            )
        )
    return tables


def _cell(fitted, factor):
    value, std = fitted.get("value"), fitted.get("std")
    if missing(value):
        return NO_NUMBER
    return with_sigma(value * factor, None if missing(std) else std * factor)


def _largest_difference(cells):
    """Return the largest difference of two estimates in units of its standard error."""
    known = [
        (c["value"], c["std"])
        for c in cells
        if not missing(c.get("value")) and not missing(c.get("std")) and c["std"] > 0
    ]
    return max(
        (abs(a - b) / np.hypot(s, r) for i, (a, s) in enumerate(known) for b, r in known[:i]),
        default=None,
    )


def noise_change_table(sensor, block):
    """Return the noise coefficients before and after the correction; None where not given."""
    noise = block.get("noise") or {}
    axes = [noise.get(c) or {} for c in SENSORS[sensor]]
    if not any(axes):
        return None
    rows = []
    known = quantities(sensor)
    for key in COEFFICIENTS:
        unit = known[key].sheet[0]
        rows.append(
            (
                known[key].words,
                unit.unit,
                *(
                    " → ".join(
                        coefficient_text((axis.get(stage) or {}).get(key), unit.factor)
                        for stage in ("before", "after")
                    )
                    for axis in axes
                ),
            )
        )
    return Table(
        f"{sensor.capitalize()}, static record: noise coefficients before → after the correction",
        ("Coefficient", "Unit", *XYZ),
        tuple(rows),
        "A temperature ramp that is read as bias instability B or as random walk K is the "
        "commonest mistake in noise coefficients: what the effects explain is no noise. "
        "“<”: not seen in the record, below this number with 95 % confidence.",
    )
