"""The motion between the poses: velocity that a model of both sensors leaves at its end."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.linalg import LinAlgError

from imuloop.calibrate import accelerometer, gyroscope
from imuloop.calibrate.gyroscope import midpoints
from imuloop.calibrate.least_squares import SINGULAR, FitResult
from imuloop.calibrate.motion import COUNT, FORCE, MotionPoses, OfSensor
from imuloop.calibrate.pose_fits import Solution, in_raw_units
from imuloop.core.effect import Effect, find_effect
from imuloop.core.errors import plural
from imuloop.core.precision import precision
from imuloop.core.samples import SENSORS
from imuloop.diagnose.choice import Choices
from imuloop.diagnose.content import search_content, untried
from imuloop.diagnose.records.pose_diagnosis import judged_residuals
from imuloop.diagnose.records.poses import PoseProblem, interleaved
from imuloop.diagnose.verdict import leaves, not_testable

VELOCITY = ("velocity_vertical", "velocity_horizontal")
# kinds of residuals of both sensors, which share the significance
KINDS = 5
# moves of which the velocity counts, at least
LEAST_MOVES = 10
# m/s; what may be lost between two samples of a move that counts: half a g at 100 Hz
SPOILED = 0.05
SOFTER = (
    "low-pass the accelerometer below half the rate, turn in one to two seconds and set the device "
    "down softly"
)
BOTH = "motion shows how late one sensor is after the other: it is given to the accelerometer"


@dataclass(frozen=True)
class MotionResult:
    """The diagnosis of both sensors in motion."""

    contents: dict  # the contract's fields by sensor
    # SensorCalibration of each sensor with the effects that motion shows; empty without any
    calibrations: dict = field(default_factory=dict)
    residuals: dict = field(default_factory=dict)  # columns of the moves, as of `residual_columns`
    # MotionPoses and the Solution with what was found; empty where the poses determine no start
    fit: tuple = ()


class MotionProblem(PoseProblem):
    """Both sensors at the poses, which every fit sees, and the moves, of which parts are held out.

    The poses alone determine the base model: no fit is lost. The noise of a move grows with its
    length, and so does what a lacking effect leaves.
    """

    # of 0.95 times as large effects 82 of 100 were found
    enough = 1.0

    @cached_property
    def measure(self):
        """What a held-out error is compared in: the noise as residuals without effects have it."""
        likeliest = self.linearized().evidence.blocks[0].noise.precision[-1]
        return np.sqrt(np.diag(precision(likeliest)[0]))

    def lost(self, base, out=frozenset()):
        """Return None; what all data choose is fitted, for what is tested beside it."""
        if not out:
            self.linearized(base)


def candidates_in_motion(known):
    """Return the shapes of each effect to try, but of known types."""
    return {
        cls: tuple(cls.shapes(None))
        for cls in Effect.library.values()
        if "motion" in cls.records and cls not in known
    }


def diagnose_motion(force, turn, recording, settings, tests, shown, beyond=None):
    """Return the MotionResult of a device.

    `force` and `turn` are AccelerometerPoses or GyroscopePoses and its Solution at the poses,
    effects included; `tests` the number of tests of the other records, which share the
    significance; `shown` by sensor what static records show, as of PoseProblem; `beyond` as of
    `pose_diagnosis.diagnose_poses`.
    """
    if not all(solution for _, solution in (force, turn)):
        return untestable("the poses do not determine both sensors")
    x = [solution.fit.x for _, solution in (force, turn)]
    knock = knocks(recording, x[1][9:12])
    # where it tilts at either end the velocity there is not zero
    first, tilt = recording.rotations.first, recording.poses.tilt
    tilts = (tilt[first] > 0) | (tilt[first + 1] > 0)
    quiet, columns = (knock <= SPOILED) & ~tilts, {"knock_m_s": knock}
    found = tuple(
        OfSensor(effect, model.sensor)
        for model, solution in (force, turn)
        for effect in solution.effects
    )
    start = np.concatenate(
        [x[0][:FORCE], x[1][: COUNT - FORCE], x[0][FORCE:], x[1][COUNT - FORCE :]]
    )
    model = MotionPoses(force[0].noise, force[1].calibration, start, force[0].gravity, quiet)
    if quiet.sum() < LEAST_MOVES:
        why = f"{quiet.sum()} of {plural(len(quiet), 'move')} without a knock"
        why += " and between rests without a tilt" * bool(tilts.any())
        if np.isnan(knock).any():
            why += " and within the accelerometer's range"
        why += f", at least {LEAST_MOVES} needed{recording.lost.reason}"
        unfitted = Solution(
            found, FitResult(start, np.zeros((0, 0)), np.nan, 0, np.zeros((0, 0)), np.zeros(0))
        )
        return replace(untestable(f"{why}: {SOFTER}", columns), fit=(model, unfitted))
    model = model.given_rotation(recording, found)
    shapes = candidates_in_motion({type(e.effect) for e in found})
    problem = MotionProblem(
        model,
        recording,
        shapes,
        settings,
        tests + settings.family * len(shapes),
        # poses are seen by every fit
        np.append(interleaved(len(quiet), settings.folds), -1),
        found,
        _information(shown),
    )
    try:
        return _diagnosed(Choices(problem), (force[0].unit, turn[0].unit), columns, beyond)
    except LinAlgError:
        return untestable(SINGULAR, columns)


def untestable(why, columns=None):
    """Return the MotionResult where nothing could be tested, with the reason."""
    return MotionResult({sensor: not_testable(why) for sensor in SENSORS}, {}, columns or {})


def _information(shown):
    """Return what gives what static records say of effects of both sensors, None without any."""
    if not any(information for _, information in shown.values()):
        return None

    def information(effects):
        """Return A and b as of `static.information`; zero for what a static record cannot show."""
        ends = np.cumsum([0, *(len(e.parameters) for e in effects)])
        whole, moment = np.zeros((ends[-1],) * 2), np.zeros(ends[-1])
        for sensor, (known, of_record) in shown.items():
            own = [
                k
                for k, e in enumerate(effects)
                if e.sensors[0] == sensor
                and (e.effect in known or ("temperature" in e.effect.needs and not e.effect.timed))
            ]
            if of_record and own:
                at = np.concatenate([np.arange(ends[k], ends[k + 1]) for k in own])
                a, b = of_record(tuple(effects[k].effect for k in own))
                whole[np.ix_(at, at)], moment[at] = a, b
        return whole, moment

    return information


def knocks(recording, gyroscope_bias):
    """Return the velocity that may be lost between two samples of each move, m/s, shape (m,).

    The largest change of specific force over a step Δt that the turn does not make,
    ``|Δf + w × f Δt| Δt``: a knock shorter than a step is sampled by chance, or not at all. Takes
    the gyroscope's bias, rad/s as logged, (3,). Not-a-number where the specific force reached the
    end of its range: what is beyond is not known.
    """
    rotations = recording.rotations
    f, w, steps = rotations.f, rotations.w - gyroscope_bias, rotations.steps[..., None]
    change = np.diff(f, axis=1) + np.cross(midpoints(w), midpoints(f)) * steps
    lost = (np.linalg.norm(change, axis=2) * steps[..., 0]).max(axis=1)
    return np.where(rotations.force_clipped, np.nan, lost)


def _diagnosed(choices, units, columns, beyond):
    """Return the MotionResult of moves that can be tested."""

    def of(entry):
        # a formula says itself whose it is
        own = entry.get("constants", {}).get("sensor")
        return own or find_effect(entry["name"]).sensors[0]

    problem, added = choices.problem, choices.choice().base
    judged, residuals = judged_residuals(choices, VELOCITY, KINDS)
    calibrations = _calibrations(problem, added, units)
    fitted = _fitted(calibrations, added)
    found = search_content(None, choices, fitted, {}, _probes(problem, columns))

    def of_sensor(sensor):
        own = {key: [e for e in found[key] if of(e) == sensor] for key in ("effects", "candidates")}
        if sensor == "gyroscope":
            own["candidates"].append(untried("time_offset", "confounded", BOTH))
        return own

    contents = {sensor: judged | found | of_sensor(sensor) for sensor in SENSORS}
    for sensor in SENSORS if beyond and leaves(judged) else ():
        more = beyond("motion", sensor, choices)
        if more is None:
            break
        contents[sensor]["discovered"] = more.content
        if more.choices:
            problem, added = more.choices.problem, more.choices.base
            judged, residuals = judged_residuals(more.choices, VELOCITY, KINDS)
            calibrations = _calibrations(problem, added, units)
            fitted = _fitted(calibrations, added)
            found |= more.joined(found["effects"], found["candidates"], fitted)
            for name, own in contents.items():
                own |= judged | of_sensor(name)
        if more.content["status"] != "nothing":
            break
    quiet = problem.sensor.quiet
    for own in contents.values():
        own["moves"] = {"all": len(quiet), "left_out": int((~quiet).sum())}
    for name, values in residuals.items():
        columns[name] = np.full(len(quiet), np.nan)
        columns[name][quiet] = values
    fit = problem.sensor, problem.linearized(added).solution
    return MotionResult(contents, calibrations if added else {}, columns, fit)


def _fitted(calibrations, base):
    """Return the FittedEffects of effects that calibrations of both sensors hold."""
    effects = [e for own in calibrations.values() for e in own.effects]
    return [next(f for f in effects if f.effect == e) for e in base]


def _calibrations(problem, base, units):
    """Return the calibration of each sensor by the fit with some effects."""
    solution, covariance = problem.linearized(base).solution, problem.covariance(base)
    own, found = problem.sensor.model(solution, problem.recording).own, {}
    effects = [(e.effect, e.sensor) for e in problem.found]
    effects += [(e, e.sensors[0]) for e in base]
    names = (accelerometer.NAMES, gyroscope.NAMES)
    for (sensor, at), base_names, unit in zip(own.items(), names, units, strict=True):
        found[sensor] = in_raw_units(
            unit,
            base_names,
            solution.fit.x[at],
            covariance[np.ix_(at, at)],
            method="multi_position",
            effects=tuple(effect for effect, of in effects if of == sensor),
            reduced_chi2=solution.fit.reduced_chi2,
        )
    return found


def _probes(problem, columns):
    """Return name, kind and columns of what velocities may go with: signposts."""
    recording, quiet = problem.recording, problem.sensor.quiet
    rotations = recording.rotations
    mid = (rotations.start_s + rotations.end_s)[:, None] / 2
    turned = np.einsum("mki,mk->mi", rotations.w[:, 1:], rotations.steps)
    seconds = rotations.steps.sum(axis=1)[:, None]
    values = {
        "time": mid,
        "duration": seconds,
        "rotation_angle": turned,
        "rotation_speed": turned / seconds,
        "previous_pose": recording.poses.f[rotations.first],
        "knock": columns["knock_m_s"][:, None],
    }
    return [
        (name, kind, problem.probe(kind, each[quiet]))
        for kind in VELOCITY
        for name, each in values.items()
    ]
