"""The same formula in several devices of a type, looked for jointly: in which of them it is."""

from dataclasses import replace

import numpy as np
from scipy.linalg import LinAlgError

# calibrations are read with their effects
import imuloop.effects  # noqa: F401
from imuloop.calibrate.calibrate import read_recording
from imuloop.calibrate.pose_fits import AccelerometerPoses, GyroscopePoses
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.errors import ImuloopError, one_line
from imuloop.core.model import Calibration
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import SENSORS
from imuloop.diagnose.p_values import log_f_tail
from imuloop.diagnose.records.pose_diagnosis import pose_problem
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.discover.discover import DRAWS, FLOOR, LEVEL, errors_of, held_out_kinds
from imuloop.discover.pursuit import MARGIN, SIMPLER, fitted, whitened
from imuloop.discover.searched import of_poses

# version of the JSON file
FORMAT = 1


def members_of(problems):
    """Return the Searched of (PoseProblem, effects of the library) by device, of one common space.

    A candidate is one that every device has: without a temperature in one, none takes it.
    """
    found = {name: of_poses(problem, base) for name, (problem, base) in problems.items()}
    texts = [[_text(m.space, own) for own in m.space.candidates] for m in found.values()]
    common = [text for text in texts[0] if all(text in own for own in texts)]
    return {
        name: replace(m, space=replace(m.space, candidates=_in_order(m.space, own, common)))
        for (name, m), own in zip(found.items(), texts, strict=True)
    }


def _text(space, columns):
    return "; ".join(space.terms[c] for c in columns)


def _in_order(space, texts, common):
    place = dict(zip(texts, space.candidates, strict=True))
    return tuple(place[text] for text in common)


def discover_jointly(members, seed, draws=DRAWS):
    """Return what devices of a type show together, as type.json has it of a sensor.

    The formula is the one whose sum over the devices, of what it saves in -2 log L with a size of
    its own in each, is largest; chance is that of the largest sum over the space, of draws and of
    signs of whole poses. A device has it where its own test passes at `FLOOR` over the devices,
    and what the *others* choose lowers its held-out error.

    Parameters
    ----------
    members : dict of str to Searched
        As of `members_of`.
    seed : int
        Of the draws.
    draws : int
        How many of each kind.
    """
    rng, each = np.random.default_rng(seed), list(members.values())
    whites = [whitened(m.rows, m.space, ()) for m in each]
    total = sum(_own(w) for w in whites)
    drawn = [w.drawn(m.rows.piece, draws, rng) for w, m in zip(whites, each, strict=True)]
    largest = [
        sum(w.saved(d) for w, d in zip(whites, kind, strict=True)).max(axis=0)
        for kind in zip(*drawn, strict=True)
    ]
    chance = max((1 + np.sum(most >= total.max())) / (1 + draws) for most in largest)
    content = _nothing("nothing") | {"searched": len(total), "chance": float(chance)}
    if chance >= LEVEL:
        return content
    best = int(np.argmax(total))
    # once more by the noise that is there beside it
    whites = [
        whitened(m.rows, m.space, (), about=w.kept[best]) for w, m in zip(whites, each, strict=True)
    ]
    owns = [_own(w) for w in whites]
    total = sum(owns)
    alike = _alike(whites, best)
    near = [k for k in alike if total[k] >= total[best] - SIMPLER]
    space = each[0].space
    best = min(near, key=lambda k: (space.complexity(k), -total[k], k))
    alike = _alike(whites, best)
    margin = total[best] - np.delete(total, alike).max(initial=-np.inf)
    chosen = [int(np.argmax(total - own)) for own in owns]
    devices = {
        name: _device(m, w, best, choice, len(members))
        for (name, m), w, choice in zip(members.items(), whites, chosen, strict=True)
    }
    agreed = all(choice in alike for choice in chosen)
    several = sum(d["has"] for d in devices.values()) > 1
    near = sorted((k for k in alike if k != best), key=lambda k: -total[k])
    return {
        **content,
        "status": "named" if several and agreed and margin >= MARGIN else "structure",
        "margin": float(margin) if np.isfinite(margin) else None,
        "formula": _text(space, space.candidates[best]),
        "imitators": [
            _text(space, space.candidates[k]) for k in near if total[k] > total[best] - MARGIN
        ],
        "devices": devices,
    }


def _own(white):
    return np.round(white.saved(white.residual[:, None])[:, 0], 6)


def _alike(whites, best):
    """Return the candidates that stand for another in every device that sees both."""

    def stands(k):
        seen = [w for w in whites if w.bases[best].shape[1] and w.bases[k].shape[1]]
        return bool(seen) and all(w.imitates(best, k) for w in seen)

    return [k for k in range(len(whites[0].bases)) if k == best or stands(k)]


def _device(member, white, best, choice, count):
    """Return what a device shows of the best candidate, and of the one that the others choose."""
    rows, space, basis = member.rows, member.space, white.bases[best]
    q, columns = basis.shape[1], list(white.kept[best])
    p_value, values, std = 1.0, np.zeros(0), np.zeros(0)
    if q:
        share = np.sum((basis.T @ white.residual) ** 2) / np.sum(white.residual**2)
        dof = white.dof - q
        p_value = float(np.exp(log_f_tail(share / (1 - share) * dof / q, q, dof)))
        theta, covariance = fitted(
            rows, np.column_stack([rows.jacobian, space.columns[:, columns]])
        )
        values, std = theta[-q:], np.sqrt(np.diag(covariance))[-q:]
    chosen = [space.columns[:, list(c)] for c in ((), white.kept[choice])]
    errors = [errors_of(member, lambda seen, own=c: own) for c in chosen]
    kinds = held_out_kinds(member, errors)
    lower = any(own["ratio_ci95"][1] < 1 for own in kinds.values())
    terms = [space.terms[c] for c in columns]
    return {
        "has": bool(p_value < FLOOR / count and lower),
        "p_value": p_value,
        "values": dict(zip(terms, values.tolist(), strict=True)),
        "std": dict(zip(terms, std.tolist(), strict=True)),
        "residuals": kinds,
    }


def discover_type(name, devices):
    """Return the content of type.json: what the devices of a type show together, by sensor."""
    content = no_type(name, None)
    for sensor in SENSORS:
        problems, why = {}, {}
        for device in devices:
            try:
                problems[device.name] = _problem(device, sensor)
            except (ImuloopError, LinAlgError) as error:
                why[device.name] = one_line(error)
        if len(problems) < 2:
            found = _nothing("not_testable") | {
                "why": "fewer than two devices have poses to search"
            }
        else:
            seed = next(iter(problems.values()))[0].settings.seed
            found = {"why": None, **discover_jointly(members_of(problems), seed)}
        content["sensors"][sensor] = found | {"left_out": why}
    return content


def no_type(name, why):
    """Return the content of type.json where nothing could be looked for, with the reason."""
    return {"format": FORMAT, "type": name, "why": why, "sensors": {}}


def _nothing(status):
    """Return the content of a sensor without a formula."""
    content = {"status": status, "searched": 0, "chance": 1.0, "margin": None}
    return content | {"formula": "", "imitators": [], "devices": {}}


def _problem(device, sensor):
    """Return the PoseProblem of a sensor of a device, and the effects of the library that it has.

    Raises an ImuloopError where the poses determine no fit.
    """
    calibration = Calibration.from_json(device.file("calibration.json"))
    noise = NoiseModel.from_json(device.file("noise.json"))
    settings = CalibrateSettings(**device.calibrate)
    recording = read_recording(device.sessions, settings.longest_rotation)
    unit = getattr(calibration, sensor).raw_unit
    if sensor == "accelerometer":
        model = AccelerometerPoses(noise, device.gravity, unit, settings)
    else:
        model = GyroscopePoses(noise, calibration.accelerometer, unit, settings)
    if why := model.untestable(recording):
        raise ImuloopError(why)
    problem = pose_problem(model, recording, DiagnoseSettings(**device.diagnose), 1)
    base = tuple(
        e.effect for e in getattr(calibration, sensor).effects if "poses" in e.effect.records
    )
    if why := problem.lost(base):
        raise ImuloopError(why)
    return problem, base
