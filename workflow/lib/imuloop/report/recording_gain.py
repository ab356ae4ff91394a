"""What another recording would gain, in sentences made of the diagnosis' expected σ."""

import numpy as np

from imuloop.report.numbers import duration, joined, missing, number, percent
from imuloop.report.pose_plot import largest_hole, pose_directions
from imuloop.report.recording_words import (
    attitude_words,
    candidate_words,
    parameter_words,
    sigma_words,
)
from imuloop.report.results import SENSORS, XYZ
from imuloop.report.verdict import ABOVE, block_of, verdict_of

# an error matters where it exceeds the noise of a mean of one second so many times
MATTERS = 2.0
# a hole in the attitudes covered that is worth another pose, degrees
WIDE_HOLE = 50.0
# share of a standard error that has to go before a recording is worth its while
NOTICEABLE = 0.1
# the largest rotation about an axis that is not small, degrees, and the least mean rate of
# rotations that is not slow, deg/s
SMALL_TURN, SLOW = 90.0, 10.0


def plans(device, sensor):
    """Return parameters and candidates of the next recording of a sensor."""
    content = (device.diagnosis.get("next_recording") or {}).get("sensors") or {}
    found = content.get(sensor) or {}
    return found.get("parameters") or {}, found.get("candidates") or []


def _drops(device, chosen=lambda entry: True, least=MATTERS):
    """Return (share lost, sensor, parameter, candidate), most first; weights above the least."""
    found = []
    for sensor in SENSORS:
        parameters, candidates = plans(device, sensor)
        for entry in filter(chosen, candidates):
            for name, after in entry["std"].items():
                now = parameters.get(name) or {}
                if missing(after) or missing(now.get("weight")) or now["weight"] <= least:
                    continue
                found.append((1 - after / now["std"], sensor, name, entry))
    return sorted(found, key=lambda drop: -drop[0])


def _fall(device, sensor, name, entry):
    """Return how the standard error of a parameter falls with a candidate."""
    now = plans(device, sensor)[0][name]
    values = sigma_words(now["unit"], now["std"], entry["std"][name])
    return f"{parameter_words(sensor, name)} from {values}"


def first_session(device):
    """Yield that there is no multi_position session, and what one would give."""
    if any(s.kind == "multi_position" for s in device.used):
        return
    # a rejected one has its own line, which asks for the same
    if any(s.kind == "multi_position" for s in device.sessions):
        return
    # loads for half a second, and most devices have such a session
    from imuloop.plan.session import INITIAL_REST_S, POSES

    gains = []
    for sensor in SENSORS:
        _, candidates = plans(device, sensor)
        after = next((c["std"] for c in candidates if c["name"] == "multi_position"), {})
        for letter, words, unit in (("K", "scale factor", "1"), ("T", "misalignment", "rad")):
            known = [s for name, s in after.items() if name[0] == letter and not missing(s)]
            if known:
                gains.append(f"the {sensor}'s {words} to {sigma_words(unit, max(known))}")
    expected = f" It would give {joined(gains)} (1 σ, the worst axis)." if gains else ""
    yield (
        1.0,
        f"Record a multi_position session: {duration(INITIAL_REST_S, 2)} at rest, then about "
        f"{POSES} rests of a few seconds in attitudes spread over the sphere, turned by hand "
        "between them."
        f"{expected} Without it misalignment and the gyroscope's scale factor stay unknown.",
    )


def best_recording(device):
    """Yield the recording that would lower a standard error most, of those that matter."""
    drops = _drops(device)
    if not drops or drops[0][0] < NOTICEABLE:
        return
    gain, sensor, name, entry = drops[0]
    # these have sentences of their own, which say why
    if entry["name"] in ("multi_position", "turns"):
        return
    if entry["name"] == "poses" and any(hole(device)):
        return
    yield (
        gain,
        f"The next recording that helps most: {candidate_words(entry)} would lower σ of "
        f"{_fall(device, sensor, name, entry)}.",
    )


def hole(device):
    """Yield the region of the sphere that has no pose, and what poses there would do."""
    directions = [u for kind, u in pose_directions(device).items() if kind == "multi_position"]
    if not directions:
        return
    up, angle = largest_hole(np.concatenate(directions))
    degrees = np.degrees(angle)
    if degrees < WIDE_HOLE:
        return
    text = f"Add poses with {attitude_words(up)}: the nearest is {degrees:.0f}° away."

    def poses(entry):
        return entry["name"] == "poses"

    # where nothing matters the gain is that of any parameter: a hole hides what no model has, too
    drops = _drops(device, poses) or _drops(device, poses, least=0.0)
    if drops and drops[0][0] >= NOTICEABLE:
        gain, sensor, name, entry = drops[0]
        fall = _fall(device, sensor, name, entry)
        text += (
            f" {entry['poses']} poses there and in the next largest holes would lower σ of {fall}."
        )
        yield gain, text
    else:
        yield 0.0, text


def turns_needed(device):
    """Yield how many turns show the gyroscope's scale factor, where it matters."""
    turns = (device.diagnosis.get("next_recording") or {}).get("turns") or {}
    now, after, level = (turns.get(k) for k in ("std", "std_after", "level"))
    if missing(after) or missing(level) or (not missing(now) and now <= MATTERS * level):
        return
    # where the fit is bad σ is large for that, and more turns are no answer
    if verdict_of(block_of(device.diagnosis, "gyroscope")) in ABOVE and not missing(now):
        return
    axis = turns["axis"]
    i = XYZ.index(axis)
    gain = 1.0 if missing(now) else 1 - after / now
    if gain < NOTICEABLE:
        return
    known = "unknown" if missing(now) else f"known to {sigma_words('1', now)}"
    figures = ("turned_deg", "largest_deg", "mean_deg_s")
    turned, largest, rate = (number(turns[k][i], 2) for k in figures)
    size = "few" if turns["largest_deg"][i] > SMALL_TURN else "small"
    size = "slow" if turns["mean_deg_s"][i] < SLOW else size
    yield (
        gain,
        f"The rotations about {axis} are too {size} to show the gyroscope's scale factor there "
        f"({known}): {turned}° in all, {largest}° in the largest, {rate}\u202f°/s in "
        f"the mean. A session of {turns['poses']} "
        f"poses in the largest holes of the sphere, then {turns['turns']} turns of 360° about "
        f"{axis}, both ways, with {axis} level, would bring σ to {sigma_words('1', after)}; "
        f"{sigma_words('1', level)} are, at 100\u202f°/s, the noise of a mean of 1\u202fs.",
    )


def enough(device):
    """Return that no standard error matters, with the one that comes nearest; empty if one does."""
    weights = [
        (now["weight"], sensor, name, now)
        for sensor in SENSORS
        for name, now in plans(device, sensor)[0].items()
        if not missing(now.get("weight"))
    ]
    scales = {(sensor, name) for _, sensor, name, _ in weights if name[0] == "K"}
    drops = _drops(device)
    if len(scales) < 2 * len(XYZ) or (drops and drops[0][0] >= NOTICEABLE):
        return ""
    weight, sensor, name, now = max(weights, key=lambda w: w[0])
    known = f"{parameter_words(sensor, name)}, {sigma_words(now['unit'], now['std'])}"
    if weight <= MATTERS:
        return (
            "Enough poses and turns: at 1\u202fg and 100\u202f°/s no σ of the calibration makes an "
            f"error above {MATTERS:g} times the noise of a mean of 1\u202fs; the largest, of "
            f"{known}, makes {number(weight, 2)} times that noise."
        )
    return (
        "No recording that was tried lowers a σ that matters by as much as "
        f"{percent(NOTICEABLE)}; the largest is that of {known}."
    )
