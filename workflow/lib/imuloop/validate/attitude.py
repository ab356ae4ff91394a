"""Validation: the error of gravity's direction on stretches that no model has seen."""

import numpy as np
from scipy.linalg import LinAlgError

from imuloop.calibrate.least_squares import SINGULAR
from imuloop.calibrate.pose_fits import residuals
from imuloop.core.tables import joined, table
from imuloop.diagnose.choice import ratio_interval
from imuloop.diagnose.residuals import held_out_covariance
from imuloop.validate.attitude_errors import (
    K_I,
    K_P,
    angle,
    attitudes,
    filter_errors,
    filter_steps,
    gyroscope_errors,
    stretches,
)
from imuloop.validate.attitude_models import MODELS, blocks, held_out_models

# version of the JSON file
FORMAT = 1
# what carries gravity's direction: the gyroscope from each rest to the next; the gyroscope from the
# rest before a stretch through all of it; the filter through all of it
METHODS = ("rotation", "stretch", "mahony")
COLUMNS = {
    "session": object,
    "stretch": int,
    "block": int,
    "method": object,
    "model": object,
    "t_s": float,
    "after_s": float,
    "at": object,
    "error_deg": float,
}


def validate_attitude(device, gravity, diagnosed, settings):
    """Compare models of a device by the error of gravity's direction on held-out stretches.

    The mean of the accelerometer at the rests, with the final model that never saw them, is
    gravity's direction for all models. The gyroscope alone starts from it; the filter from what
    the model's own accelerometer says.

    Parameters
    ----------
    device : str
        Name of the device.
    gravity : float
        m/s^2.
    diagnosed : Diagnosed
        The diagnosis of the device.
    settings : DiagnoseSettings
        Settings.

    Returns
    -------
    dict
        Content of attitude.json.
    dict of str to ndarray
        Columns of attitude.parquet, a row per stretch, method, model and time.
    """
    recording, whole = diagnosed.recording, diagnosed.solutions["gyroscope"]
    force, turn = diagnosed.sensors["accelerometer"], diagnosed.sensors["gyroscope"]
    reason = turn.untestable(recording)
    if reason is None and whole is None:
        reason = "the poses determine no calibration of the gyroscope"
    if reason:
        return no_attitude(device, reason)
    block = blocks(len(recording.poses), settings)
    keeps = [block != k for k in range(block.max() + 1)]
    fitted = [turn] if diagnosed.effects["accelerometer"] is None else [force, turn]
    if any(any(sensor.undetermined(recording, keeps)) for sensor in fitted):
        why = f"{len(block)} poses do not determine the model with a block of them held out"
        return no_attitude(device, why)
    try:
        models = held_out_models(diagnosed, block, gravity, settings)
    except LinAlgError:
        return no_attitude(device, SINGULAR)
    u = np.array([_directions(each, recording) for each in models])
    errors = _errors(recording, block, models, u[:, MODELS.index("final")], diagnosed.names)
    # how far the base model's directions are from the final one's, held out
    apart = angle(u[block, MODELS.index("base"), np.arange(len(block))], _own(u, block))
    content = {
        **_head(device),
        "status": "ok",
        "effects": [
            {s: [e.name for e in getattr(m["final"], s).effects] for s in diagnosed.effects}
            for m in models
        ],
        "reference_deg": float(np.degrees(np.sqrt((apart**2).mean()))),
        "methods": {m: _summary(errors, m, settings) for m in METHODS},
        "sessions": {
            name: {m: _summary(chosen(errors, session=name), m, settings) for m in METHODS}
            for name in dict.fromkeys(errors["session"])
        },
    }
    floor = _rotation_floor(turn, whole, recording, block)
    content["methods"]["rotation"]["floor_deg"] = float(np.degrees(floor))
    return content, errors


def no_attitude(device, why):
    """Return what `validate_attitude` does where nothing can be validated, with the reason."""
    nothing = {name: np.zeros(0, dtype=kind) for name, kind in COLUMNS.items()}
    return {**_head(device), "status": "not_testable", "why": why}, nothing


def _head(device):
    return {"format": FORMAT, "device": device, "gains": {"k_P": K_P, "k_I": K_I}}


def _directions(calibrations, recording):
    """Return gravity's direction at all poses by the accelerometers of `MODELS`, (3, n, 3)."""
    poses, found = recording.poses, []
    for name in MODELS:
        force = calibrations[name].accelerometer
        channels = recording.pose_channels("accelerometer", force.output, poses.w)
        found.append(force.apply(poses.f, channels))
    return np.array(found) / np.linalg.norm(found, axis=-1, keepdims=True)


def _own(directions, block):
    """Return the final model's direction at each pose, by the model that did not see it, (n, 3)."""
    return directions[block, MODELS.index("final"), np.arange(len(block))]


def _errors(recording, block, models, directions, names):
    """Return the table of errors: of each stretch, those of all methods and models.

    Parameters
    ----------
    models : list of dict
        As of `held_out_models`, a block each.
    directions : ndarray, shape (blocks, n, 3)
        Gravity's direction at the poses by the final model of each block.
    names : list of str
        Of the sessions.
    """
    found, fed, calibrated, last = [], [], None, None
    for stretch in stretches(recording, block):
        k, session = place = block[stretch.poses[0]], recording.poses.session[stretch.poses[0]]
        if place != last:
            # of the whole log: effects may depend on what was before
            log, last = recording.logs[session], place
            whole = (models[k][m].calibrated(log.f, log.w, log.t, log.temperature) for m in MODELS)
            calibrated = [np.array(values) for values in zip(*whole, strict=True)]
        f, w = (values[:, stretch.piece] for values in calibrated)
        q, u = attitudes(w, stretch.t), directions[k, stretch.poses]
        rotation, through = gyroscope_errors(q, stretch, u)
        found.append((names[session], k, stretch, {"rotation": rotation, "stretch": through}))
        fed.append((*filter_steps(q, f, stretch), u))
    for (*_, errors), mahony in zip(found, filter_errors(fed), strict=True):
        errors["mahony"] = mahony
    rows = joined(
        [
            _rows(method, values, number, *about)
            for number, (*about, errors) in enumerate(found)
            for method, values in errors.items()
        ]
    )
    return {name: rows[name].astype(kind) for name, kind in COLUMNS.items()}


def _rows(method, errors, number, session, block, stretch):
    """Return the rows of one stretch and method; errors in rad, a first axis for the models."""
    arrive, leave = stretch.t[stretch.arrive], stretch.t[stretch.leave]
    if method == "rotation":
        t, after, at = arrive[1:], arrive[1:] - leave[:-1], ["arrival"] * (len(arrive) - 1)
    else:
        t = np.column_stack([arrive, leave])[1:].ravel()
        after, at = t - leave[0], ["arrival", "departure"] * (len(t) // 2)
    per_model = [
        table(COLUMNS, session, number, block, method, model, t, after, "", np.degrees(e).ravel())
        | {"at": np.array(at, dtype=object)}
        for model, e in zip(MODELS, errors, strict=True)
    ]
    return joined(per_model)


def chosen(rows, **values):
    """Return the rows of a table, a dict of columns, that have some values."""
    keep = np.all([rows[name] == value for name, value in values.items()], axis=0)
    return {name: column[keep] for name, column in rows.items()}


def _summary(rows, method, settings):
    """Return what attitude.json holds of a method: errors of each model when a turn is over."""
    by_model = {m: chosen(rows, method=method, at="arrival", model=m) for m in MODELS}
    if method == "stretch":
        # the last arrival of each
        last = np.append(np.diff(by_model["base"]["stretch"]) != 0, True)
        by_model = {m: {n: c[last] for n, c in each.items()} for m, each in by_model.items()}
    errors = {model: each["error_deg"] for model, each in by_model.items()}
    base, final = (errors[m][:, None] for m in ("base", "final"))
    low, high = ratio_interval(by_model["base"]["block"], base, final, settings)
    return {
        "n": len(base),
        "duration_s": float(np.median(by_model["base"]["after_s"])),
        "models": {
            model: {
                "rms_deg": float(np.sqrt((e**2).mean())),
                "median_deg": float(np.median(e)),
                "p95_deg": float(np.quantile(e, 0.95)),
            }
            for model, e in errors.items()
        },
        "base_over_final": float(np.sqrt((base**2).sum() / (final**2).sum())),
        "ratio_ci95": [1 / high, 1 / low],
    }


def _rotation_floor(turn, whole, recording, block):
    """Return the error over a rotation that the noise alone gives the final model, rad."""
    _, jacobian = residuals(turn.model(whole, recording), whole.fit.x)
    ends, kind = turn.rows(recording)
    covariance = held_out_covariance(
        turn.covariances(whole, recording)(turn.noise), jacobian, block[ends]
    )
    return np.sqrt(2 * np.diag(covariance)[kind == 1].mean())
