"""The next recording: by how much it would lower the standard error of each parameter."""

import numpy as np

from imuloop.calibrate.sensor_pair import BASES
from imuloop.core.samples import CHANNELS, SENSORS
from imuloop.core.units import DEGREE, HOUR
from imuloop.plan.information import RATE_IN_USE, Information
from imuloop.plan.session import (
    INITIAL_REST_S,
    MOVE_S,
    POSES,
    REST_S,
    Plan,
    full_turns,
    holes,
    planned_recording,
    turns_between,
)

# seconds of the mean whose noise an error of that output is compared with
MEAN_S = 1.0
HOLES, TURNS = (6, 12, 20), (4, 8, 16, 32, 64)
# poses before the turns
BEFORE_TURNS = HOLES[1]
# records at rest, s
STATIC_S = (2 * HOUR, 8 * HOUR)
# heating and cooling at least over this much, K
SPAN_K = 20.0


def next_recording(diagnosed):
    """Return what candidates for the next recording would do to each standard error.

    A new session has noise of its own, so its information ``Jᵀ Σ⁻¹ J`` adds to what is known: the
    inverse of the covariance of the final calibration, which all records are in. The derivative is
    that at the final calibration, Σ that of the noise model; where the residual of the poses
    exceeds its floor, it is taken to do so again. Planned poses last as long as those at hand, and
    so do turns. Takes a Diagnosed.

    Returns
    -------
    dict
        ``sensors`` {sensor: {``parameters`` {name: {unit, std, weight}}, ``candidates``}}, and
        ``turns``. A candidate holds its ``name``, ``poses``, ``duration_s``, ``up`` of its first
        pose and ``std`` {name: number or null} after it.
        ``weight`` is the error of a sensor's output at 1 g or 100 deg/s that one standard error
        makes, over the noise of a mean of one second. Empty where the noise is not known.
    """
    noise, calibration, recording = diagnosed.noise, diagnosed.calibration, diagnosed.recording
    steps, poses = [np.diff(log.t) for log in recording.logs], recording.poses
    # counts only where the noise of an axis is known from the poses alone
    rate = float(1 / np.median(np.concatenate(steps))) if steps else 1.0
    floor = noise.mean_covariance(np.array([[0.0, MEAN_S]]))[:, 0, 0]
    white = np.median(poses.variance, axis=0) / rate if len(poses) else np.zeros(6)
    floor = np.sqrt(np.where(floor > 0, floor, white))
    if not np.all(floor > 0) or poses.unknown_noise(noise, CHANNELS):
        return {}
    variance = np.median(poses.variance, axis=0) if len(poses) else floor**2
    # turns are as hasty as those at hand
    rotations = recording.rotations
    hasty = float(rotations.aliased.mean()) if len(rotations) else 0.0

    def planned(plan):
        return planned_recording(plan, calibration, variance, rate, hasty)

    known = Information.of(diagnosed)
    made = [(e, planned(plan)) for e, plan in candidate_plans(recording, calibration, known)]
    if any(recorded.poses.unknown_noise(noise, CHANNELS) for _, recorded in made):
        return {}
    after = [(e, known.std(known.of_recording(recorded))) for e, recorded in made]
    if known.recorded is not None:
        # each session has its own clock
        each = [poses.session == session for session in np.unique(poses.session)]
        seconds = sum(np.ptp([poses.start_s[at], poses.end_s[at]]) for at in each)
        entry = _entry("again", seconds, len(poses))
        after.append((entry, known.std(known.recorded)))
    weights = _weights(known, recording, floor)
    content = {sensor: _sensor(known, sensor, after, weights) for sensor in SENSORS}
    content["gyroscope"]["candidates"] += _rests(calibration.gyroscope, noise)
    turns = _turns(known, recording, calibration, floor[3:], planned) if len(poses) else {}
    return {"sensors": content, "turns": turns}


def _entry(name, duration_s, poses=0, up=None):
    """Return what the results hold of a candidate."""
    return {"name": name, "poses": poses, "duration_s": float(duration_s), "up": up}


def _habits(recording):
    """Return how long this recording's rests and moves last, or a first session's, and how warm."""
    poses, rotations = recording.poses, recording.rotations
    found = {"initial_rest_s": INITIAL_REST_S, "rest_s": REST_S, "move_s": MOVE_S}
    if len(poses) > 1 and len(rotations):
        found["initial_rest_s"] = float(poses.duration_s[0])
        found["rest_s"] = float(np.median(poses.duration_s[1:]))
        found["move_s"] = float(np.median(rotations.end_s - rotations.start_s))
    if poses.temperature is not None:
        mean = float(poses.temperature.mean())
        found["temperature"] = ((0.0, mean), (1.0, mean))
    return found


def candidate_plans(recording, calibration, known):
    """Return what to try, pairs of an entry for the results and a Plan."""
    poses, habits = recording.poses, _habits(recording)
    directions = directions_of(recording, calibration)

    def spread(name, n, **course):
        up = holes(directions, n)
        plan = Plan(up[0], turns_between(up), **habits | course)
        return _entry(name, plan.duration_s, n, up[0].tolist()), plan

    if not len(poses):
        return [spread("multi_position", POSES)]
    plans = [spread("poses", n) for n in HOLES]
    axis, up = weakest_axis(known), holes(directions, BEFORE_TURNS)
    for n in TURNS[1:3]:
        plan = full_turns(axis, n, up, **habits)
        plans.append((_entry("turns", plan.duration_s, len(up), up[0].tolist()), plan))
    warm = any("temperature" in effect.needs for effect in known.about.effects)
    if "temperature" in habits and warm:
        low, high = poses.temperature.min(), poses.temperature.max()
        rise = max(SPAN_K, high - low)
        course = ((0.0, low), (0.5, low + rise), (1.0, low))
        entry, plan = spread("heat_and_cool", HOLES[-1], temperature=course)
        plans.append((entry | {"span_K": float(rise)}, plan))
    return plans


def directions_of(recording, calibration):
    """Return the upward direction of each pose that feels any, shape (n, 3), without effects."""
    f = calibration.accelerometer.aligned(recording.poses.f)
    norm = np.linalg.norm(f, axis=1)
    return f[norm > 0] / norm[norm > 0, None]


def weakest_axis(known):
    """Return the axis whose scale factor is known worst; the first that is not known at all."""
    std = known.std()
    return max(range(3), key=lambda i: std[f"gyroscope.K{i}"] or np.inf)


def _sensor(known, sensor, after, weights):
    """Return parameters and candidates of a sensor; `after` are an entry and standard errors."""
    before, about, prefix = known.std(), known.about, f"{sensor}."
    names = {n: n.removeprefix(prefix) for n in about.names if n.startswith(prefix)}
    units, parameters = dict(zip(about.names, about.units, strict=True)), {}
    for name, own in names.items():
        std, weight = before[name], weights.get(name)
        weight = None if std is None or weight is None else float(std * weight)
        parameters[own] = {"unit": units[name], "std": std, "weight": weight}
    candidates = [
        entry | {"std": {own: std[name] for name, own in names.items()}} for entry, std in after
    ]
    return {"parameters": parameters, "candidates": candidates}


def _weights(known, recording, floor):
    """Return the error of the output that one unit of each parameter makes, over its noise.

    Takes the standard deviation of that, (6,). By name; what this recording does not show has none.
    """
    about, found = known.about, {}
    model = about.model(recording) if about.effects else None
    for k, (sensor, base) in enumerate(BASES.items()):
        own = floor[3 * k : 3 * k + 3]
        use = about.pair.gravity if sensor == "accelerometer" else RATE_IN_USE
        for name in base:
            found[f"{sensor}.{name}"] = (1.0 if name[0] == "b" else use) / own[int(name[1])]
        at = model.own[sensor][len(base) :] if model else ()
        if not len(at):
            continue
        # of an effect the root mean square of what it does in this recording, where it does most
        designs = [model.force.design]
        if sensor == "gyroscope":
            turn = model.turn
            designs = [turn.rate_design, turn.rotation_design.reshape(-1, 3, len(at))]
        sizes = [np.sqrt((design**2).sum(axis=1).mean(axis=0)) for design in designs]
        for place, size in zip(at, np.max(sizes, axis=0), strict=True):
            found[about.names[place]] = size / own.mean()
    return found


def _rests(gyroscope, noise):
    """Return what hours at rest would add where the bias comes from rests alone."""
    entries = []
    for seconds in STATIC_S if gyroscope.method == "static" else ():
        mean = noise.mean_covariance(np.array([[0.0, seconds]]))[3:, 0, 0]
        now = {name: std * gyroscope.raw_unit.scale for name, std in gyroscope.std.items()}
        after = {n: float((s**-2 + 1 / mean[int(n[1])]) ** -0.5) for n, s in now.items()}
        entries.append(_entry("static", seconds) | {"std": after})
    return entries


def _turns(known, recording, calibration, floor, planned):
    """Return how many full turns show the scale factor of the axis that is known worst.

    ``axis``; ``std`` now; ``level``, the error of the scale factor that at 100 deg/s is the noise
    of a mean of one second; ``turns``, after some ``poses``, and ``std_after``: the fewest that
    reach it, or the most that were tried; ``turned_deg`` in all, ``largest_deg`` and ``mean_deg_s``
    about each axis in the recording.
    """
    i = weakest_axis(known)
    level = float(floor[i] / RATE_IN_USE)
    angles, speeds, rotations = np.zeros((1, 3)), np.zeros((1, 3)), recording.rotations
    if rotations is not None and len(rotations):
        rates = calibration.gyroscope.output(rotations.w)
        mean = (rates[:, 1:] + rates[:, :-1]) / 2
        angles = np.abs((mean * rotations.steps[..., None]).sum(axis=1)) / DEGREE
        speeds = angles / (rotations.end_s - rotations.start_s)[:, None]
    found = {
        "axis": "xyz"[i],
        "std": known.std()[f"gyroscope.K{i}"],
        "level": level,
        "turned_deg": angles.sum(axis=0).tolist(),
        "largest_deg": angles.max(axis=0).tolist(),
        # a rotation counts for an axis by its angle about it
        "mean_deg_s": ((angles * speeds).sum(axis=0) / np.maximum(angles.sum(axis=0), 1)).tolist(),
    }
    up = holes(directions_of(recording, calibration), BEFORE_TURNS)
    for n in TURNS:
        plan = full_turns(i, n, up, **_habits(recording))
        after = known.std(known.of_recording(planned(plan)))[f"gyroscope.K{i}"]
        found |= {"poses": len(up), "turns": n, "std_after": after}
        if after is not None and after <= level:
            break
    return found
