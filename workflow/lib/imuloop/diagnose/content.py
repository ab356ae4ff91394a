"""The parts of diagnosis.json that all kinds of records share: effects, candidates, residuals."""

import numpy as np

from imuloop.effects.temperature import LEAST_SPAN, span
from imuloop.estimate.held_out import rms_norm
from imuloop.estimate.likeness import imitations, masking_effect, twin
from imuloop.estimate.limits import detection_limits
from imuloop.estimate.verdict import above_floor, verdict, why_not_shown
from imuloop.model.effect import Effect


def candidates(sensor, record, channels):
    """Return the variants to try on a sensor, and the effects that are not tried.

    A variant is an effect with values of its constants, such as a time constant. An effect that
    does not show in this kind of record is in neither result. Exception: an effect with
    `unobservable`, a text that says why rests cannot show it, is in the second result with this
    text as its reason.

    Parameters
    ----------
    sensor : str
        Name of the sensor.
    record : {'poses', 'static_record'}
        Kind of record.
    channels : Channels
        Inputs of the effects in this record.

    Returns
    -------
    dict of type to tuple of Effect
        The variants to try, by type of effect.
    dict of type to (str, str)
        By type of effect, the status and the reason of each effect that is not tried.
    """
    variants, reasons, cycle = {}, {}, channels.power_cycle
    # power cycles have numbers from 0
    several_cycles = cycle is not None and cycle.any()
    for cls in Effect.library.values():
        if sensor not in cls.sensors or (record not in cls.records and not cls.unobservable):
            continue
        if cls.unobservable:
            reasons[cls] = ("not_observable", cls.unobservable)
        elif "temperature" in cls.needs and channels.temperature is None:
            reasons[cls] = ("not_available", "not every session logs a temperature")
        elif "temperature" in cls.needs and span(channels) <= LEAST_SPAN:
            reasons[cls] = (
                "not_observable",
                f"the temperature changes by {span(channels):.2g} K: a thermometer's own error can "
                f"do so up to {LEAST_SPAN:g} K",
            )
        elif "power_cycle" in cls.needs and not several_cycles:
            reasons[cls] = (
                "not_available",
                "one power cycle shows one bias: record several sessions, switched off and on "
                "between",
            )
        elif "power_cycle" in cls.needs and cycle.max() >= cls.bounds["runs"][1]:
            reasons[cls] = ("not_available", f"more power cycles than {cls.bounds['runs'][1]}")
        else:
            variants[cls] = tuple(cls.variants(channels))
    return variants, reasons


def search_content(choices, fitted, reasons, sensor):
    """Return the fields of diagnosis.json about the search for effects of one sensor, a dict.

    Parameters
    ----------
    choices : Choices
        The searches and the choice of effects.
    fitted : sequence of FittedEffect
        The added effects, in the order of the choice.
    reasons : dict of type to (str, str)
        By class of effect, status and reason of each effect that was not tried.
    sensor : str
        Name of the sensor.

    Returns
    -------
    dict
        ``effects``, the added effects; ``candidates``, all effects with the result of their test;
        and ``confounded``, pairs of effects that these data can hardly tell apart.
    """
    problem = choices.problem
    kinds = [kind for kind in choices.kinds if getattr(kind, "sensor", sensor) == sensor]
    return {
        "effects": [
            {
                **effect.to_dict(),
                "units": effect.effect.units(sensor),
                "p_value": trial.p_value,
                "residual": trial.change.residual_kind,
                "heldout_before": size_of(problem, trial.change.residual_kind, trial.change.before),
                "heldout_after": size_of(problem, trial.change.residual_kind, trial.change.after),
                "ratio_ci95": trial.change.ratio,
            }
            for effect, trial in zip(fitted, choices.choice().added, strict=True)
            if trial.effect.kind in kinds
        ],
        "candidates": [
            *(_candidate(sensor, choices, kind) for kind in kinds),
            *(untried(cls.name, status, why) for cls, (status, why) in reasons.items()),
        ],
        "confounded": imitations(choices, [k for k in kinds if not k.is_formula]),
    }


def residuals_content(problem, kinds, comparisons, errors, floor, has_effects):
    """Return the verdict on the residuals of a record, and each kind of residual with its floor.

    The floor is the held-out error that the noise alone gives. Residuals are compared with it
    twice: by a model without and by one with the added effects.

    Parameters
    ----------
    problem : PoseProblem or StaticProblem
        Problem with N rows, which are components of residuals, on a axes.
    kinds : sequence of str
        Kinds of residuals.
    comparisons : pair of list of NoiseComparison
        Comparison of each kind with the noise, without and with the effects.
    errors : pair of ndarray, shape (N, a)
        Held-out errors without and with the effects.
    floor : ndarray, shape (N, a)
        Variance of the held-out errors that the noise alone gives.
    has_effects : bool
        Whether there are added effects.

    Returns
    -------
    dict
        Fields of diagnosis.json: ``verdict``, and ``residuals``, a dict by kind.
    """
    entries, above_before, above_after = {}, False, False
    significance = problem.settings.residual_significance
    for kind, before, after in zip(kinds, *comparisons, strict=True):
        rows, (unit, components) = problem.of_kind(kind), problem.kinds[kind]
        noise = np.sqrt(floor[rows])
        by_noise = size_of(problem, kind, noise)
        error_before, error_after = (size_of(problem, kind, e[rows]) for e in errors)
        above_before |= above_floor(before, significance, error_before, by_noise, has_effects=False)
        above_after |= above_floor(after, significance, error_after, by_noise, has_effects)
        entries[kind] = {
            "unit": unit,
            "n": int(np.isfinite(noise).sum()) // components,
            "floor": by_noise,
            "before": error_before,
            "after": error_after,
            "chi2_before": before.reduced_chi2,
            "chi2_after": after.reduced_chi2,
        }
    return {"verdict": verdict(above_before, above_after, has_effects), "residuals": entries}


def untried(name, status, why):
    """Return the entry in diagnosis.json of an effect that was not tried, a dict.

    `name` is the name of the effect, and `why` the reason for its `status`, all texts. Figures of a
    test, such as the p-value, are None.
    """
    figures = ("p_value", "heldout_after", "detection_limit", "confounded_with")
    return {"name": name, "status": status, "why": why, **dict.fromkeys(figures)}


def _candidate(sensor, choices, kind):
    """Return the entry in diagnosis.json of a kind of effect that was tried on a sensor, a dict.

    The entry has the status with its reason, the p-value, the estimated parameters and the
    detection limit, which is the least size of the effect that these data would show. `choices` are
    the Choices: the searches in the record and the choice of effects. `kind` is the kind of effect,
    and `sensor` the name of the sensor.
    """
    problem, choice = choices.problem, choices.choice()
    # the kind is tested with all other added effects in the model
    base = tuple(e for e in choice.effects if e.kind != kind)
    added = [trial for trial in choice.added if trial.effect.kind == kind]
    trial = added[0] if added else choices.trial(base, kind)
    if trial is None:
        # the kind cannot be estimated next to the base: an effect of the base, or the base model,
        # absorbs it. Its entry then comes from a test without the base
        alike, base, trial = masking_effect(choices, base, kind), (), choices.trial((), kind)
        if alike is None:
            return untried(kind.name, "not_observable", problem.why_no_trial)
        status, why = "confounded", f"{alike} adds all that it would: they are one in these data"
    else:
        status, why, alike = _status(choices, base, trial)
    power = problem.settings.power
    limits, units = detection_limits(choices, base, trial, power), trial.effect.units(sensor)
    reason = None
    if status == "rejected" and kind not in choice.failed:
        reason = why_not_shown(kind, limits, units)
    if reason:
        status, why, limits = "not_observable", reason, None
    elif not limits:
        # cross-validation would confirm no size: the limit then comes from the test alone
        limits = detection_limits(choices, base, trial, power, must_lower_error=False)
    residual_kind, rows = problem.most_changed_rows(choices, base, trial)
    values, std, _ = choices.estimate(base, trial.effect)
    names, heldout = list(trial.effect.parameters), None
    # held-out error of a model with effects of this kind alone
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
        "confounded_with": alike,
        "detection_limit": limits,
        "units": units,
    }


def _status(choices, base, trial):
    """Return three texts about a kind of effect that was tried: status, reason and double.

    The double is the name of an effect that these data cannot tell from this one. It is None if the
    status is not “confounded”. `choices` are the Choices: the searches and the added effects.
    `trial` is the Trial, the significance test, of this kind, and `base` has the added effects of
    other kinds.
    """
    choice, kind = choices.choice(), trial.effect.kind
    if any(trial is added for added in choice.added):
        return "added", "lowers the residual in the fit and in held-out data", None
    why = "the residual does not fall by more than chance"
    if kind in choice.failed:
        low, high = choice.failed[kind]
        why = f"held-out error does not fall for certain: ratio {low:.3f} to {high:.3f}"
    elif trial.impossible:
        why = f"it would have to be larger than {kind.limit:g}, the most that is possible"
    elif alike := twin(choices, base, kind):
        why = f"in these data it could stand in for {alike}: neither adds to the other"
        return "confounded", why, alike
    elif _by_slow_noise(choices, base, trial):
        why = "slow noise that these data do not exclude could look the same"
    return "rejected", why, None


def _by_slow_noise(search, base, trial):
    """Return whether an effect is significant only if slow noise is as small as estimated, a bool.

    A noise hypothesis is one covariance that the noise may have. The result is True if the test of
    the effect fails with the average over all hypotheses, but passes with the average over those
    that have no more slow noise than was estimated. An effect that passes with all hypotheses gives
    False. `search` is the Search of all data, `base` has the effects in the
    model, and `trial` is the Trial, the test, of the effect.
    """
    if trial.log_p < search.threshold(len(base)):
        return False
    mask = search.training_fit(base).evidence.as_estimated_mask
    (as_estimated,) = search.tests(base, (trial.effect,), mask)
    return bool(as_estimated and as_estimated.log_p + trial.log_tries < search.threshold(len(base)))


def size_of(problem, kind, errors):
    """Return the root mean square norm of the residuals of one kind, a float, SI.

    `kind` is the kind of residual, such as rotation, and `problem` the PoseProblem or
    StaticProblem. `errors`, (n, k), are the residuals or held-out errors in the n rows of this
    kind, with one column for each of k axes. A residual consists of `problem.kinds[kind][1]`
    consecutive rows, its components. The norm of a residual is over its components on all axes.
    """
    return rms_norm(errors.reshape(-1, problem.kinds[kind][1] * errors.shape[1]))
