"""A static record: means over a minute against what the noise model predicts for them."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from imuloop.core.effect import Effect
from imuloop.core.samples import CHANNELS, TIME
from imuloop.core.segments import STATIC
from imuloop.diagnose.residuals import Residual, held_out_variance, size
from imuloop.diagnose.verdict import NOTHING, UNTRIED, verdict

# the covariance of n means has n² entries: a longer record is averaged over longer windows
MOST_MEANS = 2000


@dataclass(frozen=True)
class StaticMeans:
    """Means of consecutive windows at rest.

    Attributes
    ----------
    windows : ndarray, shape (n, 2)
        Start and end of each window, s.
    stretch : ndarray of int, shape (n,)
        Which undisturbed stretch each window lies in.
    means : ndarray, shape (n, 6)
        Mean of every axis, SI.
    """

    windows: np.ndarray
    stretch: np.ndarray
    means: np.ndarray


def window_means(samples, segments, mean_time):
    """Return the means of consecutive windows that lie whole in a static stretch.

    Parameters
    ----------
    samples, segments : DataFrame
        Of the session.
    mean_time : float
        Length of a window, s; longer where the record would have more than `MOST_MEANS`.

    Returns
    -------
    StaticMeans
        In order of time.
    """
    static = segments[segments["kind"] == STATIC]
    mean_time = max(mean_time, (static["end_s"] - static["start_s"]).sum() / MOST_MEANS)
    windows, stretch = [np.zeros((0, 2))], []
    for number, row in enumerate(static.itertuples()):
        count = int((row.end_s - row.start_s) // mean_time)
        starts = row.start_s + mean_time * np.arange(count)
        windows.append(np.column_stack([starts, starts + mean_time]))
        stretch += [number] * count
    windows, stretch = np.concatenate(windows), np.array(stretch, dtype=int)
    at = np.searchsorted(samples[TIME].to_numpy(), windows)
    values = samples[list(CHANNELS)].to_numpy()
    means = [values[i:j].mean(axis=0) if j > i else np.full(6, np.nan) for i, j in at]
    keep = at[:, 1] > at[:, 0]
    return StaticMeans(windows[keep], stretch[keep], np.array(means).reshape(-1, 6)[keep])


def levels(record, axes):
    """Return what is constant, as columns of zeros and ones, shape (n, c).

    A disturbance may leave the device in another attitude: the accelerometer has a level in each
    undisturbed stretch. A gyroscope at rest does not see the attitude: one level.
    """
    if axes.start:
        return np.ones((len(record.means), 1))
    return (record.stretch[:, None] == np.unique(record.stretch)).astype(float)


def level_fit(values, covariance, design):
    """Return the generalised least-squares levels of values, and χ²."""
    root = np.linalg.cholesky(covariance)
    white = solve_triangular(root, np.column_stack([design, values]), lower=True)
    inverse = np.linalg.inv(white[:, :-1].T @ white[:, :-1])
    bias = inverse @ white[:, :-1].T @ white[:, -1]
    left = white[:, -1] - white[:, :-1] @ bias
    return bias, left @ left


def bias_residuals(record, covariance, axes, unit):
    """Return the residual of a constant bias on three axes, judged against the noise.

    Parameters
    ----------
    record : StaticMeans
        Means.
    covariance : ndarray, shape (6, n, n)
        Of the means, from the noise model.
    axes : slice
        The sensor's columns.
    unit : str
        SI unit.
    """
    design = levels(record, axes)
    n, c = design.shape
    values, chi2 = np.empty((n, 3)), 0.0
    for axis, predicted in enumerate(covariance[axes]):
        column = record.means[:, axes][:, axis]
        bias, square = level_fit(column, predicted, design)
        values[:, axis] = column - design @ bias
        chi2 += square
    dof = 3 * (n - c)
    return Residual(unit, values, float(chi2 / dof), dof)


def hold_out(record, covariance, axes, blocks):
    """Return the held-out errors of a constant bias, each block of time predicted by the others.

    Returns
    -------
    ndarray, ndarray, shape (n, 3)
        Errors, SI, and the variance that the noise alone gives them; not a number where a stretch
        lies whole in one block, so that no other tells its level.
    """
    design = levels(record, axes)
    n = len(record.means)
    part = np.arange(n) * blocks // n
    errors, variance = np.full((2, n, 3), np.nan)
    for block in range(blocks):
        seen = part != block
        known = design[seen].any(axis=0)
        held = ~seen & design[:, known].any(axis=1)
        for axis, predicted in enumerate(covariance[axes]):
            column = record.means[:, axes][:, axis]
            bias, _ = level_fit(
                column[seen], predicted[np.ix_(seen, seen)], design[np.ix_(seen, known)]
            )
            errors[held, axis] = column[held] - design[np.ix_(held, known)] @ bias
            variance[held, axis] = held_out_variance(predicted, design[:, known], seen, held)
    return errors, variance


def diagnose_static(records, noise, axes, unit, sensor, settings):
    """Diagnose one sensor in its static records.

    Parameters
    ----------
    records : dict of str to StaticMeans
        Means of each static session.
    noise : NoiseModel
        Noise of the device.
    axes : slice
        The sensor's columns.
    unit : str
        SI unit.
    sensor : str
        Name of the sensor.
    settings : DiagnoseSettings
        Settings.
    """
    usable = {
        name: r
        for name, r in records.items()
        if len(r.means) >= max(2 * settings.blocks, levels(r, axes).shape[1] + 1)
    }
    if not usable:
        why = (
            f"no static session with {2 * settings.blocks} means of {settings.mean_time:g} s: "
            f"record at least {2 * settings.blocks * settings.mean_time / 60:g} min at rest"
        )
        return {"verdict": "not_testable", "why": why, **NOTHING}
    predicted = {name: noise.pose_mean_covariance(r.windows) for name, r in usable.items()}
    if not all(np.all(np.diagonal(c[axes], 0, 1, 2) > 0) for c in predicted.values()):
        return {"verdict": "not_testable", "why": "the noise of an axis is not known", **NOTHING}
    judged = [bias_residuals(r, predicted[name], axes, unit) for name, r in usable.items()]
    held = [hold_out(r, predicted[name], axes, settings.blocks) for name, r in usable.items()]
    errors, variance = (np.concatenate([h[i] for h in held]) for i in (0, 1))
    told = np.isfinite(errors[:, 0])
    if not told.any():
        why = "the stretches between disturbances are too short to predict one part from another"
        return {"verdict": "not_testable", "why": why, **NOTHING}
    error = size(errors[told])
    dof = sum(j.dof for j in judged)
    reduced = sum(j.reduced_chi2 * j.dof for j in judged) / dof
    # both sensors and all sessions share the significance
    share = settings.significance / (2 * len(judged))
    above = any(j.above_floor(share) for j in judged)
    return {
        "verdict": verdict(above, above, ()),
        "residuals": {
            "bias": {
                "unit": unit,
                "n": int(told.sum()),
                "floor": size(np.sqrt(variance[told])),
                "before": error,
                "after": error,
                "chi2_before": reduced,
                "chi2_after": reduced,
            }
        },
        "effects": [],
        "candidates": [
            {
                "name": effect.name,
                "status": "not_observable",
                "why": "in one attitude it cannot be told from the bias",
                **UNTRIED,
            }
            for effect in Effect.library.values()
            if sensor in effect.sensors
        ],
        "points": [
            {
                "residual": "bias",
                "index": i,
                "session": name,
                "start_s": float(record.windows[i, 0]),
                "before": float(np.linalg.norm(e)),
                "after": float(np.linalg.norm(e)),
                "values": j.values[i].tolist(),
                "floor": float(np.sqrt(v.sum())),
            }
            for (name, record), (left, predicted_variance), j in zip(
                usable.items(), held, judged, strict=True
            )
            for i, (e, v) in enumerate(zip(left, predicted_variance, strict=True))
        ],
    }
