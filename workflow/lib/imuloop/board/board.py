"""A board: how its devices lie to each other, and of which of them an error is."""

import numpy as np

# the library of effects joins by being loaded
import imuloop.effects  # noqa: F401
from imuloop.board.agreement import mean, own_parts, readings
from imuloop.board.geometry import poses
from imuloop.board.shared import read_shared
from imuloop.core.errors import ImuloopError
from imuloop.core.files import read_json
from imuloop.core.model import Calibration
from imuloop.core.noise_model import NoiseModel

# probability that anything is said to differ where nothing does
SIGNIFICANCE = 0.05
# of each sensor: in what devices are compared, and in what all may be wrong alike
TESTS = {"gyroscope": ("turn", "closure"), "accelerometer": ("gravity_norm", "gravity_norm")}
TWO = "two devices differ: a third would show which one is wrong"
SLOW = "noise as slow as the rests allow could be it: a longer rest would tell"


def no_board(name, why):
    """Return the content of board.json where nothing can be said, with the reason."""
    nothing = {"reference": None, "sessions": {}, "devices": {}, "common": {}}
    return {"format": 1, "board": name, "status": "not_testable", "why": why, **nothing}


def relate(name, devices):
    """Return the content of board.json, from devices (`chain.Device`) that were diagnosed.

    Of their sessions of one name, recorded at the same time, the one with the most motion is used.
    """
    content, found = no_board(name, "no session that its devices share"), {}
    used = []
    for device in devices:
        if "ok" in [read_json(s["quality"])["status"] for s in device.sessions.values()]:
            used.append(device)
        else:
            content["devices"][device.name] = {"why": "all its sessions were rejected"}
    if len(used) < 2:
        return content | {"why": f"{len(used)} of its devices with a log, two needed"}
    calibrations = [Calibration.from_json(d.file("calibration.json")) for d in used]
    for session in dict.fromkeys(s for device in used for s in device.kinds):
        try:
            if lacking := [device.name for device in used if session not in device.kinds]:
                raise ImuloopError(f"{', '.join(lacking)} has no session of this name")
            found[session] = read_shared(session, used, calibrations)
            content["sessions"][session] = {"why": "another has more motion"}
        except ImuloopError as error:
            content["sessions"][session] = {"why": str(error)}
    if not found:
        return content
    session, shared = max(found.items(), key=lambda each: each[1].moving.sum())
    counts = {"rests": len(shared.rests), "moves": len(shared.moves)}
    content["sessions"][session] = {"why": None, **counts}
    try:
        placed = poses(shared, calibrations)
    except ImuloopError as error:
        return content | {"why": str(error)}
    content["devices"] |= {d.name: dict(vars(p)) for d, p in zip(used, placed, strict=True)}
    turns = np.array([pose.rotation for pose in placed])
    shown = []
    for i, (device, calibration) in enumerate(zip(used, calibrations, strict=True)):
        noise = NoiseModel.from_json(device.file("noise.json"))
        known = turns, i, device.gravity, calibration
        shown.append([readings(shared, *known, each) for each in (noise, _slowest(noise))])
    for sensor, kinds in TESTS.items():
        known = {}
        for device, calibration, pair in zip(used, calibrations, shown, strict=True):
            if why := _untested(getattr(calibration, sensor), [pair[0][kind] for kind in kinds]):
                content["devices"][device.name][kinds[0]] = {"verdict": "not_testable", "why": why}
            else:
                known[device.name] = pair
        _judge(content, kinds, known, SIGNIFICANCE / len(TESTS) / (len(used) + 1))
    return content | {"status": "ok", "why": None, "reference": used[0].name}


def _untested(sensor, readings):
    """Return why a sensor cannot be tested, or None."""
    if "K0" not in sensor.names:
        return sensor.not_testable or "it is not calibrated"
    if not all(len(r.values) for r in readings):
        return "no whole move between two rests"
    return None if all(np.diag(r.noise).all() for r in readings) else "its noise is not known"


def _judge(content, kinds, known, level):
    """Add what is each device's own in the first kind, and what all show alike in the second.

    `known` holds, by device, its readings by the noise as estimated and by the slowest possible.
    """
    kind, common = kinds
    if len(known) < 2:
        nothing = {"verdict": "not_testable", "why": "no second device to compare with"}
        content["common"][common] = nothing
        for name in known:
            content["devices"][name][kind] = nothing
        return
    (parts, _), (slow, agreeing) = (
        own_parts({name: pair[k][kind] for name, pair in known.items()}, level) for k in (0, 1)
    )
    # the last two
    apart = {"verdict": "undecided", "why": TWO} if slow[agreeing[0]].p_value < level else {}
    for name in known:
        found = _tested(parts[name], slow[name], level, "own")
        content["devices"][name][kind] = found | (apart if slow[name].p_value < level else {})
    both = (mean([known[name][k][common] for name in agreeing]) for k in (0, 1))
    content["common"][common] = _tested(*both, level, "common") | apart


def _tested(part, slow, level, word):
    """Return the content of a test by the noise as estimated and by the slowest possible."""
    verdict = {"verdict": word, "why": None}
    if slow.p_value >= level:
        verdict |= {"verdict": "undecided", "why": SLOW}
        verdict = {"verdict": "consistent", "why": None} if part.p_value >= level else verdict
    floor, n = np.sqrt(np.mean(np.diag(part.noise))), len(part.values)
    found = {"n": n, "error": part.error, "floor": floor, "p_value": part.p_value}
    return found | {"p_value_slow_noise": slow.p_value} | verdict


def _slowest(noise):
    """Return the noise with flicker and walk at their limits where they were not seen."""
    pairs = [(axis, term) for axis in noise.axes for term in "BK"]
    return noise.with_sizes({(a, t): getattr(noise.axes[a], t).size or 0.0 for a, t in pairs})
