"""Validation: the error of gravity's direction on stretches of a log that no model was fitted to.

A stretch goes from a rest, through moves and rests, to a rest. A block is a group of consecutive
poses that are held out together. The models are ``raw``, ``base`` and ``final``.
"""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.linalg import LinAlgError

from imuloop.core.rotation import exponential, matrix, prefix_product, step_vectors
from imuloop.core.samples import SENSORS
from imuloop.estimate.choice import Choices
from imuloop.estimate.held_out import held_out_covariance, ratio_interval
from imuloop.estimate.least_squares import why_no_fit
from imuloop.model.sensor_calibration import SensorCalibration

try:
    from vqf import VQF
except ImportError:  # there are Pythons and processors without a wheel
    VQF = None

# version of the JSON file
FORMAT = 1
MODELS = ("raw", "base", "final")
# number of poses in a block, so that a stretch has several rotations, and the fewest blocks
BLOCK, FEWEST = 5, 4
# longest part of the first rest of a stretch, in which the filter settles, and of its last rest, s
SETTLE = 30.0
# columns of attitude.parquet, with their types
COLUMNS = {"session": object, "stretch": int, "block": int, "method": object, "model": object}
COLUMNS |= {"t_s": float, "after_s": float, "at": object, "error_deg": float}


def validate_attitude(device, diagnosed, settings):
    """Return the errors of gravity's direction on held-out stretches, by the models of a device.

    A stretch is a part of a log from a rest, through moves and rests, to a rest. The models are
    calibrations that were not fitted to it: ``raw`` has the nominal scale only, ``base`` has bias,
    scale factors and misalignments, and ``final`` has effects, too. The true direction of gravity
    at a rest is taken as the mean specific force, calibrated by the final model. Two methods
    predict the direction at the rests of a stretch: the gyroscope alone, from the true direction at
    the rest before; and a filter, from specific force and angular rate. Both use values that a
    model calibrates, so their errors compare the models.

    Parameters
    ----------
    device : str
        Name of the device.
    diagnosed : Diagnosed
        The diagnosis of the device.
    settings : DiagnoseSettings
        Settings of the diagnosis; its `folds` limits the number of blocks.

    Returns
    -------
    dict
        Content of attitude.json.
    DataFrame
        Content of attitude.parquet, with the `COLUMNS`: a row per stretch, method, model and time.
    """
    recording, poses = diagnosed.recording, diagnosed.poses
    if poses.choices is None or "gyroscope" not in poses.calibrations:
        why = poses.contents["gyroscope"].get("why")
        return no_attitude(device, why or "the poses determine no calibration of the gyroscope")
    block = blocks(len(recording.poses), settings)
    problem = poses.choices.problem.with_folds(block)
    try:
        models = held_out_models(diagnosed, problem)
    except LinAlgError as error:
        return no_attitude(device, why_no_fit(error))
    errors = _errors(recording, block, models, diagnosed.names)
    methods = {m: _summary(errors[errors["method"] == m]) for m in METHODS}
    methods["rotation"]["floor_deg"] = _rotation_floor(problem, poses.solution)
    # names of the effects in the final model of each block, by sensor
    effects = [
        {s: [e.name for e in getattr(by_name["final"], s).effects] for s in SENSORS}
        for by_name in models
    ]
    content = {"format": FORMAT, "device": device, "status": "ok", "effects": effects}
    return content | {"methods": methods}, errors


def no_attitude(device, why):
    """Return the content of attitude.json if nothing can be tested, and an empty attitude.parquet.

    The first is a dict, the second a DataFrame. `why` is the reason, and `device` the name of the
    device.
    """
    nothing = pd.DataFrame({name: np.zeros(0, dtype=kind) for name, kind in COLUMNS.items()})
    return {"format": FORMAT, "device": device, "status": "not_testable", "why": why}, nothing


def blocks(count, settings):
    """Return the number of the block of each of `count` poses in order of time, (count,) of int.

    A block is a group of consecutive poses that are held out together. The blocks have about the
    same number of poses. The field `folds` of `settings`, a DiagnoseSettings, is the largest number
    of blocks.
    """
    number = min(count, settings.folds, max(FEWEST, count // BLOCK))
    return np.arange(count) * number // max(count, 1)


def held_out_models(diagnosed, problem):
    """Return, for each block of poses, the models of a device that are fitted without this block.

    A block is a group of consecutive poses that are held out together. The models are: ``raw``, the
    nominal scale of the data sheet; ``base``, bias, scale factors and misalignments; ``final``,
    these and effects. The final model is the base model if no effect was added. If the fit to all
    poses has an effect, effects are searched for again in the poses outside the block; otherwise
    none is searched for. Exception: if the poses do not determine the accelerometer, all models but
    ``raw`` have its calibration from the diagnosis.

    Parameters
    ----------
    diagnosed : Diagnosed
        The diagnosis of the device.
    problem : PoseProblem
        The poses; its folds are the blocks.

    Returns
    -------
    list of dict of str to Calibration
        The models by name, for each block.
    """
    joint_fit, calibration = problem.joint_fit, diagnosed.calibration
    nominal = {s: SensorCalibration.nominal(joint_fit.units[s], None) for s in SENSORS}
    raw, base_problem = replace(calibration, **nominal), problem
    if problem.nuisance_effects:
        # the base model lacks the effects that static records showed, too; what the problem has
        # computed with them is dropped
        base_problem = replace(problem, nuisance_effects=(), static=None, _fits={}, _columns={})

    def fit_without(problem, effects, held_out):
        """Return the Calibration of a PoseProblem with `effects`, fitted without some blocks.

        `problem` is the PoseProblem, and `held_out` are the numbers of these blocks.
        """
        return replace(calibration, **joint_fit.calibrations(problem.fit(effects, held_out)))

    # the choice of effects by all poses, and the choices by the poses outside each block
    all_choices, choices, models = diagnosed.poses.choices, Choices(problem), []
    has_effects = bool(all_choices.choice().effects)
    for block in range(problem.folds):
        held_out, effects = frozenset({block}), ()
        if has_effects:
            effects = all_choices.nested_choice(choices.search(held_out))
        final = fit_without(problem, effects, held_out)
        base = fit_without(base_problem, (), held_out) if final.effects else final
        models.append({"raw": raw, "base": base, "final": final})
    return models


def _errors(recording, block, models, names):
    """Return the errors of gravity's direction, a row per stretch, method, model, rest and moment.

    The result is a DataFrame with the `COLUMNS`. A stretch is a part of a log from a rest to a
    rest; it lies within one block of poses, and the models were fitted without this block. The
    moment is the arrival at a rest or the departure from it. `block` is the number of the block of
    each of the n poses of the Recording `recording`, (n,). `models` has for each block a dict of
    Calibration by the name of the model. `names` are the names of the sessions.
    """
    tables, calibrated_log = [], None
    for number, stretch in enumerate(stretches(recording, block)):
        k, session = block[stretch.poses[0]], recording.poses.session[stretch.poses[0]]
        if (k, session) != calibrated_log:
            # the whole log is calibrated, because effects may depend on earlier samples
            log, calibrated_log = recording.logs[session], (k, session)
            has_effects = models[k]["final"] is not models[k]["base"]
            calibrated = {
                model: models[k][model].calibrated(log.f, log.w, log.t, log.temperature)
                # without effects the final model is the base model
                for model in (MODELS if has_effects else MODELS[:-1])
            }
            # direction of gravity at the poses, by the final model
            up, _ = recording.calibrated_force(models[k]["final"].accelerometer)
            up = up / np.linalg.norm(up, axis=1, keepdims=True)
        # time of arrival at each rest and of departure from it, (p, 2); the time for which the
        # direction was carried: since the rest before, or by the filter since the first rest
        ends = stretch.t[np.column_stack([stretch.arrive, stretch.leave])]
        after = {"rotation": ends[1:, :1] - ends[:-1, 1:], "filter": ends[1:] - ends[0, 1]}
        errors = {}
        for model, (f, w) in calibrated.items():
            turns = step_vectors(w[stretch.piece], np.diff(stretch.t))
            # (p - 1, 1): on arrival at a rest; (p - 1, 2): on departure from it, too
            errors[model] = {
                method: errors_by(turns, f[stretch.piece], stretch, up[stretch.poses])
                for method, errors_by in METHODS.items()
            }
        for model in MODELS:
            for method, error in errors.get(model, errors["base"]).items():
                rests, moments = error.shape
                rows = {
                    "session": names[session],
                    "stretch": number,
                    "block": k,
                    "method": method,
                    "model": model,
                    "t_s": ends[1:, :moments].ravel(),
                    "after_s": after[method].ravel(),
                    "at": np.tile(["arrival", "departure"][:moments], rests),
                    "error_deg": np.degrees(error).ravel(),
                }
                tables.append(pd.DataFrame(rows))
    return pd.concat(tables, ignore_index=True)


def _summary(rows):
    """Return the content of attitude.json on one method, a dict: errors of each model, and a ratio.

    The errors of a model are summed up by their root mean square and 95 % quantile. The ratio is
    the root mean square of the base model over that of the final model; above one, the effects made
    the errors smaller. Only errors on arrival at a rest count; those on departure are ignored.
    `rows` are the rows of attitude.parquet with this method.
    """
    rows = rows[rows["at"] == "arrival"]
    by_model = {model: rows[rows["model"] == model] for model in MODELS}
    errors = {model: table["error_deg"].to_numpy() for model, table in by_model.items()}
    models = {
        model: {"rms_deg": float(np.sqrt((e**2).mean())), "p95_deg": float(np.quantile(e, 0.95))}
        for model, e in errors.items()
    }
    base, final = errors["base"][:, None], errors["final"][:, None]
    # the interval of the ratio final over base, whose inverse is reported; `low` may be zero
    low, high = ratio_interval(by_model["base"]["block"].to_numpy(), base, final)
    return {
        "n": len(base),
        "duration_s": float(by_model["base"]["after_s"].median()),
        "models": models,
        "base_over_final": float(np.sqrt((base**2).sum() / (final**2).sum())),
        "ratio_ci95": [1 / high, 1 / low if low else None],
    }


def _rotation_floor(problem, solution):
    """Return the root mean square error of held-out rotations that noise alone causes, deg.

    A perfect model would have this error; a larger error shows that the model is wrong. `problem`
    is the PoseProblem whose folds are the blocks, and `solution` the Fit of all poses.
    """
    linearised = problem.joint_fit.linearise(solution, problem.recording)
    noise = linearised.noise.by(problem.joint_fit.noise)
    # the problem also has the rows of the prior, after those of the recording
    measured = slice(len(solution.white))
    covariance = held_out_covariance(noise, linearised.jacobian, problem.row_folds[measured])
    of_rotation = problem.of_kind("rotation")[measured]
    # the error of a rotation has two components
    variance = 2 * np.diag(covariance)[of_rotation].mean()
    return float(np.degrees(np.sqrt(variance)))


@dataclass(frozen=True)
class Stretch:
    """A stretch: a part of a log from a rest, through rotations and rests, to a rest.

    It has p poses (the rests) and k samples.
    """

    poses: np.ndarray  # (p,): indices of its poses
    t: np.ndarray  # (k,): time of its samples, s
    piece: slice  # its samples in the log
    arrive: np.ndarray  # (p,): first sample of each pose, counted from the start of the stretch
    leave: np.ndarray  # (p,): last sample of each pose, counted from the start of the stretch


def stretches(recording, block):
    """Return the Stretches of a Recording, a list in order of time.

    A Stretch is a part of a log from a rest, through moves and rests, to a rest. It is as long as
    possible: its moves follow each other without a break and belong to one block of poses that are
    held out together. A move belongs to the block of the pose that it starts from. The first and
    the last rest of a stretch are cut to `SETTLE` seconds. `recording` is the Recording, and
    `block` the number of the block of each of its n poses, (n,).
    """
    # poses from which a move starts; a move follows another if it starts where the other ends
    first, poses, result = recording.rotations.first, recording.poses, []
    cuts = np.flatnonzero((np.diff(first) != 1) | (np.diff(block[first]) != 0)) + 1
    for group in np.split(first, cuts) if len(first) else ():
        index = np.append(group, group[-1] + 1)
        t = recording.logs[poses.session[index[0]]].t
        start, end = poses.start_s[index], poses.end_s[index]
        # the end of a pose is exclusive: its last sample is the one before
        arrive, leave = np.searchsorted(t, start), np.searchsorted(t, end) - 1
        arrive[0] = max(arrive[0], np.searchsorted(t, end[0] - SETTLE))
        leave[-1] = min(leave[-1], np.searchsorted(t, start[-1] + SETTLE))
        piece = slice(arrive[0], leave[-1] + 1)
        arrive, leave = arrive - piece.start, leave - piece.start
        result.append(Stretch(poses=index, t=t[piece], piece=piece, arrive=arrive, leave=leave))
    return result


def angle(a, b):
    """Return the angles between vectors a and b, rad, (...).

    `a` and `b` have the shape (..., 3) each.
    """
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(axis=-1))


def rotation_errors(turns, f, stretch, u):
    """Return the error of gravity's direction at each rest, predicted by the gyroscope alone.

    The prediction starts from the direction u(t₀) at the last sample, t₀, of the rest before, and
    ends at the first sample, t, of the rest: ``u(t) = C(t)ᵀ C(t₀) u(t₀)``. The attitude C(t)
    rotates from the body axes at t to the body axes at the start of the stretch.

    Parameters
    ----------
    turns : ndarray, shape (k - 1, 3)
        Rotation vector of each step between the k samples of the stretch, rad.
    f : ndarray, shape (k, 3)
        Specific force, m/s^2. It is not used here; all `METHODS` have the same arguments.
    stretch : Stretch
        The stretch, with p poses and k samples.
    u : ndarray, shape (p, 3)
        Direction of gravity in each pose on body axes, unit vectors.

    Returns
    -------
    ndarray, shape (p - 1, 1)
        Angle between the predicted direction and u at each rest but the first, rad.
    """
    C = matrix(np.concatenate([[[1.0, 0, 0, 0]], prefix_product(exponential(turns))]))
    leave, arrive = C[stretch.leave[:-1]], C[stretch.arrive[1:]]
    predicted = np.einsum("pji,pjk,pk->pi", arrive, leave, u[:-1])
    return angle(predicted, u[1:])[:, None]


def filter_errors(turns, f, stretch, u):
    """Return the error of gravity's direction at each rest by the filter VQF, rad, (p - 1, 2).

    The rests are those of a stretch with p poses, but for the first. The errors are angles between
    the direction by the filter and `u`, at the first sample of the rest (first column) and at its
    last sample (second column). The filter runs over the whole stretch without a magnetometer and
    with its default parameters, so it also estimates the bias of the gyroscope. The arguments
    `turns`, `f`, `stretch` and `u` are described in `rotation_errors`.

    References
    ----------
    Laidig, Seel, "VQF: Highly accurate IMU orientation estimation with bias estimation and magnetic
    disturbance rejection", Information Fusion 91 (2023).
    """
    # the filter takes a constant step: where time stamps are late or lost, the rate is the one that
    # makes the whole rotation in this step
    step = np.median(np.diff(stretch.t))
    rates, forces = np.ascontiguousarray(turns / step), np.ascontiguousarray(f[1:])
    q = VQF(step).updateBatch(rates, forces)["quat6D"]
    # the filter has no value for the first sample, where the first step starts
    ends = np.column_stack([stretch.arrive, stretch.leave])[1:] - 1
    # q rotates to axes of which the third points up, by the matrix C: the upward direction on the
    # axes of the sensor is Cᵀ e_z, the third row of C
    return angle(matrix(q[ends])[..., 2, :], u[1:, None])


# what carries the direction of gravity, with the function that returns the errors
METHODS = {"rotation": rotation_errors} | ({"filter": filter_errors} if VQF else {})
