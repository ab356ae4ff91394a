"""The part of diagnosis.json about the search in one kind of record: effects and candidates."""

import numpy as np

from imuloop.estimate.likeness import holder, imitations, twin
from imuloop.estimate.limits import detection_limits
from imuloop.estimate.residuals import size
from imuloop.estimate.verdict import above_floor, why_not_shown


def search_content(choices, fitted, others, sensor):
    """Return the fields of diagnosis.json about the search on one sensor.

    Parameters
    ----------
    choices : Choices
        The searches and the choice of effects.
    fitted : sequence of FittedEffect
        The added effects, in the order of the choice.
    others : dict of type to (str, str)
        Status and reason of the effects that were not tried.
    sensor : str
    """
    problem, choice = choices.problem, choices.choice()
    every = (*problem.shapes, *problem.scans)
    kinds = [kind for kind in every if getattr(kind, "sensor", sensor) == sensor]
    return {
        "effects": [
            {
                **effect.to_dict(),
                "units": effect.effect.units(sensor),
                "p_value": own.trial.p_value,
                "residual": own.change.residual_kind,
                "heldout_before": size_of(problem, own.change.residual_kind, own.change.before),
                "heldout_after": size_of(problem, own.change.residual_kind, own.change.after),
                "ratio_ci95": own.change.ratio,
            }
            for effect, own in zip(fitted, choice.added, strict=True)
            if own.effect.kind in kinds
        ],
        "candidates": [
            *(_candidate(sensor, choices, kind) for kind in kinds),
            *(untried(cls.name, *reason) for cls, reason in others.items()),
        ],
        "confounded": imitations(choices.search(), [k for k in kinds if not k.is_formula]),
    }


def residual_entry(problem, kind, unit, rows, judged, errors, floor, share, chosen):
    """Return the entry of a kind of residual in diagnosis.json, and whether it is above its floor.

    Parameters
    ----------
    problem : PoseProblem or StaticProblem
    kind, unit : str
        Kind of residual and its unit.
    rows : ndarray, shape (N,) of bool, or slice
        Its rows.
    judged : pair of Judged
        Comparison with the noise, without and with effects.
    errors : pair of ndarray, shape (N, a)
        Held-out errors without and with effects.
    floor : ndarray, shape (N, a)
        Variance of the errors that the noise alone gives.
    share : float
        Significance for this kind of residual.
    chosen : bool
        Whether there are effects, which the data chose.

    Returns
    -------
    dict
    list of bool
        Whether the residual is above its floor, without and with effects.
    """
    noise = np.sqrt(floor[rows])
    least, *sizes = (size_of(problem, kind, e) for e in (noise, *(e[rows] for e in errors)))
    above = [
        above_floor(judge, share, heldout, least, by_data)
        for judge, heldout, by_data in zip(judged, sizes, (False, chosen), strict=True)
    ]
    entry = {
        "unit": unit,
        "n": int(np.isfinite(noise).sum()) // problem.components(kind),
        "floor": least,
        "before": sizes[0],
        "after": sizes[1],
        "chi2_before": judged[0].reduced_chi2,
        "chi2_after": judged[1].reduced_chi2,
    }
    return entry, above


def untried(name, status, why):
    """Return the entry in diagnosis.json of a candidate that was not tried, with the reason."""
    figures = ("p_value", "heldout_after", "detection_limit", "confounded_with")
    return {"name": name, "status": status, "why": why, **dict.fromkeys(figures)}


def _candidate(sensor, choices, kind):
    """Return the entry in diagnosis.json of a kind of effect that was tried on a sensor."""
    problem, search, choice = choices.problem, choices.search(), choices.choice()
    own = [a for a in choice.added if a.effect.kind == kind]
    before = tuple(e for e in choice.base if e.kind != kind)
    trial, name = own[0].trial if own else search.trial(choice.base, kind), None
    status, why = "rejected", "the residual does not fall by more than chance"
    if own:
        status, why = "added", "lowers the residual in the fit and in held-out data"
    elif trial is None:
        name, before, trial = holder(search, choice.base, kind), (), search.trial((), kind)
        if name is None:
            return untried(kind.name, "not_observable", problem.why_no_trial(search, kind))
        status, why = "confounded", f"{name} adds all that it would: they are one in these data"
    elif kind in choice.failed:
        low, high = choice.failed[kind]
        why = f"held-out error does not fall for certain: ratio {low:.3f} to {high:.3f}"
    elif trial.impossible:
        why = f"it would have to be larger than {kind.limit:g}, the most that is possible"
    elif name := twin(search, choice.base, kind):
        status = "confounded"
        why = f"in these data it could stand in for {name}: neither adds to the other"
    elif _by_slow_noise(search, before, trial):
        why = "slow noise that these data do not exclude could look the same"
    limits = detection_limits(search, before, trial, problem.settings.power)
    units, passed = trial.effect.units(sensor), kind in choice.failed
    if status == "rejected" and not passed and (reason := why_not_shown(kind, limits, units)):
        status, why, limits = "not_observable", reason, None
    elif not limits:
        # no size would be confirmed by cross-validation: the limit is that of the test alone
        limits = detection_limits(
            search, before, trial, problem.settings.power, must_lower_error=False
        )
    residual_kind, rows = problem.most_changed_rows(search, before, trial)
    values, std, _ = search.estimate(before, trial.effect)
    names, heldout = list(trial.effect.parameters), None
    if trial.p_value < problem.settings.significance:
        heldout = size_of(problem, residual_kind, choices.errors_with((kind,))[rows])
    return {
        "name": kind.name,
        "status": status,
        "why": why,
        "residual": residual_kind,
        "p_value": trial.p_value,
        "heldout_after": heldout,
        "constants": trial.effect.constants,
        "parameters": dict(zip(names, values.tolist(), strict=True)),
        "std": dict(zip(names, std.tolist(), strict=True)),
        "confounded_with": name,
        "detection_limit": limits,
        "units": units,
    }


def _by_slow_noise(search, base, trial):
    """Return whether a trial fails only because of noise that is slower than was estimated.

    It fails under all hypotheses, but would pass under those without more slow noise.
    """
    if trial.log_p < search.threshold(len(base)):
        return False
    estimated = search.training_fit(base).evidence.as_estimated_mask
    (plain,) = search.tests(base, (trial.effect,), estimated)
    return bool(plain and plain.log_p + trial.tries < search.threshold(len(base)))


def size_of(problem, kind, errors):
    """Return the root mean square norm of the errors, (n, a), of one kind of residual."""
    return size(errors.reshape(-1, problem.components(kind) * errors.shape[1]))
