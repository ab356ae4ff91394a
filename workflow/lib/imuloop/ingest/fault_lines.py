"""The lines that tell a user what is wrong in the samples: where, how much, and what to do."""

import numpy as np

from imuloop.core.errors import plural
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE

# what a thermometer beside an IMU can show, degC, and how long it may stay the same, s
PLAUSIBLE_TEMPERATURE, CONSTANT_TEMPERATURE = (-60.0, 150.0), 60.0
# rates that an IMU's log has, Hz; others are read with a warning
USUAL_RATE = (0.5, 4e4)


def warnings(figures):
    """Return one line for each kind of fault found, from quality figures with `faults`."""
    found, rate = figures["faults"], figures["rate_hz"]
    if not found:
        return []
    held = {sensor: n for sensor, n in found["rows_a_value"].items() if n > 1}
    table = [
        (
            "exactly zero on all axes",
            [f"{sensor} in {plural(n, 'row')}" for sensor, n in found["zero_rows"].items() if n],
            "padding or failed reads, no motion: crop them with time_range or take them out of "
            "the log",
        ),
        (
            "stuck at one value",
            [
                f"{name} {plural(f['rows'], 'sample')}, {plural(f['stretches'], 'time')}, first at "
                f"{f['first_s']:.6g} s"
                for name, f in found["stuck"].items()
                if f["stretches"]
            ],
            "left out as a gap: look at the cable and the driver",
        ),
        (
            "no noise at rest",
            found["silent_at_rest"],
            "a step too coarse, or firmware that holds the value: noise and bias cannot be known "
            "from this log",
        ),
        (
            "spikes of a single sample",
            [f"{name} {n}" for name, n in found["spikes"].items() if n],
            "check the wiring and the logger",
        ),
        (
            "clipped at a repeated extreme value",
            [
                f"{name} {plural(f['rows'], 'sample')} at "
                f"{' and '.join(f'{v:.6g}' for v in f['values'])} "
                f"{'m/s²' if name in ACCELERATION else 'rad/s'}"
                for name, f in found["clipped_at"].items()
                if f["values"] and not figures["clipped"].get(name)
            ],
            "rests, turns and moves with them are left out: choose a wider range or turn more "
            "slowly, and declare full_scale",
        ),
        (
            "a value is held",
            [
                f"{sensor} for {n:.3g} rows ({rate / n:.4g} Hz of new values in {rate:.4g} Hz)"
                for sensor, n in held.items()
            ],
            "log each new value once, else noise comes out wrong",
        ),
    ]
    lines = [f"{what}: {', '.join(items)}; {advice}" for what, items, advice in table if items]
    for one, other in found["copies"]:
        quantity = "acceleration" if other in ACCELERATION else "angular_rate"
        lines.append(f"{other} is a copy of {one}: see columns.{quantity}")
    lines += _temperature(figures)
    if not USUAL_RATE[0] <= rate <= USUAL_RATE[1]:
        lines.append(f"{rate:.3g} Hz is unusual for an IMU: see units.time")
    return lines + _axes(found)


def _temperature(figures):
    """Return what is wrong with a temperature that is none."""
    limits = figures["temperature_range"]
    if not limits or not np.isfinite(limits).all():
        return []
    (low, high), (least, most) = limits, PLAUSIBLE_TEMPERATURE
    if least <= low <= high <= most:
        if low < high or figures["duration_s"] < CONSTANT_TEMPERATURE:
            return []
        return [
            f"temperature is {low:.5g} degC throughout: not read, or too coarse; it can show no "
            "effect of temperature"
        ]
    hint = "counts, or failed reads"
    if least <= low - 273.15 <= high - 273.15 <= most:
        hint = "it looks like K"
    elif least <= low + 273.15 <= high + 273.15 <= most:
        hint = "it looks like degC taken as K"
    return [f"temperature from {low:.5g} to {high:.5g} degC: {hint}, see units.temperature"]


def _axes(found):
    """Return how the axes of the two sensors do not fit, and what would mend them."""
    mapping = found["axes"] and found["axes"]["mapping"]
    # one axis in two places fits nowhere, and has its own line
    if not mapping or found["copies"]:
        return []
    fits = ", ".join(
        f"{axis} as {'-' * (number < 0)}{ANGULAR_RATE[abs(number) - 1]}"
        for axis, number in zip("xyz", mapping, strict=True)
        if number
    )
    # the signed permutation that takes each axis from the one given by number and sign
    matrix = np.eye(3)[np.abs(mapping) - 1] * np.sign(mapping)[:, None]
    fault = "turned axes"
    if not all(mapping):
        fault = "swapped or mirrored axes (the turns of this log leave the others open)"
    elif np.linalg.det(matrix) < 0:
        fault = (
            "swapped or mirrored axes, a left-handed frame that no change of the acceleration "
            "alone would mend"
        )
    return [
        f"the angular rate fits the turns of gravity with {fits}: {fault}; gravity does not tell "
        "which sensor is at fault; columns.acceleration and columns.angular_rate put axes in "
        "order, and -NAME turns a sign"
    ]
