"""The verdict on a residual: consistent, explained, partly explained or unexplained."""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, softmax

from imuloop.estimate.least_squares import chi_square
from imuloop.estimate.residuals import chance, held_out_covariance

# ratio of held-out error to floor that an error of the floor itself can explain
MARGIN = 1.25
# verdicts after a test, from the best to the worst
TESTED = ("consistent", "explained", "partly_explained", "unexplained")
# number of kinds of residuals of a device, which share the significance: gravity norm, pose rate,
# rotation, two of velocity, and for each sensor the bias at rest and the comparison to a reference
RESIDUALS = 9
# verdicts after which a missing effect may still be found
LEFT = ("unexplained", "partly_explained")


def not_testable(why):
    """Return the fields of diagnosis.json for data that cannot be tested; `why` is the reason."""
    lists = ("effects", "candidates", "confounded")
    return {"verdict": "not_testable", "why": why, "residuals": {}} | {name: [] for name in lists}


@dataclass(frozen=True)
class Judged:
    """The residuals of one kind, compared with what the noise alone would leave."""

    # the first two are averaged over the alternatives of the noise
    p_value: float  # probability that the noise gives so large a χ² of the fit
    heldout: float  # probability that the noise gives so large held-out errors
    estimated: float  # as `p_value`, with the noise as estimated, which is the first alternative
    reduced_chi2: float  # reduced χ² of the fit with the noise as estimated


def judge(alternatives, squares, fitted=0, predicted=True):
    """Compare residuals with what the noise alone would leave.

    Parameters
    ----------
    alternatives : list of (float, list of tuple)
        Alternatives of the noise. Each has the logarithm of its prior probability, and a tuple for
        each independent group of n rows: residuals, (n,), their covariance, (n, n), Jacobian,
        (n, p), folds, (n, 2), and the rows of each kind, (n,) of bool.
    squares : list of float
        Sum of the squared held-out errors of each kind.
    fitted : int
        Number of fitted parameters that are not columns of the Jacobian.
    predicted : ndarray, shape (n,) of bool, or True
        Rows that have held-out errors; all by default.

    Returns
    -------
    ndarray
        Posterior probability of each alternative.
    list of Judged
        The comparison for each kind of residual.
    """

    def of_predicted(covariance, rows):
        return covariance[np.ix_(rows & predicted, rows & predicted)]

    chi2, heldout, logs = [], [], []
    for prior, groups in alternatives:
        fits = [chi_square(values, c, jacobian, kinds) for values, c, jacobian, _, kinds in groups]
        chi2.append(np.sum([by_kind for by_kind, _ in fits], axis=0) - [0, fitted])
        logs.append(prior + sum(likelihood for _, likelihood in fits))
        spreads = [(held_out_covariance(*g[1:4]), g[4]) for g in groups]
        heldout.append(
            [
                chance(square, [of_predicted(spread, rows[k]) for spread, rows in spreads])
                for k, square in enumerate(squares)
            ]
        )
    weights, judged = softmax(logs), []
    for of_fit, of_errors in zip(np.swapaxes(chi2, 0, 1), np.transpose(heldout), strict=True):
        p_values = [float(chdtrc(dof, square)) for square, dof in of_fit]
        square, dof = of_fit[0]
        means = float(weights @ p_values), float(weights @ of_errors)
        judged.append(Judged(*means, p_values[0], float(square / dof)))
    return weights, judged


def verdict(above_before, above_after, effects):
    """Return the verdict on a residual, one of `TESTED`.

    `above_before` and `above_after`, bool, say whether the residual is above its floor without and
    with the added effects; `effects` says whether there are any.
    """
    if not effects:
        return "unexplained" if above_before else "consistent"
    return "partly_explained" if above_after else "explained"


def of_calibration(records, static):
    """Return the worst verdict of the records that a sensor's calibration comes from.

    `records` has the content of diagnosis.json for each kind of record of the sensor. Poses and the
    comparison to a reference always count. A static record counts if there is a static session,
    `static`. Other records, such as motion, count if they added an effect.
    """
    kinds = ("poses", "reference", *["static_record"] * static)
    verdicts = [c["verdict"] for kind, c in records.items() if kind in kinds or c["effects"]]
    return max((v for v in verdicts if v in TESTED), key=TESTED.index, default="not_testable")


def leaves(content):
    """Return whether an effect may still be missing, by a record's content of diagnosis.json.

    It may if the verdict says so, or if only more slow noise than was estimated explains the
    residuals: a missing effect can look like slow noise.
    """
    return content["verdict"] in LEFT or content.get("slow_noise", False)


def above_floor(judged, share, heldout, floor, chosen):
    """Return whether a residual is larger than the noise explains.

    It is in two cases:

    - χ² of the fit is too large, and the held-out error is above its floor.
    - The held-out error is above its floor by more than `MARGIN`, and is too large for the noise.
      χ² does not matter here: a wrong effect fits the data that it was chosen by.

    `judged` is the Judged of the residual, `share` the significance, `heldout` the held-out error
    and `floor` the one that the noise alone predicts. `chosen` says whether the model has effects,
    which the data chose. Without effects the first case is the main test, and the second one has a
    tenth of the significance.
    """
    level = share if chosen else share / 10
    beyond = judged.heldout < level and heldout > MARGIN * floor
    return (judged.p_value < share and heldout > floor) or beyond


def why_not_shown(kind, limits, units):
    """Return the reason, text, why these data cannot show an effect of any possible size, or None.

    `kind` is the kind of effect; `limits` are its detection limits, SI, and `units` the units, both
    by parameter.
    """
    if not limits:
        return "at no size that was tried would held-out parts confirm it for certain"
    name = min(limits, key=limits.get)
    if not limits[name] > kind.limit:
        return None
    return (
        f"these data would show it from {limits[name]:.2g} {units[name]} on, and {kind.limit:g} is "
        "the most possible"
    )
