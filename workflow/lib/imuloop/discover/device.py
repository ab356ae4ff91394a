"""What a device's library of effects leaves, searched; what is named goes into its results."""

from copy import deepcopy
from dataclasses import replace

import numpy as np

from imuloop.calibrate.force import calibrated_force
from imuloop.diagnose.choice import Choice, Choices
from imuloop.diagnose.records.pose_diagnosis import (
    KINDS,
    final_solution,
    judged_residuals,
    pose_problem,
)
from imuloop.discover.discover import consecutive, discover

# verdicts that leave something to look for
LEFT = ("unexplained", "partly_explained")
# imitators that are listed
LISTED = 10


class Composed(Choices):
    """Choices that are made: those of the library, and an effect with its held-out errors."""

    def __init__(self, problem, base, effect, errors):
        super().__init__(problem)
        self.base, self.known = (*base, effect), errors

    def choice(self, out=frozenset()):
        """Return the effects."""
        return Choice(self.base)

    def errors(self, chosen, out=frozenset()):
        """Return the errors with what each part's own search chose, else as any Choices."""
        return self.known[:, None] if chosen == self.nested else super().errors(chosen, out)


def discover_device(found, settings):
    """Return a Diagnosed with what a search finds in residuals that the library leaves.

    The same object where every verdict on the poses is consistent or explained; but where that
    takes more slow noise than was estimated, a pattern may have passed for noise. `settings` are
    DiagnoseSettings.
    """
    searched = []
    for sensor, records in found.content["sensors"].items():
        left = records["poses"]["verdict"] in LEFT or records["poses"].get("slow_noise")
        searched += [sensor] if left and found.effects[sensor] is not None else []
    if not searched:
        return found
    found = replace(found, content=deepcopy(found.content), tables=deepcopy(found.tables))
    for sensor in searched:
        found = _searched(found, sensor, settings)
        # what an accelerometer lacks turns the direction by which a gyroscope is judged
        if found.content["sensors"][sensor]["poses"]["discovered"]["status"] != "nothing":
            break
    return found


def _searched(found, sensor, settings):
    """Return the Diagnosed with what is found of one sensor."""
    fold = consecutive(len(found.recording.poses), settings.folds)
    how = settings, found.tests, fold, *found.shown[sensor]
    problem = pose_problem(found.sensors[sensor], found.recording, *how)
    base, block = found.effects[sensor], found.content["sensors"][sensor]["poses"]
    discovery = discover(problem, base)
    block["discovered"] = content(discovery)
    effect, in_motion = discovery.effect, found.content["sensors"][sensor]["motion"]["effects"]
    # the fit of motion has no place for it
    if effect is None or in_motion:
        return found
    choices = Composed(problem, base, effect, discovery.errors[1])
    judged, columns = judged_residuals(choices, problem.sensor.kinds, KINDS)
    for table in found.tables.values():
        for name in table.keys() & columns.keys():
            # rows of the six faces follow
            table[name][: len(columns[name])] = columns[name]
    block |= judged
    solution = final_solution(problem, choices.base)
    own, old = solution.calibration, getattr(found.calibration, sensor)
    fitted = own.effects[-1]
    block["effects"].append(_entry(discovery, fitted, sensor))
    held = {e.name: e.seen for e in old.effects}
    effects = [replace(e, seen=held.get(e.name, {})) for e in own.effects[:-1]]
    effects.append(fitted.held_to(_channels(found, sensor, own)))
    calibration = replace(found.calibration, **{sensor: replace(own, effects=tuple(effects))})
    return replace(found, calibration=calibration)


def _channels(found, sensor, calibration):
    """Return the Channels in which an effect of a sensor was seen."""
    recording = found.recording
    if sensor == "accelerometer":
        return [recording.pose_channels(sensor, calibration.output, recording.poses.w)]
    model = found.sensors[sensor]
    force = calibrated_force(model.accelerometer, recording, model.noise)
    return [
        recording.pose_channels(sensor, calibration.output, force.poses),
        recording.rotation_channels(sensor, calibration.output, force.rotations),
    ]


def _entry(discovery, fitted, sensor):
    """Return the entry of ``effects`` in diagnosis.json."""
    kind = min(discovery.confirmed, key=lambda k: discovery.kinds[k]["ratio"])
    own = discovery.kinds[kind]
    return {
        **fitted.to_dict(),
        "units": fitted.effect.units(sensor),
        "p_value": discovery.found.chances[0],
        "residual": kind,
        "heldout_before": own["before"],
        "heldout_after": own["after"],
        "ratio_ci95": own["ratio_ci95"],
    }


def content(discovery):
    """Return what diagnosis.json holds of a search."""
    space, found = discovery.space, discovery.found
    margin = min(found.margin, discovery.lead)

    def text(candidate):
        return "; ".join(space.terms[c] for c in space.candidates[candidate])

    status = "nothing"
    if found.candidates:
        status = "named" if discovery.effect else "structure"
    return {
        "status": status,
        "searched": len(space.candidates),
        "chance": found.chances[0] if found.chances else 1.0,
        "formula": "; ".join(space.terms[c] for c in found.columns),
        "margin": margin if np.isfinite(margin) else None,
        "left": discovery.left,
        "agreed": discovery.agreed,
        "constant": discovery.constant,
        "imitators": [text(k) for k in found.imitators[:LISTED]],
        "residuals": discovery.kinds,
        "points": discovery.shown,
    }
