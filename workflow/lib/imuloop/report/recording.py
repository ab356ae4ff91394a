"""What another recording would gain, in sentences made of the numbers of the results."""

import numpy as np

from imuloop.core.errors import joined
from imuloop.core.samples import CHANNELS
from imuloop.core.units import HOUR
from imuloop.diagnose.poses import TESTABLE
from imuloop.model.effect import OUTPUT
from imuloop.plan.advice import INITIAL_REST_S, POSES
from imuloop.plan.directions import WIDE_HOLE, direction_words, largest_hole
from imuloop.report.figures.poses import pose_directions
from imuloop.report.numbers import duration, number, percent, with_unit
from imuloop.report.results import XYZ
from imuloop.report.units import MILLIRADIAN, data_sheet

# an error matters where it exceeds the noise of a mean of one second so many times
MATTERS = 2.0
# share of a standard error that one rest or turn has to take away to be worth its while
NOTICEABLE = 0.01
# a longer record is not asked for, s
LONG_RECORD = 2 * HOUR


def parameter_words(sensor, name):
    """Return a parameter in words: ``the gyroscope's z scale factor``."""
    axes = "".join(XYZ[int(i)] for i in name[1:])
    if name[0] == "T":
        return f"the {sensor}'s misalignment {axes}"
    return f"the {sensor}'s {axes} {'scale factor' if name[0] == 'K' else 'bias'}"


def first_session(device):
    """Yield that no multi_position session has enough poses to test."""
    own = [s for s in device.sessions if s.kind == "multi_position"]
    found = sum(s.poses for s in own)
    # a rejected one has its own line, which asks for the same
    if any(s.rejected for s in own) or found >= TESTABLE:
        return
    yield (
        1.0,
        f"Record a multi_position session: {duration(INITIAL_REST_S, 2)} at rest, then "
        f"about {POSES} rests of a few seconds in attitudes spread over the sphere, turned by hand "
        f"between them. Effects that the model lacks show from {TESTABLE} poses on.",
    )


def limit(device):
    """Yield the parameter that limits readings, where it matters, and what lowers its σ most."""
    now = device.diagnosis.get("next_step")
    if not now or now["ratio"] <= MATTERS or (gain := _gain(now)) < NOTICEABLE:
        return
    use = "1\u202fg" if now["sensor"] == "accelerometer" else "100\u202f°/s"
    error = data_sheet(OUTPUT[now["sensor"]]).text(now["error"], 2)
    yield (
        gain,
        f"What limits a reading most is {parameter_words(now['sensor'], now['parameter'])}: at "
        f"{use} its σ makes {error}, {number(now['ratio'], 2)} times the noise of a mean of "
        f"1\u202fs. To improve it most, {now['step']}: σ falls from "
        f"{_sigma(now, 'std', 'std_after')}.",
    )


def _gain(now):
    return 1 - now["std_after"] / now["std"] if now["std"] else 0.0


def _sigma(now, *keys):
    """Return standard errors of the parameter of a next step: ``310 to 140 ppm``."""
    unit = {"T": "rad", "K": "1", "b": OUTPUT[now["sensor"]]}[now["parameter"][0]]
    display = MILLIRADIAN if unit == "rad" else data_sheet(unit)
    return with_unit(" to ".join(display.size(now[key], 2) for key in keys), display.unit)


def hole(device):
    """Yield the region of the sphere that has no pose: a hole hides what no model has."""
    directions = pose_directions(device).get("multi_position")
    if directions is None:
        return
    up, angle = largest_hole(directions)
    degrees = np.degrees(angle)
    if degrees >= WIDE_HOLE:
        yield 0.0, f"Add poses with {direction_words(up)} up: the nearest is {degrees:.0f}° away."


def enough(device):
    """Return that no standard error matters, with the one that comes nearest; empty if one does."""
    now = device.diagnosis.get("next_step")
    if not now or (now["ratio"] > MATTERS and _gain(now) >= NOTICEABLE):
        return ""
    known = f"{parameter_words(now['sensor'], now['parameter'])}, {_sigma(now, 'std')}"
    if now["ratio"] <= MATTERS:
        return (
            "The calibration is precise enough: at 1\u202fg and 100\u202f°/s none of its σ makes "
            f"an error above {MATTERS:g} times the noise of a mean of 1\u202fs; the largest, "
            f"of {known}, makes {number(now['ratio'], 2)} times that noise."
        )
    return (
        f"No rest and no turn lowers the σ that matters most by as much as {percent(NOTICEABLE)}: "
        f"that of {known}."
    )


def static_record(device):
    """Yield that a longer record at rest shows flicker and walk, where only limits are known."""
    longest = max((s.quality["duration_s"] for s in device.used if s.kind == "static"), default=0.0)
    limited = {}
    for channel, axis in device.axes.items():
        for name in "BK":
            term = getattr(axis, name)
            if term.value is None and term.upper95:
                limited.setdefault(channel, []).append(name)
    if not limited or longest >= LONG_RECORD:
        return
    axes = {}
    for channel, names in limited.items():
        axes.setdefault(" and ".join(names), []).append(channel)
    words = (
        f"{names} of {'all six axes' if len(found) == len(CHANNELS) else joined(found)}"
        for names, found in axes.items()
    )
    now = f"{duration(longest, 2)} now" if longest else "there is no static session now"
    yield (
        0.0,
        f"Record {duration(LONG_RECORD, 2)} at rest ({now}): {joined([*words])} are known as "
        "upper limits only. A longer record shows them, or lowers the limits.",
    )
