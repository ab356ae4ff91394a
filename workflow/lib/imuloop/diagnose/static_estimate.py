"""Estimates of the effects in static records, their standard errors, their output."""

import numpy as np

from imuloop.core.effect import FittedEffect
from imuloop.diagnose.static_noise import mean_covariance, unit_noise

AXES = range(3)


def estimate(search, base, axis):
    """Return the parameters of patterns on one axis, their own units; None if not determined.

    At the likeliest noise without a walk. What a model lacks is rarely noise: the weights of a
    walk would take the parameters from the fastest changes alone, where a lag that is not in the
    model counts most, and would not mind an error of the level.

    Returns
    -------
    ndarray, shape (p,)
        Pattern after pattern, those that the axis has.
    """
    fit = search.fit(base, axis)
    if fit is None:
        return None
    return fit.theta[search.sight.model.point(fit)] / _scales(search, base, axis)


def _scales(search, base, axis):
    scales = [search.sight.model.scale(p, axis) for p in base]
    return np.concatenate([np.zeros(0), *scales])


def output(search, base, derivatives):
    """Return what patterns, fitted to what is seen, add to the means of a record, shape (n, 3).

    Parameters
    ----------
    search : StaticSearch
        What is seen.
    base : tuple of Pattern
        Patterns.
    derivatives : sequence of ndarray, shape (n, 3, p)
        Of each pattern in the record.
    """
    total = 0.0
    for axis in AXES:
        values = estimate(search, base, axis) if base else None
        if values is not None:
            columns = [
                d[:, axis, list(p.parameters[axis])] for p, d in zip(base, derivatives, strict=True)
            ]
            total = total + np.outer(np.concatenate(columns, axis=1) @ values, np.eye(3)[axis])
    return total


def covariance(search, base, axis):
    """Return the covariance of `estimate`, shape (p, p), from a search that holds no block out.

    The estimate weighs with one noise; the noise that is there is not known better than the
    restricted likelihood tells: ``A⁻¹ Zᵀ P̃ Σ P̃ Z A⁻¹`` is averaged over the noise Σ.
    """
    model, fit = search.sight.model, search.fit(base, axis)
    columns = [c for p in base for c in p.columns[axis]]
    point = model.point(fit)
    # N² of each noise, and of its flicker and walk
    variances = (fit.weight * fit.square / fit.dof) @ np.column_stack(
        [np.ones(len(model.grid)), model.grid]
    )
    information, spread = 0.0, 0.0
    for i, held in enumerate(search.sight.held):
        if held is None:
            continue
        precision = model.noise[i].precision[point]
        level = precision.sum(axis=1)
        z = model.of(i, columns)
        weighted = precision @ z - np.outer(level, level @ z) / level.sum()
        windows = model.fitted[i].windows
        noise = sum(
            v * mean_covariance(unit_noise(name), windows)
            for v, name in zip(variances, "NBK", strict=True)
        )
        information = information + z.T @ weighted
        spread = spread + weighted.T @ noise @ weighted
    scale = np.sqrt(np.diag(information))
    inverse = np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale)
    scales = _scales(search, base, axis)
    return inverse @ spread @ inverse / np.outer(scales, scales)


def fitted(search, base):
    """Return a FittedEffect of each pattern; None where an axis does not determine them."""
    names = [list(p.effect.parameters) for p in base]
    values, std = ([dict.fromkeys(n, 0.0) for n in names] for _ in "vs")
    for axis in AXES:
        found = estimate(search, base, axis)
        if found is None:
            return None
        errors = np.sqrt(np.diag(covariance(search, base, axis)))
        place = 0
        for pattern, own, v, s in zip(base, names, values, std, strict=True):
            for parameter in pattern.parameters[axis]:
                v[own[parameter]], s[own[parameter]] = float(found[place]), float(errors[place])
                place += 1
    return tuple(FittedEffect(p.effect, v, s) for p, v, s in zip(base, values, std, strict=True))
