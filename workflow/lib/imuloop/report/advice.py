"""What would help most and what next, as ``section.html.j2`` says them, from the numbers."""

import re

import numpy as np

from imuloop.core.errors import joined, plural
from imuloop.core.samples import TEMPERATURE, TIME
from imuloop.core.units import DEGREE, EARTH_RATE
from imuloop.report.numbers import number
from imuloop.report.recording import (
    enough,
    first_session,
    hole,
    limit,
    static_record,
)
from imuloop.report.verdict import (
    ABOVE,
    PARTS,
    block_of,
    blocks,
    left_over,
    misfit,
    shown,
    undersampled,
)

# share of the moves that a knock has to spoil for the others to be under suspicion
MANY = 0.1
# share of the rests above which those that are too short are worth a step
MANY_SHORT = 0.2
# the most sentences per device
MOST = 5
# span of a temperature that says anything, K, and the correlation with time from which on it and
# time are the same to a fit
SPAN_K, MONOTONE = 2.0, 0.9
_EARTH = (
    " The horizontal rate of the Earth, up to 15 °/h by latitude, turns with the heading and is in "
    "no model here: it may be all of this."
)

# what a person can do about a residual
_KNOCK = (
    "Low-pass the accelerometer below half the rate of the log, and set the device down softly: a "
    "knock between two samples is velocity that nobody sees."
)
_LOOK = "Look in the pictures for poses or times that stand out."
_LOOK_BESIDE = (
    "See in the picture when it is large. In fast turns suspect the filters and the full scale of "
    "both, in some attitudes markers that are hidden or slip, all along the smoothing of the "
    "reference."
)


def what_next(block):
    """Return what a person can do about the residual that is left."""
    moves = block.get("moves", {})
    if moves.get("left_out", 0) > MANY * moves.get("all", 0):
        return _KNOCK
    return _LOOK_BESIDE if "set_up" in block else _LOOK


def next_steps(device):
    """Return what would help most, a sentence each.

    What is wrong with a recording comes first, hours at rest come last: they show noise alone.
    Among equals what gains most is first. The gain is a share: of a standard error, of a residual
    above its floor, of an upper limit; what is not known at all, for want of a recording, gains all
    of it.
    """
    mend = (_rejected, _doubted, first_session, _clipped, _short_rests, _tilted_rests)
    record = (_unexplained, limit, hole, _heat_and_cool)
    ranks = mend, record, (static_record,)
    # what is wrong with a log or its entry makes every other number doubtful
    misdeclared = any(s.quality["misdeclared"] for s in device.sessions)
    if misdeclared:
        ranks = ((_rejected,),)
    steps = []
    for sources in ranks:
        found = [step for source in sources for step in source(device)]
        steps += [text for _, text in sorted(found, key=lambda step: -step[0])]
    steps, last = steps[:MOST], not misdeclared and enough(device)
    if not steps:
        return [f"Nothing needed. {last}" if last else "See why a verdict is not testable, above."]
    return [*steps[: MOST - 1], last] if last else steps


def _rejected(device):
    for s in device.sessions:
        if s.rejected:
            text = (
                f"Record session {s.name}, which was rejected, again, or correct what is declared "
                "of it."
            )
            if s.quality["misdeclared"]:
                text = (
                    f"Correct what is declared of session {s.name}, which was rejected, and run "
                    "again, before anything else."
                )
            yield 1.0, text


def _doubted(device):
    for s in device.used:
        for text in s.quality["warnings"]:
            # as a config, the command line or Python names it
            if re.search(r"see (units|--\S+-unit)", text):
                yield 1.0, f"Check what is declared of session {s.name}: {text}."


def _short_rests(device):
    for s in device.used:
        short, rests = s.segmentation.get("short_rests", 0), (s.segments["pose"] >= 0).sum()
        used = s.segmentation.get("shorter")
        if used or short > MANY_SHORT * (short + rests):
            text = f"{plural(short, 'rest')} of session {s.name} are too short"
            if used:
                settings = " and ".join(f"{key} {value:g}" for key, value in used.items())
                text += f", so {settings} were used"
            yield short / (short + rests), f"{text}: hold each for 4 s or more."


def _tilted_rests(device):
    for s in device.used:
        tilted, rests = s.segmentation.get("tilted_rests", 0), (s.segments["pose"] >= 0).sum()
        if tilted > MANY * rests:
            largest = s.segments["tilt_rad"].max() / DEGREE
            how = "lay it on a table, or in a corner, instead of holding it in the hand"
            if not s.segmentation["hand_held"]:
                how = "wait 3 s after you put it down, or lay it on something hard"
            # such a rest says nothing of the gyroscope's bias
            yield (
                1 - np.sqrt(1 - min(tilted / rests, 1.0)),
                f"In {tilted} of {rests} rests of session {s.name} the device tilts, by up to "
                f"{number(largest, 2)}°: {how}.",
            )


def _unexplained(device):
    found, text = undersampled(block_of(device.diagnosis, "gyroscope"))
    if found:
        yield 1 - found["others"] / np.hypot(found["error"], found["others"]), text
    of_both = {}
    for sensor, part, block in blocks(device.diagnosis):
        if block["verdict"] not in ABOVE:
            continue
        lacks = (
            f"{sensor.capitalize()}, {PARTS[part]}: something that the model lacks is in the data"
        )
        force = block_of(device.diagnosis, "accelerometer")
        if sensor == "gyroscope" and part == "poses" and force["verdict"] in ABOVE:
            yield (
                0.0,
                f"{lacks}, or in the accelerometer's, which is above its floor too and gives "
                "the direction of gravity: mend that first.",
            )
            continue
        _, residual = left_over(sensor, block)
        after, floor = residual["after"], residual["floor"]
        gain, size, earth = 1 - floor / after if after else 0.0, misfit(block), ""
        held, least = (shown(residual, key, 2) for key in ("after", "floor"))
        if part == "reference":
            of_both.setdefault(what_next(block), []).append((gain, f"{sensor} {held} ({least})"))
            continue
        if gain > 0:
            size = f" Held-out error {held}, floor {least}."
            if sensor == "gyroscope" and residual["unit"] == "rad/s":
                earth = _EARTH if after**2 - floor**2 < EARTH_RATE**2 else ""
        yield max(gain, 0.0), f"{lacks}.{size}{earth} {what_next(block)}"
    for text, found in of_both.items():
        gains, sizes = zip(*found, strict=True)
        yield (
            max(*gains, 0.0),
            "Beside a reference something is left, of the sensor or of the reference. Held-out "
            f"error (floor): {', '.join(sizes)}. {text}",
        )


def _clipped(device):
    for s in device.used:
        counts = {k: v for k, v in s.quality["clipped"].items() if v}
        seen = s.quality["faults"].get("clipped_at", {})
        counts |= {k: f["rows"] for k, f in seen.items() if k not in counts and f["values"]}
        if counts:
            listed = joined([f"{plural(n, 'sample')} of {name}" for name, n in counts.items()])
            rests = s.segmentation.get("railed_rests")
            which = f"{plural(rests, 'rest')}, and turns and moves" if rests else "Turns and moves"
            yield (
                1.0,
                f"Session {s.name}: {listed} lie at the end of the range. {which} with one are "
                "left out; choose a wider range or turn more slowly, and record it again.",
            )


def _heat_and_cool(device):
    found = []
    for session in device.used:
        if TEMPERATURE not in session.samples:
            continue
        warmth = session.samples[TEMPERATURE]
        known = np.flatnonzero(np.isfinite(warmth))
        few = known[:: max(1, len(known) // 2000)]
        if len(few) < 3 or np.ptp(warmth[few]) < SPAN_K:
            continue
        r = float(np.corrcoef(session.samples[TIME][few], warmth[few])[0, 1])
        if abs(r) < MONOTONE:
            # one record in which each temperature came twice is enough
            return
        found.append((np.ptp(warmth[few]), r, session.name, warmth[few]))
    if not found:
        return
    _, r, name, warmth = max(found, key=lambda f: f[0])
    low, high = np.quantile(warmth, [0.005, 0.995])
    span = f"{number(low, 3)} to {number(high, 3)}\u202f°C"
    yield (
        1 - np.sqrt(max(1 - r**2, 1e-6)),
        f"Heat and cool: in session {name} the temperature only {'rose' if r > 0 else 'fell'} "
        f"({span}, correlation with time {number(r, 2)}), so that what follows it and what follows "
        f"time can hardly be told apart. Go from {span} and back, twice, within one record.",
    )
