"""Was a diagnosis right: the name, the error that is left, the parameters."""

import numpy as np

# name in a record at rest of an effect that the poses know by another name
SAME = {"bias_drift": "ramp"}
# largest ratio of the held-out errors of the device with and without the effect
RATIO = 1.25
# largest error of a parameter, in its standard error
SIGMAS = 3.0


def added_effects(diagnosis):
    """Return (sensor, record, name) of every effect that a diagnosis added, in its order.

    What was found at rest is known at the poses: a candidate that is added, no effect of theirs.
    """
    effects = []
    for sensor, parts in diagnosis["sensors"].items():
        for record, part in parts.items():
            names = [effect["name"] for effect in part["effects"]]
            names += [c["name"] for c in part["candidates"] if c["status"] == "added"]
            effects += [(sensor, record, name) for name in dict.fromkeys(names)]
    return effects


def effect_entries(diagnosis, sensor, record, name):
    """Return the entries of ``effects``, with their record, that hold the values of an effect."""
    parts = diagnosis["sensors"][sensor]
    for place in (record, "static_record"):
        entries = [(place, e) for e in parts[place]["effects"] if e["name"] == name]
        if entries:
            return entries
    return []


def twin(part, name, others):
    """Return which of `others` a diagnosis says it cannot tell from `name`, or None."""
    pairs = [
        (c["name"], c["confounded_with"]) for c in part["candidates"] if c["status"] == "confounded"
    ]
    pairs += [(pair["effect"], pair["with"]) for pair in part.get("confounded", ())]
    return next((other for of, other in pairs if of == name and other in others), None)


def judge(case, outcome):
    """Return the verdict and the effects of a diagnosis, compared with the truth.

    ``verdict``; ``named`` in the sensor and record of the case; ``right`` names that were put in
    and found; ``twins`` found in place of one; ``missed``; ``more``: what else was added, anywhere.
    """
    every = added_effects(outcome["diagnosis"])
    if case.kind == "control":
        return {"more": every}
    part = outcome["diagnosis"]["sensors"][case.sensor][case.record]
    here = [
        name for sensor, record, name in every if (sensor, record) == (case.sensor, case.record)
    ]
    right = [name for name in here if name in case.names]
    twins = {
        name: twin(part, name, here)
        for name in case.names
        if name not in right and twin(part, name, here)
    }
    true = {*case.names, *twins.values()}
    true |= {SAME[name] for name in case.names if name in SAME}
    return {
        "verdict": part["verdict"],
        "named": here,
        "right": right,
        "twins": twins,
        "missed": [name for name in case.names if name not in right and name not in twins],
        "more": [one for one in every if one[0] != case.sensor or one[2] not in true],
    }


def ratio(case, outcome):
    """Return the held-out error after over the control's, the largest of the residuals."""
    diagnosis, control = (
        outcome[who]["sensors"][case.sensor][case.record] for who in ("diagnosis", "control")
    )
    return max(
        residual["after"] / control["residuals"][kind]["before"]
        for kind, residual in diagnosis["residuals"].items()
    )


def pulls(outcome):
    """Return the errors of the parameters of the effects found, in their standard errors."""
    return np.array(
        [
            (value - entry["expected"][name]) / entry["std"][name]
            for entry in outcome["found"]
            for name, value in entry["parameters"].items()
            if name in entry["expected"]
        ]
    )


def base_pulls(case, outcome):
    """Return the errors of T, K and b of both sensors, in their standard errors.

    Only of devices that have the injected effect in its variant, and nothing else in their
    calibration: with another effect T, K and b differ.
    """
    judgement = judge(case, outcome)
    if judgement["more"] or judgement.get("missed") or judgement.get("twins"):
        return np.zeros(0)
    constants = {e["name"]: e["constants"] for e in outcome.get("injected", ())}
    if any(f["constants"] != constants[f["name"]] for f in outcome.get("found", ())):
        return np.zeros(0)
    return np.array([v for sensor in outcome["base_pulls"].values() for v in sensor.values()])
