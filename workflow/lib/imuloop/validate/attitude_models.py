"""Calibrations of a device that never saw a block of its poses: as logged, base model, final."""

from dataclasses import replace

import numpy as np

from imuloop.core.model import SensorCalibration
from imuloop.core.samples import SENSORS
from imuloop.diagnose.choice import Choices

MODELS = ("raw", "base", "final")
# poses of a block, so that a stretch has several rotations, and the fewest blocks
BLOCK, FEWEST = 5, 4


def blocks(count, settings):
    """Return the block of each pose: parts that follow each other in time."""
    parts = min(count, settings.folds, max(FEWEST, count // BLOCK))
    return np.arange(count) * parts // max(count, 1)


def held_out_models(diagnosed, problem):
    """Return the models of a device that do not see one block of poses, block by block.

    As in the diagnosis, effects are looked for only where all poses together show one. An
    accelerometer that the poses do not determine is given. Takes the Diagnosed, and the PoseProblem
    whose parts are the blocks; gives a dict of Calibration by name in `MODELS` per block, whose
    final one is the base model where no effect was added.
    """
    pair, searched = problem.sensor, bool(diagnosed.poses.choices.choice().base)
    given = diagnosed.calibration
    raw = replace(given, **{s: SensorCalibration.nominal(pair.units[s], None) for s in SENSORS})
    plain = problem
    if problem.found:
        plain = replace(problem, found=(), information=None, _linearized={}, _columns={})
    if "accelerometer" not in pair.estimated:
        given = replace(given, accelerometer=pair.given)

    def without(problem, base, out):
        return replace(given, **pair.calibrations(problem.fitted(base, out)))

    models, choices = [], Choices(problem)
    for k in range(problem.parts):
        out = frozenset({k})
        whole = without(problem, choices.choice(out).base if searched else (), out)
        simple = without(plain, (), out) if whole.effects else whole
        models.append({"raw": raw, "base": simple, "final": whole})
    return models
