"""Calibrations of a device that never saw a block of its poses: as logged, base model, final."""

from dataclasses import replace

import numpy as np

from imuloop.calibrate.pose_fits import fitted_calibration
from imuloop.core.model import Calibration, SensorCalibration
from imuloop.diagnose.choice import Choices
from imuloop.diagnose.records.pose_diagnosis import directions_without, pose_problem

MODELS = ("raw", "base", "final")
# poses of a block, so that a stretch has several rotations, and the fewest blocks
BLOCK, FEWEST = 5, 4


def blocks(count, settings):
    """Return the block of each pose: parts that follow each other in time."""
    parts = min(count, settings.folds, max(FEWEST, count // BLOCK))
    return np.arange(count) * parts // max(count, 1)


def held_out_models(diagnosed, block, gravity, settings):
    """Return the models of a device that do not see one block of poses, block by block.

    As in the diagnosis, effects are looked for only where all poses together show one. An
    accelerometer that the poses cannot test is given. Takes the Diagnosed, the block of each pose,
    (n,), gravity, m/s^2, and DiagnoseSettings; gives a dict of Calibration by name in `MODELS` per
    block, whose final one is the base model where no effect was added.
    """
    sensors = dict(diagnosed.sensors)
    if diagnosed.effects["accelerometer"] is None:
        sensors["accelerometer"] = None
    effects = {sensor: found or () for sensor, found in diagnosed.effects.items()}
    nothing = dict.fromkeys(effects, ())

    def choices(sensors, searched, shown):
        def problem(name, directions=None):
            how = settings, diagnosed.tests, block, *shown[name], directions
            return Choices(pose_problem(sensors[name], diagnosed.recording, *how))

        if not sensors["accelerometer"]:
            return {"accelerometer": None, "gyroscope": problem("gyroscope")}
        force = problem("accelerometer")

        def directions(out):
            return directions_without(force, out, searched["accelerometer"])

        return {"accelerometer": force, "gyroscope": problem("gyroscope", directions)}

    def without(choices, searched, k):
        found, out = [], frozenset({k})
        for name, each in choices.items():
            if each is None:
                found.append(choices["gyroscope"].problem.sensor.accelerometer)
                continue
            base = each.choice(out).base if searched[name] else ()
            found.append(fitted_calibration(each.problem.sensor, each.problem.fitted(base, out)))
        return Calibration("", gravity, *found)

    given, turn = sensors["gyroscope"].accelerometer, sensors["gyroscope"]
    force_unit = sensors["accelerometer"].unit if sensors["accelerometer"] else given.raw_unit
    raw = (SensorCalibration.nominal(unit, None) for unit in (force_unit, turn.unit))
    raw = Calibration("", gravity, *raw)
    final = base = choices(sensors, effects, diagnosed.shown)
    # the same problems where nothing but the search of the gyroscope tells the two apart
    if given.effects or any(known for shown in diagnosed.shown.values() for known in shown):
        turn = replace(turn, accelerometer=replace(given, effects=()))
        base = choices(sensors | {"gyroscope": turn}, nothing, dict.fromkeys(effects, ((), None)))
    models = []
    for k in range(block.max() + 1):
        whole = without(final, effects, k)
        simple = without(base, nothing, k) if whole.effects else whole
        models.append({"raw": raw, "base": simple, "final": whole})
    return models
