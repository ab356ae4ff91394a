"""Calibrations of a device that never saw a block of its poses: as logged, base model, final."""

from dataclasses import dataclass, replace

import numpy as np

from imuloop.calibrate.pose_fits import fitted_calibration
from imuloop.core.model import Calibration, SensorCalibration
from imuloop.diagnose.choice import Choices
from imuloop.diagnose.records.pose_diagnosis import directions_without, pose_problem

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


def held_out_models(sensors, recording, block, effects, told, gravity, settings, tests):
    """Return the models of a device that do not see one block of poses, block by block.

    As in the diagnosis, effects are looked for only where all poses together show one.

    Parameters
    ----------
    sensors : dict of str to (AccelerometerPoses or GyroscopePoses)
        How each is fitted; an accelerometer that the poses do not determine is None.
    recording : Recording
        All poses and rotations.
    block : ndarray of int, shape (n,)
        The block of each pose.
    effects : dict of str to tuple of Effect
        Effects by sensor that all poses together show.
    told : dict of str to (tuple of Effect, callable or None)
        By sensor the effects that other records show, and what these tell, as of PoseProblem.
    gravity : float
        m/s^2.
    settings : DiagnoseSettings
        Settings.
    tests : int
        Number of tests that share the significance.

    Returns
    -------
    list of HeldOutModels
        One a block.
    """
    arguments = recording, settings, tests, block
    final = _Fitted.of(sensors, effects, told, *arguments)
    base = final
    if any(effects.values()) or any(shown for shown, _ in told.values()):
        force = replace(sensors["gyroscope"].accelerometer, effects=())
        plain = sensors | {"gyroscope": replace(sensors["gyroscope"], accelerometer=force)}
        nothing = dict.fromkeys(effects, ())
        base = _Fitted.of(plain, nothing, dict.fromkeys(effects, ((), None)), *arguments)
    units = [(sensors["accelerometer"] or sensors["gyroscope"].accelerometer), sensors["gyroscope"]]
    raw = Calibration(
        "",
        gravity,
        *(SensorCalibration.nominal(getattr(u, "unit", None) or u.raw_unit, None) for u in units),
    )
    found = []
    for k in range(block.max() + 1):
        whole = Calibration("", gravity, *final.without(k))
        simple = whole if base is final else Calibration("", gravity, *base.without(k))
        if not (whole.accelerometer.effects or whole.gyroscope.effects):
            simple = whole
        found.append(
            HeldOutModels(
                {"raw": raw, "base": simple, "final": whole},
                {
                    "accelerometer": tuple(e.name for e in whole.accelerometer.effects),
                    "gyroscope": tuple(e.name for e in whole.gyroscope.effects),
                },
            )
        )
    return found


@dataclass(frozen=True)
class _Fitted:
    """Both sensors with what each may choose; the accelerometer's is None where it is given."""

    force: Choices | None
    turn: Choices
    searched: dict

    @classmethod
    def of(cls, sensors, effects, told, recording, settings, tests, block):
        """Return them; a sensor without an effect in all poses is not searched."""
        force, directions = None, None
        if sensors["accelerometer"]:
            force = Choices(
                pose_problem(
                    sensors["accelerometer"],
                    recording,
                    settings,
                    tests,
                    block,
                    *told["accelerometer"],
                )
            )

            def directions(out):
                return directions_without(force, out, effects["accelerometer"])

        turn = pose_problem(
            sensors["gyroscope"], recording, settings, tests, block, *told["gyroscope"], directions
        )
        return cls(force, Choices(turn), effects)

    def without(self, k):
        """Return the calibrations of accelerometer and gyroscope that do not see a block."""
        found, out = [], frozenset({k})
        for choices, name in ((self.force, "accelerometer"), (self.turn, "gyroscope")):
            if choices is None:
                found.append(self.turn.problem.sensor.accelerometer)
                continue
            problem = choices.problem
            base = choices.choice(out).base if self.searched[name] else ()
            found.append(fitted_calibration(problem.sensor, problem.fitted(base, out)))
        return found
