"""Calibrations of a device that never saw a block of its poses: as logged, base model, final."""

from dataclasses import dataclass, replace

import numpy as np

from imuloop.core.model import Calibration, SensorCalibration
from imuloop.diagnose.pose_diagnosis import pose_search
from imuloop.diagnose.pose_models import GyroscopePoses

MODELS = ("raw", "base", "final")
# poses of a block, so that a stretch has several rotations, and the fewest blocks
BLOCK, FEWEST = 5, 4


@dataclass(frozen=True)
class HeldOutModels:
    """The calibrations that judge one block of poses.

    Attributes
    ----------
    calibrations : dict of str to Calibration
        One for each of `MODELS`; the final one is the base model itself where no effect was added.
    effects : dict of str to tuple of str
        Effects of the final one by sensor, chosen without the block.
    """

    calibrations: dict[str, Calibration]
    effects: dict[str, tuple[str, ...]]


def blocks(count, settings):
    """Return the block of each pose: parts that follow each other in time."""
    parts = min(count, settings.folds, max(FEWEST, count // BLOCK))
    return np.arange(count) * parts // max(count, 1)


def held_out_models(turn_model, recording, keep, effects, settings, tests, searches=None):
    """Return the models of a device fitted to some poses, effects chosen by these alone.

    As in the diagnosis, effects are looked for only where all poses together show one.

    Parameters
    ----------
    turn_model : GyroscopePoses
        How the device is fitted; holds the accelerometer's model.
    recording : Recording
        All poses and rotations.
    keep : ndarray of bool, shape (n,)
        The poses to fit.
    effects : dict of str to tuple of Effect
        Effects by sensor that all poses together show.
    settings : DiagnoseSettings
        Settings.
    tests : int
        Number of tests that share the significance.
    searches : dict of str to Search, optional
        Of all poses, by sensor, to start from.

    Returns
    -------
    HeldOutModels
        The models.
    """
    force_model, searches = turn_model.force, searches or {}

    def search(model):
        whole = searches.get(model.sensor)
        return replace(pose_search(model, recording, settings, tests), keep=keep, whole=whole)

    def fit(model):
        whole = searches.get("gyroscope")
        found = whole and model.refit(recording, keep, (), whole.step().solution.fit.x)
        return found[0] if found else model.fit(recording.select(keep))

    force_effects = ()
    if effects["accelerometer"] and not turn_model.fallback:
        force_effects = search(force_model).greedy()[0]
    final_model = replace(turn_model, force_effects=force_effects)
    if effects["gyroscope"]:
        found = search(final_model)
        final, base = (found.step(e).solution for e in (found.greedy()[0], ()))
    else:
        final = base = fit(final_model)
    if base.calibration.effects or base.accelerometer.effects:
        force_model = replace(force_model, known=())
        fallback = turn_model.fallback and replace(turn_model.fallback, effects=())
        base_model = GyroscopePoses(force_model, fallback, (), turn_model.unit)
        base = fit(base_model)

    def of(solution):
        return Calibration("", force_model.gravity, solution.accelerometer, solution.calibration)

    raw = (SensorCalibration.nominal(m.unit, None) for m in (force_model, turn_model))
    raw, simple = Calibration("", force_model.gravity, *raw), of(base)
    return HeldOutModels(
        {"raw": raw, "base": simple, "final": simple if final is base else of(final)},
        {
            "accelerometer": tuple(e.name for e in final.accelerometer.effects),
            "gyroscope": tuple(e.name for e in final.calibration.effects),
        },
    )
