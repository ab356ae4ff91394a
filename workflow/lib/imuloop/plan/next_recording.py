"""The next recording: by how much it would lower the standard error of each parameter."""

import numpy as np

from imuloop.core.samples import CHANNELS
from imuloop.core.units import DEGREE, HOUR
from imuloop.plan.outlook import outlook
from imuloop.plan.planned import (
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

# what a parameter's error is weighed with: the sensor's output in use
USE = {"accelerometer": None, "gyroscope": 100 * DEGREE}
# seconds of the mean whose noise an error of that output is compared with
MEAN_S = 1.0
HOLES, TURNS = (6, 12, 20), (4, 8, 16, 32, 64)
# poses before the turns
BEFORE_TURNS = HOLES[1]
STATIC_H = (2.0, 8.0)
# heating and cooling at least over this much, K
SPAN_K = 20.0


def next_recording(models, solutions, calibration, recording):
    """Return what candidates for the next recording would do to each standard error.

    A new session has noise of its own, so its information ``Jᵀ Σ⁻¹ J`` adds to that of the fit.
    The derivative is that of the present solution, the covariance that of the noise model; where
    the residual exceeds its floor, it is taken to do so again. Planned poses last as long as those
    at hand, and so do turns.

    Parameters
    ----------
    models, solutions : dict
        AccelerometerPoses and GyroscopePoses, and a Solution or None, by sensor.
    calibration : Calibration
        The final one.
    recording : Recording
        Poses and rotations of the multi-position sessions, of which there may be none.

    Returns
    -------
    dict
        ``sensors`` {sensor: {``parameters`` {name: {unit, std, weight}}, ``candidates``,
        ``excess``, the reduced chi square in all standard errors}} and ``turns``. A candidate
        holds its ``name``, ``poses``, ``turns``, ``axis``, ``duration_s``, ``up`` of its first
        pose and ``std`` {name: number or null} after it. ``weight`` is the error of a sensor's
        output at 1 g or 100 deg/s that one standard error makes, over the noise of a mean of one
        second. Empty where the noise is not known.
    """
    steps = [np.diff(log.t) for log in recording.logs]
    # counts only where the noise of an axis is known from the poses alone
    rate = float(1 / np.median(np.concatenate(steps))) if steps else 1.0
    noise = models["accelerometer"].noise
    floor = noise_floor(noise, recording.poses, rate)
    if not np.all(floor > 0) or recording.poses.unknown_noise(noise, CHANNELS):
        return {}
    views = {
        sensor: outlook(
            models[sensor],
            solutions[sensor],
            getattr(calibration, sensor),
            calibration.accelerometer,
            recording,
        )
        for sensor in models
    }
    variance = np.median(recording.poses.variance, axis=0) if len(recording.poses) else floor**2
    plans = candidate_plans(recording, calibration, views)

    def planned(plan):
        return planned_recording(plan, calibration, variance, rate)

    made = [(entry, planned(plan)) for entry, plan in plans]
    if any(recorded.poses.unknown_noise(noise, CHANNELS) for _, recorded in made):
        return {}
    content = {
        sensor: _sensor(view, made, recording, calibration, floor[3 * k : 3 * k + 3])
        for k, (sensor, view) in enumerate(views.items())
    }
    content["gyroscope"]["candidates"] += _rests(calibration.gyroscope, noise)
    return {
        "sensors": content,
        "turns": _turns(
            views["gyroscope"],
            content["gyroscope"],
            recording,
            calibration,
            floor[3:],
            planned,
        ),
    }


def noise_floor(noise, poses, rate):
    """Return the standard deviation of a mean of one second on each channel, shape (6,), SI."""
    variance = noise.pose_mean_covariance(np.array([[0.0, MEAN_S]]))[:, 0, 0]
    white = np.median(poses.variance, axis=0) / rate if len(poses) else np.zeros(6)
    return np.sqrt(np.where(variance > 0, variance, white))


def habits(recording):
    """Return how long this recording's rests and moves last, those of a first session without."""
    poses, rotations = recording.poses, recording.rotations
    if len(poses) < 2 or not len(rotations):
        return {"initial_rest_s": INITIAL_REST_S, "rest_s": REST_S, "move_s": MOVE_S}
    return {
        "initial_rest_s": float(poses.duration_s[0]),
        "rest_s": float(np.median(poses.duration_s[1:])),
        "move_s": float(np.median(rotations.end_s - rotations.start_s)),
    }


def candidate_plans(recording, calibration, views):
    """Return what to try, pairs of an entry for the results and a Plan."""
    poses, as_before = recording.poses, habits(recording)
    temperature = _constant(poses)
    directions = directions_of(recording, calibration)

    def spread(name, n, warmth=temperature):
        up = holes(directions, n)
        plan = Plan(up[0], turns_between(up), **as_before, temperature=warmth)
        entry = {"name": name, "poses": n, "turns": 0, "axis": None}
        return {**entry, "duration_s": plan.duration_s, "up": up[0].tolist()}, plan

    if not len(poses):
        return [spread("multi_position", POSES)]
    plans = [spread("poses", n) for n in HOLES]
    axis = weakest_axis(views["gyroscope"])
    up = holes(directions, BEFORE_TURNS)
    for n in TURNS[1:3]:
        plan = full_turns(axis, n, up, **as_before, temperature=temperature)
        entry = {"name": "turns", "poses": len(up), "turns": n, "axis": "xyz"[axis]}
        plans.append(({**entry, "duration_s": plan.duration_s, "up": up[0].tolist()}, plan))
    warm = any("temperature" in e.needs for v in views.values() for e in v.solution.effects)
    if warm and temperature:
        low, high = poses.temperature.min(), poses.temperature.max()
        rise = max(SPAN_K, high - low)
        course = ((0.0, low), (0.5, low + rise), (1.0, low))
        entry, plan = spread("heat_and_cool", HOLES[-1], course)
        plans.append(({**entry, "span_K": float(rise)}, plan))
    return plans


def _constant(poses):
    """Return the course of a session at the mean temperature of poses, none if it is unknown."""
    if poses.temperature is None:
        return ()
    mean = float(poses.temperature.mean())
    return ((0.0, mean), (1.0, mean))


def directions_of(recording, calibration):
    """Return the upward direction of each pose that feels any, shape (n, 3), without effects."""
    force = calibration.accelerometer
    f = force.output(recording.poses.f) @ force.T.T
    norm = np.linalg.norm(f, axis=1)
    return f[norm > 0] / norm[norm > 0, None]


def weakest_axis(view):
    """Return the axis whose scale factor is known worst; the first that is not known at all."""
    std = view.std()
    return max(range(3), key=lambda i: std[f"K{i}"] or np.inf)


def _sensor(view, made, recording, calibration, floor):
    """Return parameters and candidates of a sensor."""
    before = view.std()
    own = getattr(calibration, view.model.sensor)
    if view.solution.fit.dof == 0:
        # what another method found counts until poses determine more
        factor = {"K": 1 / own.raw_unit.scale, "b": own.raw_unit.scale}
        before |= {n: s * factor.get(n[0], 1.0) for n, s in own.std.items() if n in before}
    weights = _weights(view, recording, calibration, floor)
    units = {"T": "rad", "K": "1", "b": _OUTPUT[view.model.sensor]}
    effect_units = {
        f"{effect.name}.{p}": unit
        for effect in view.solution.effects
        for p, unit in effect.units(view.model.sensor).items()
    }
    parameters = {
        name: {
            "unit": effect_units.get(name) or units[name[0]],
            "std": before[name],
            "weight": None if before[name] is None else float(before[name] * weights[name]),
        }
        for name in view.names
    }
    candidates = [{**entry, "std": view.std(view.adds(plan))} for entry, plan in made]
    if len(recording.poses) and np.any(view.information):
        poses = recording.poses
        # each session has its own clock
        own = [poses.session == session for session in np.unique(poses.session)]
        duration = float(sum(np.ptp([poses.start_s[at], poses.end_s[at]]) for at in own))
        entry = {"name": "again", "poses": len(recording.poses), "turns": 0, "axis": None}
        entry |= {"duration_s": duration, "up": None, "std": view.std(view.information)}
        candidates.append(entry)
    return {"excess": view.excess, "parameters": parameters, "candidates": candidates}


_OUTPUT = {"accelerometer": "m/s^2", "gyroscope": "rad/s"}


def _weights(view, recording, calibration, floor):
    """Return the error of the output that one unit of each parameter makes, over its noise."""
    sensor = view.model.sensor
    use = USE[sensor] or calibration.gravity
    weights = {}
    for name in view.names:
        if "." not in name:
            weights[name] = (1.0 if name[0] == "b" else use) / floor[int(name[1])]
    width = len(view.names) - len(weights)
    if width:
        # an effect: the root mean square of what it does in this recording
        sizes = view.model.effect_sizes(view.solution, recording)
        rest = [name for name in view.names if "." in name]
        weights |= dict(zip(rest, (sizes / floor.mean()).tolist(), strict=True))
    return weights


def _rests(gyroscope, noise):
    """Return what hours at rest would add where the bias comes from rests alone."""
    if gyroscope.method != "static":
        return []
    unit = gyroscope.raw_unit
    now = {name: std * unit.scale for name, std in gyroscope.std.items()}
    entries = []
    for hours in STATIC_H:
        window = np.array([[0.0, hours * HOUR]])
        mean = noise.pose_mean_covariance(window)[3:, 0, 0]
        after = {
            name: float((std**-2 + 1 / mean[int(name[1])]) ** -0.5) for name, std in now.items()
        }
        entry = {"name": "static", "poses": 0, "turns": 0, "axis": None, "up": None}
        entries.append({**entry, "duration_s": hours * HOUR, "std": after})
    return entries


def _turns(view, content, recording, calibration, floor, planned):
    """Return how many full turns show the scale factor of the axis that is known worst.

    Returns
    -------
    dict
        ``axis``; ``std`` now; ``level``, the error of the scale factor that at 100 deg/s is the
        noise of a mean of one second; ``turns``, after some ``poses``, and ``std_after``: the
        fewest that reach it, or the most that were tried; ``turned_deg`` in all, ``largest_deg``
        and ``mean_deg_s`` about each axis in the recording. Empty without a pose.
    """
    if not len(recording.poses):
        return {}
    i = weakest_axis(view)
    level = float(floor[i] / USE["gyroscope"])
    angles, speeds = np.zeros((1, 3)), np.zeros((1, 3))
    if recording.rotations is not None and len(recording.rotations):
        rotations = recording.rotations
        k, b = view.solution.fit.x[6:9], view.solution.fit.x[9:12]
        rates = k * (rotations.w - b)
        mean = (rates[:, 1:] + rates[:, :-1]) / 2
        angles = np.abs((mean * rotations.steps[..., None]).sum(axis=1)) / DEGREE
        speeds = angles / (rotations.end_s - rotations.start_s)[:, None]
    found = {
        "axis": "xyz"[i],
        "std": content["parameters"][f"K{i}"]["std"],
        "level": level,
        "turned_deg": angles.sum(axis=0).tolist(),
        "largest_deg": angles.max(axis=0).tolist(),
        # a rotation counts for an axis by its angle about it
        "mean_deg_s": ((angles * speeds).sum(axis=0) / np.maximum(angles.sum(axis=0), 1)).tolist(),
        "turns": None,
        "std_after": None,
    }
    as_before = {**habits(recording), "temperature": _constant(recording.poses)}
    up = holes(directions_of(recording, calibration), BEFORE_TURNS)
    for n in TURNS:
        plan = full_turns(i, n, up, **as_before)
        after = view.std(view.adds(planned(plan)))[f"K{i}"]
        found |= {"poses": len(up), "turns": n, "std_after": after}
        if after is not None and after <= level:
            break
    return found
