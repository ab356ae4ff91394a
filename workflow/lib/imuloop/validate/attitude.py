"""Validation: the error of gravity's direction on stretches that no model has seen."""

from itertools import groupby

import numpy as np
from scipy.linalg import LinAlgError

from imuloop.calibrate.least_squares import SINGULAR
from imuloop.calibrate.pose_fits import residuals
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
        Columns of attitude.parquet, a row a stretch, method, model and time.
    """
    recording, whole = diagnosed.recording, diagnosed.solutions["gyroscope"]
    sensors, turn = dict(diagnosed.sensors), diagnosed.sensors["gyroscope"]
    if diagnosed.effects["accelerometer"] is None:
        # where the poses cannot test it, it is given
        sensors["accelerometer"] = None
    effects = {sensor: found or () for sensor, found in diagnosed.effects.items()}
    reason = turn.untestable(recording)
    if reason is None and whole is None:
        reason = "the poses determine no calibration of the gyroscope"
    if reason:
        return no_attitude(device, reason)
    block = blocks(len(recording.poses), settings)
    keeps = [block != k for k in range(block.max() + 1)]
    if any(any(s.undetermined(recording, keeps)) for s in sensors.values() if s):
        why = f"{len(block)} poses do not determine the model with a block of them held out"
        return no_attitude(device, why)
    try:
        models = held_out_models(
            sensors,
            recording,
            block,
            effects,
            diagnosed.shown,
            gravity,
            settings,
            diagnosed.tests,
        )
    except LinAlgError:
        return no_attitude(device, SINGULAR)
    u = [_directions(m, recording) for m in models]
    table = _errors(recording, block, models, u, diagnosed.names)
    content = {
        **_head(device),
        "status": "ok",
        "effects": [m.effects for m in models],
        "reference_deg": float(np.degrees(_reference_shift(u, block))),
        "methods": {m: _summary(table, m, settings) for m in METHODS},
        "sessions": {
            name: {m: _summary(chosen(table, session=name), m, settings) for m in METHODS}
            for name in dict.fromkeys(table["session"])
        },
    }
    floor = _rotation_floor(turn, whole, recording, block)
    content["methods"]["rotation"]["floor_deg"] = float(np.degrees(floor))
    return content, table


def no_attitude(device, why):
    """Return what `validate_attitude` does where nothing can be validated, with the reason."""
    nothing = {name: np.zeros(0, dtype=kind) for name, kind in COLUMNS.items()}
    return {**_head(device), "status": "not_testable", "why": why}, nothing


def _head(device):
    return {"format": FORMAT, "device": device, "gains": {"k_P": K_P, "k_I": K_I}}


def _directions(models, recording):
    """Return gravity's direction at all poses by the accelerometers of `MODELS`, (3, n, 3)."""
    poses, found = recording.poses, []
    for calibration in models.calibrations.values():
        force = calibration.accelerometer
        channels = recording.pose_channels("accelerometer", force.output, poses.w)
        found.append(force.apply(poses.f, channels))
    return np.array(found) / np.linalg.norm(found, axis=-1, keepdims=True)


def _reference_shift(directions, block):
    """Return how far the base model's directions are from the final one's, held out, rad."""
    base, final = MODELS.index("base"), MODELS.index("final")
    off = [angle(u[base], u[final])[block == k] for k, u in enumerate(directions)]
    return np.sqrt((np.concatenate(off) ** 2).mean())


def _errors(recording, block, models, directions, names):
    """Return the table of errors: of each stretch, those of all methods and models."""
    poses, found, filters = recording.poses, [], []
    reference = MODELS.index("final")
    # nothing is worked out twice for a final model that is the base model
    alike = all(m.calibrations["final"] is m.calibrations["base"] for m in models)
    distinct = MODELS[:reference] if alike else MODELS

    def place(stretch):
        return block[stretch.poses[0]], poses.session[stretch.poses[0]]

    for (k, session), group in groupby(stretches(recording, block), place):
        calibrations = models[k].calibrations
        log = recording.logs[session]
        # effects may depend on all of the log
        whole = {n: _calibrated(c, log) for n, c in calibrations.items() if _extended(c)}
        for stretch in group:
            pieces = [
                [values[stretch.piece] for values in whole[name]]
                if name in whole
                else _calibrated(calibrations[name], log, stretch.piece)
                for name in distinct
            ]
            f, w = (np.array(values) for values in zip(*pieces, strict=True))
            q, u = attitudes(w, stretch.t), directions[k][reference, stretch.poses]
            rotation, through = gyroscope_errors(q, stretch, u)
            found.append((names[session], k, stretch, {"rotation": rotation, "stretch": through}))
            filters.append((*filter_steps(q, f, stretch), u))
    for (*_, errors), mahony in zip(found, filter_errors(filters), strict=True):
        errors["mahony"] = mahony
    each = [min(i, len(distinct) - 1) for i in range(len(MODELS))]
    parts = [
        _rows(method, values[each], number, *about)
        for number, (*about, errors) in enumerate(found)
        for method, values in errors.items()
    ]
    return {
        name: np.concatenate([part[name] for part in parts]).astype(kind)
        for name, kind in COLUMNS.items()
    }


def _rows(method, errors, number, session, block, stretch):
    """Return the rows of one stretch and method; errors in rad, a first axis for the models."""
    arrive, leave = stretch.t[stretch.arrive], stretch.t[stretch.leave]
    if method == "rotation":
        t, after, at = arrive[1:], arrive[1:] - leave[:-1], np.repeat("arrival", len(arrive) - 1)
    else:
        t = np.column_stack([arrive, leave])[1:].ravel()
        after, at = t - leave[0], np.tile(["arrival", "departure"], len(t) // 2)
    models, n = len(MODELS), len(t)
    same = {"session": session, "stretch": number, "block": block, "method": method}
    return {name: np.repeat(value, models * n) for name, value in same.items()} | {
        "model": np.repeat(MODELS, n),
        "t_s": np.tile(t, models),
        "after_s": np.tile(after, models),
        "at": np.tile(at, models),
        "error_deg": np.degrees(errors).ravel(),
    }


def chosen(table, **values):
    """Return the rows of a table, a dict of columns, that have some values."""
    rows = np.all([table[name] == value for name, value in values.items()], axis=0)
    return {name: column[rows] for name, column in table.items()}


def _summary(table, method, settings):
    """Return what attitude.json holds of a method: errors of each model when a turn is over."""
    by_model = {m: chosen(table, method=method, at="arrival", model=m) for m in MODELS}
    if method == "stretch":
        # the last arrival of each
        last = np.append(np.diff(by_model["base"]["stretch"]) != 0, True)
        by_model = {m: {n: c[last] for n, c in rows.items()} for m, rows in by_model.items()}
    errors = {model: rows["error_deg"] for model, rows in by_model.items()}
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
    variance = np.diag(
        held_out_covariance(turn.covariance(whole, recording), jacobian, block[ends])
    )
    return np.sqrt(2 * variance[kind == 1].mean())


def _calibrated(calibration, log, piece=slice(None)):
    """Return calibrated specific force and angular rate of a piece of a log, (n, 3) each."""
    temperature = None if log.temperature is None else log.temperature[piece]
    return calibration.calibrated(log.f[piece], log.w[piece], log.t[piece], temperature)


def _extended(calibration):
    """Return whether a calibration has effects."""
    return calibration.accelerometer.effects or calibration.gyroscope.effects
