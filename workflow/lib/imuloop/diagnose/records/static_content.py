"""The part of diagnosis.json about the static records of a sensor."""

import numpy as np

from imuloop.core.samples import SENSORS
from imuloop.diagnose.content import residual_entry, search_content, untried
from imuloop.estimate.noise_components import FARTHEST
from imuloop.estimate.residuals import held_out_covariance
from imuloop.estimate.verdict import MARGIN, RESIDUALS, judge, verdict
from imuloop.model.effect import Effect

UNITS = {"accelerometer": "m/s^2", "gyroscope": "rad/s"}
# reasons why a static record cannot show effects that poses can show
NOT_SHOWN = {
    "bias_drift": "in a static record it is called ramp",
    "turn_on_bias": "every static record has a level of its own: see its scatter over power cycles",
}
ONE_ATTITUDE = "in one attitude, without a turn, it cannot be told from the bias"


def searched_content(sensor, finding):
    """Return the fields of diagnosis.json about the search: effects and candidates.

    `finding` is the StaticFinding of the sensor.
    """
    choices, axes = finding.choices, SENSORS[sensor]
    found = search_content(choices, finding.effects, finding.others, sensor)
    for entry, own in zip(found["effects"], choices.choice().added, strict=True):
        entry["axis"] = axes[own.trial.axis] if own.change.before.shape[1] == 1 else None
    return found


def static_content(sensor, finding, searched, noise, change):
    """Return the fields of diagnosis.json about the static records of a sensor.

    Parameters
    ----------
    sensor : str
    finding : StaticFinding
        Result of the search.
    searched : dict
        Its fields, from `searched_content`.
    noise : NoiseModel
        Noise after the effects were subtracted; it gives the floor.
    change : dict
        Coefficients of the noise before and after that, by axis; empty without effects.
    """
    axes, problem, effects = SENSORS[sensor], finding.choices.problem, finding.effects
    settings = problem.settings
    floor = _floor(problem, noise, axes)
    added = bool(effects)
    share, errors = settings.significance / RESIDUALS / settings.family, finding.errors
    sides = zip(((), effects), errors, strict=True)
    judged = [_judged(problem, *side, noise, axes) for side in sides]
    how = judged, errors, floor, share, added
    residual, above = residual_entry(problem, "bias", UNITS[sensor], slice(None), *how)
    listed = {c["name"] for c in searched["candidates"]}
    not_shown = (
        untried(name, "not_observable", NOT_SHOWN.get(name, ONE_ATTITUDE))
        for name, cls in Effect.library.items()
        if sensor in cls.sensors and name not in listed
    )
    return searched | {
        "verdict": verdict(*above, added),
        # the noise was estimated from these residuals, so it may include a missing effect
        "slow_noise": bool(residual["after"] > MARGIN * residual["floor"] and not above[1]),
        "residuals": {"bias": residual | {"sessions": _by_axis(axes, problem, errors, floor)}},
        "candidates": [*searched["candidates"], *not_shown],
        "noise": change,
        "points": _points(problem, effects, errors, floor),
    }


def _floor(problem, noise, axes):
    """Return the variance of the held-out errors that the noise alone gives, (N, 3).

    The level of a record is the mean of its training rows.
    """
    columns = []
    for name in axes:
        pairs = zip(problem.records, problem.evidence.row_groups, strict=True)
        covariances = [
            held_out_covariance(
                noise.axes[name].mean_covariance(r.windows),
                *(g.nuisance, g.row_folds, np.diag(r.length)),
            )
            for r, g in pairs
        ]
        columns.append(np.concatenate([np.diag(c) for c in covariances]))
    return np.column_stack(columns)


def _judged(problem, effects, errors, noise, axes):
    """Return the Judged of the rows after some FittedEffects are subtracted.

    `errors`, (N, 3), are the held-out errors with these effects. The alternatives of the noise are
    the noise as estimated, and flicker and random walk at the upper ends of their intervals.
    """
    evidence = problem.evidence
    left = np.concatenate([g.values for g in evidence.row_groups])
    left = left - sum((problem.design(e.effect) @ e.vector for e in effects), np.zeros(()))
    fitted = sum(len(c) for p in evidence.patterns([e.effect for e in effects]) for c in p.columns)
    sizes = {(axis, term): noise.known(axis, term) for axis in axes for term in "BK"}
    most = noise.with_sizes({key: size + FARTHEST * std for key, (size, std) in sizes.items()})
    alternatives = []
    for model in (noise, most):
        groups = []
        for values, group, record in zip(
            evidence.split(left), evidence.row_groups, problem.records, strict=True
        ):
            for k, name in enumerate(axes):
                covariance = model.axes[name].mean_covariance(record.windows)
                rows = [np.ones(len(values), dtype=bool)]
                groups.append((values[:, k], covariance, group.nuisance, group.row_folds, rows))
        alternatives.append((0.0, groups))
    _, (judged,) = judge(alternatives, [(errors**2).sum()], fitted)
    return judged


def _by_axis(axes, problem, errors, floor):
    """Return the root mean square held-out error before and after, and the floor.

    The result is a dict by session and axis; `errors` has the errors before and after, (N, 3) each.
    """
    squares = dict(zip(("before", "after", "floor"), (*(e**2 for e in errors), floor), strict=True))
    return {
        str(own): {
            name: {
                key: float(np.sqrt(s[problem.session == own, k].mean()))
                for key, s in squares.items()
            }
            for k, name in enumerate(axes)
        }
        for own in dict.fromkeys(problem.session)
    }


def _points(problem, effects, errors, floor):
    """Return a list with one dict per window: times, errors, floor and values, for plots."""
    points, start = [], 0
    taken = sum((problem.design(e.effect) @ e.vector for e in effects), np.zeros(()))
    for record in problem.records:
        own = slice(start, start + len(record.windows))
        raw, left = (v[own] - v[own].mean(axis=0) for v in (problem.values, problem.values - taken))
        before, after = (np.linalg.norm(e[own], axis=1) for e in errors)
        for k, begin in enumerate(record.windows[:, 0]):
            point = {
                "residual": "bias",
                "index": k,
                "session": record.session,
                "start_s": float(begin),
                "before": float(before[k]),
                "after": float(after[k]),
                "values": raw[k].tolist(),
                "floor": float(np.sqrt(floor[own][k].sum())),
            }
            points.append(point | ({"corrected": left[k].tolist()} if effects else {}))
        start = own.stop
    return points
