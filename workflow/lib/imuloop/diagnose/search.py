"""The search for effects: test, add the best that passes, refit, and measure on held-out data."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2, f, ncx2

from imuloop.core.effect import Effect
from imuloop.diagnose.residuals import held_out_variance


@dataclass(frozen=True)
class Trial:
    """One candidate tested against the model without it.

    Attributes
    ----------
    effect : type
        Class of the effect.
    p_value : float
        Of the F test that all its parameters are zero.
    solution : Solution
        The fit with it.
    """

    effect: type
    p_value: float
    solution: object


@dataclass(frozen=True)
class HeldOut:
    """Held-out errors of one kind of residual, in the order of the data.

    Attributes
    ----------
    fold : ndarray of int, shape (n,)
        Which part each residual was held out with.
    before, after : ndarray, shape (n, k)
        Errors of models that never saw that part: without effects, and with the effects that a
        search on the other parts alone chose.
    variance : ndarray, shape (n, k)
        Of the errors before, from the noise alone.
    """

    fold: np.ndarray
    before: np.ndarray
    after: np.ndarray
    variance: np.ndarray

    @property
    def floor(self):
        """Root mean square of the error's size that the noise alone gives."""
        return float(np.sqrt(self.variance.sum(axis=1).mean()))


def candidates(sensor, recording):
    """Return the effects of the library that a sensor can have, and why some cannot be tested."""
    available, missing = [], {}
    for effect in Effect.library.values():
        if sensor not in effect.sensors:
            continue
        if "temperature" in effect.needs and recording.poses.temperature is None:
            missing[effect] = "not every pose has a temperature"
        else:
            available.append(effect())
    return available, missing


def trial(model, recording, solution, effect):
    """Test one effect against a solution without it.

    ``F = ((χ²₀ - χ²₁) / q) / max(1, χ²₁ / ν₁)`` with q parameters: the noise model sets the
    scale, and where the residual exceeds it even with the effect, the residual does.
    """
    wider = model.fit(recording, (*solution.effects, effect))
    q = len(effect.parameters)
    scale = max(1.0, wider.chi2 / wider.dof) if wider.dof > 0 else np.inf
    statistic = max(0.0, solution.chi2 - wider.chi2) / q / scale
    return Trial(effect, float(f.sf(statistic, q, max(wider.dof, 1))), wider)


def search(model, recording, available, significance):
    """Add the best effect that passes until none does.

    Holm's first step: the smallest of m p-values is held against ``significance / m``, m the
    number of candidates that are left.

    Returns
    -------
    Solution, Solution, dict of type to Trial
        Without effects, with those that passed, and the last trial of every candidate.
    """
    base = solution = model.fit(recording)
    last = {}
    left = list(available)
    while left:
        trials = [trial(model, recording, solution, effect) for effect in left]
        last.update({t.effect: t for t in trials})
        best = min(trials, key=lambda t: t.p_value)
        if best.p_value >= significance / len(left):
            break
        solution = best.solution
        left.remove(best.effect)
    return base, solution, last


def hold_out(model, recording, whole, available, settings):
    """Return the held-out errors of every kind of residual.

    The poses are split into parts that follow each other in time. For each, model and choice of
    effects see only the other poses and the rotations between them; a rotation belongs to the
    part of the pose that it starts from.

    Parameters
    ----------
    model : AccelerometerPoses or GyroscopePoses
        How the sensor is fitted.
    recording : Recording
        Poses and rotations.
    whole : Solution
        Fit of all poses without effects: its covariance and derivative give the floor.
    available : sequence of type
        Effects to choose from.
    settings : DiagnoseSettings
        Settings.

    Returns
    -------
    dict of str to HeldOut, or None
        None where the other parts alone do not determine a calibration.
    """
    n = len(recording.poses)
    folds = min(settings.folds, n)
    part = np.arange(n) * folds // n
    collected = {}
    for fold in range(folds):
        training = recording.select(part != fold)
        if model.untestable(training):
            return None
        base, solution, _ = search(model, training, available, settings.significance)
        before, after = (model.errors(s, recording) for s in (base, solution))
        floor = _floor(whole, before, part, fold)
        for kind, (values, poses) in before.items():
            held = part[poses[:, 0]] == fold
            entry = collected.setdefault(kind, ([], [], [], []))
            entry[0].append(np.full(held.sum(), fold))
            entry[1].append(values[held])
            entry[2].append(after[kind][0][held])
            entry[3].append(floor[kind])
    return {
        kind: HeldOut(*(np.concatenate(column) for column in columns))
        for kind, columns in collected.items()
    }


def _floor(whole, errors, part, fold):
    """Return the variance of the errors of one part, by kind of residual."""
    seen, held = [], []
    for values, poses in errors.values():
        k = values.shape[1]
        seen.append(np.repeat(np.all(part[poses] != fold, axis=1), k))
        held.append(np.repeat(part[poses[:, 0]] == fold, k))
    variance = held_out_variance(
        whole.covariance, whole.jacobian, np.concatenate(seen), np.concatenate(held)
    )
    counts = np.cumsum([h.sum() for h in held])[:-1]
    return {
        kind: piece.reshape(-1, values.shape[1])
        for (kind, (values, _)), piece in zip(
            errors.items(), np.split(variance, counts), strict=True
        )
    }


def ratio_interval(held, settings):
    """Return the 95 % interval of held-out error after over before, whole parts drawn again."""
    folds = np.unique(held.fold)
    sums = np.array(
        [[(e[held.fold == k] ** 2).sum() for e in (held.before, held.after)] for k in folds]
    )
    draws = np.random.default_rng(settings.seed).integers(
        len(folds), size=(settings.draws, len(folds))
    )
    before, after = sums[draws].sum(axis=1).T
    return [float(q) for q in np.quantile(np.sqrt(after / before), [0.025, 0.975])]


def detection_limit(tried, settings, tests):
    """Return the smallest size of each parameter that this log would have shown.

    The noncentrality λ at which a χ² test of q parameters finds the effect with the wanted power
    gives a size of ``sqrt(λ / (C⁻¹)_kk)`` for a parameter that alone is not zero.

    Parameters
    ----------
    tried : Trial
        The candidate's trial.
    settings : DiagnoseSettings
        Significance and power.
    tests : int
        Number of candidates that the significance is shared by.
    """
    effect, solution = tried.effect, tried.solution
    q = len(effect.parameters)
    scale = max(1.0, solution.chi2 / solution.dof)
    information = np.linalg.inv(solution.parameters[-q:, -q:] * scale)
    threshold = chi2.isf(settings.significance / tests, q)
    noncentrality = brentq(lambda x: ncx2.sf(threshold, q, x) - settings.power, 1e-3, 1e3)
    limits = np.sqrt(noncentrality / np.diag(information))
    return dict(zip(effect.parameters, limits.tolist(), strict=True))
