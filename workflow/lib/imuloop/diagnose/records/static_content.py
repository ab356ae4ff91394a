"""The part of diagnosis.json about the static records of a sensor."""

import numpy as np

from imuloop.core.samples import SENSORS
from imuloop.diagnose.content import residuals_content, search_content, untried
from imuloop.estimate.noise_components import FARTHEST
from imuloop.estimate.residuals import held_out_covariance
from imuloop.estimate.verdict import LEFT, MARGIN, ResidualGroup, compare_with_noise
from imuloop.model.effect import OUTPUT, Effect

# reasons why a static record cannot show effects that poses can show
NOT_SHOWN = {
    "bias_drift": "in a static record it is called ramp",
    "turn_on_bias": "every static record has a level of its own: see its scatter over power cycles",
}
ONE_ATTITUDE = "in one attitude, without a turn, it cannot be told from the bias"


def static_content(sensor, finding, noise, noise_change):
    """Return the fields of diagnosis.json about the static records of a sensor.

    A static record has the means over windows of a long rest.

    Parameters
    ----------
    sensor : str
    finding : StaticFinding
        Result of the search.
    noise : NoiseModel
        Noise after the effects were subtracted; it gives the floor, the size of held-out errors
        that noise alone gives.
    noise_change : dict
        Coefficients of the noise before and after that, by axis; empty without effects.
    """
    axes, problem, effects = SENSORS[sensor], finding.choices.problem, finding.effects
    content = search_content(finding.choices, effects, finding.reasons, sensor)
    for entry, trial in zip(content["effects"], finding.choices.choice().added, strict=True):
        # errors on one axis show that the effect was tested on this axis only
        entry["axis"] = axes[trial.axis] if trial.change.before.shape[1] == 1 else None
    names = {candidate["name"] for candidate in content["candidates"]}
    content["candidates"] += [
        untried(name, "not_observable", NOT_SHOWN.get(name, ONE_ATTITUDE))
        for name, cls in Effect.library.items()
        if sensor in cls.sensors and name not in names
    ]
    # alternatives of the noise: as estimated, and with the largest flicker and random walk
    sizes = {(axis, term): noise.known(axis, term) for axis in axes for term in "BK"}
    largest = noise.with_sizes({key: size + FARTHEST * std for key, (size, std) in sizes.items()})
    # by record, axis and alternative
    covariances = [
        [[model.axes[a].mean_covariance(r.windows) for model in (noise, largest)] for a in axes]
        for r in problem.records
    ]
    errors, floor = finding.errors, _floor(problem, covariances)
    # without and with effects
    comparisons = [
        _comparisons(problem, added, heldout, covariances)
        for added, heldout in zip(((), effects), errors, strict=True)
    ]
    units = {"bias": OUTPUT[sensor]}
    content |= residuals_content(problem, units, comparisons, errors, floor, bool(effects))
    residual = content["residuals"]["bias"]
    # the noise was estimated from these residuals, so it may include a missing effect
    too_large = residual["after"] > MARGIN * residual["floor"]
    content["slow_noise"] = bool(too_large and content["verdict"] not in LEFT)
    residual["sessions"] = _errors_by_session(axes, problem, errors, floor)
    return content | {"noise": noise_change, "points": _points(problem, effects, errors, floor)}


def _floor(problem, covariances):
    """Return the variance of the held-out errors that the noise as estimated gives, (N, 3).

    A held-out error is a mean minus the level of its record, which is the mean of the training
    rows. One of the N rows is a mean over a window. `covariances` has, for each record and each
    axis, two covariances that the noise of its n means may have, (n, n) each; the noise as
    estimated is the first.
    """
    floors = []
    for record, group, by_axis in zip(
        problem.records, problem.evidence.row_groups, covariances, strict=True
    ):
        weights = np.diag(record.length)
        of_errors = [
            held_out_covariance(estimated, group.nuisance, group.row_folds, weights)
            for estimated, _ in by_axis
        ]
        floors.append(np.column_stack([np.diag(covariance) for covariance in of_errors]))
    return np.concatenate(floors)


def _comparisons(problem, effects, errors, covariances):
    """Compare all N rows, means over windows, with the noise, after effects are subtracted.

    Parameters
    ----------
    problem : StaticProblem
    effects : sequence of FittedEffect
    errors : ndarray, shape (N, 3)
        Held-out errors with these effects.
    covariances : list of list of list of ndarray
        For each record and each axis, the two covariances that the noise of its n means may have,
        (n, n) each; the noise as estimated is the first.

    Returns
    -------
    list of NoiseComparison
        One entry: there is one kind of residual.
    """
    evidence, groups = problem.evidence, []
    by_record = evidence.split(problem.subtract(effects))
    for values, rows, by_axis in zip(by_record, evidence.row_groups, covariances, strict=True):
        every_row = [np.ones(len(values), dtype=bool)]
        groups += [
            ResidualGroup(
                values=column,
                jacobian=rows.nuisance,
                covariances=alternatives,
                row_folds=rows.row_folds,
                kinds=every_row,
            )
            for column, alternatives in zip(values.T, by_axis, strict=True)
        ]
    patterns = evidence.patterns([effect.effect for effect in effects])
    # number of parameters of the effects, on all axes
    fitted = sum(len(columns) for pattern in patterns for columns in pattern.columns)
    # both alternatives of the noise are equally probable
    return compare_with_noise(
        groups, log_prior=(0.0, 0.0), squares=[(errors**2).sum()], fitted=fitted
    )[1]


def _errors_by_session(axes, problem, errors, floor):
    """Return root mean square held-out errors before and after, and the floor, SI.

    The result is a dict by session and axis. `axes` are the names of the axes. `errors` has the
    held-out errors of the N means without and with effects, and `floor` their variance by the noise
    alone, (N, 3) each.
    """
    squares = {"before": errors[0] ** 2, "after": errors[1] ** 2, "floor": floor}
    # session of each of the N means
    names = np.concatenate([np.repeat(r.session, len(r.windows)) for r in problem.records])
    content = {}
    for session in dict.fromkeys(names):
        sizes = {key: np.sqrt(x[names == session].mean(axis=0)) for key, x in squares.items()}
        content[str(session)] = {
            axis: {key: float(size[k]) for key, size in sizes.items()}
            for k, axis in enumerate(axes)
        }
    return content


def _points(problem, effects, errors, floor):
    """Return a list with one dict per window: times, errors, floor and values, SI, for plots.

    `effects` are the added FittedEffects. `errors` has the held-out errors of the N means without
    and with effects, and `floor` their variance by the noise alone, (N, 3) each.
    """
    split = problem.evidence.split
    norms = [np.linalg.norm(e, axis=1) for e in (*errors, np.sqrt(floor))]
    by_record = zip(*map(split, (problem.values, problem.subtract(effects), *norms)), strict=True)
    points = []
    for record, (values, corrected, *record_norms) in zip(problem.records, by_record, strict=True):
        centred, corrected = ((x - x.mean(axis=0)).tolist() for x in (values, corrected))
        before, after, noise = (x.tolist() for x in record_norms)
        for k, start in enumerate(record.windows[:, 0].tolist()):
            point = {
                "residual": "bias",
                "index": k,
                "session": record.session,
                "start_s": start,
                "before": before[k],
                "after": after[k],
                "values": centred[k],
                "floor": noise[k],
            }
            points.append(point | ({"corrected": corrected[k]} if effects else {}))
    return points
