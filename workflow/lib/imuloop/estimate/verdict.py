"""The verdict on a residual: consistent, explained, partly explained or unexplained."""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, softmax

from imuloop.estimate.least_squares import chi_square
from imuloop.estimate.residuals import chance, held_out_covariance

# held-out error over its floor up to which the floor itself may be wrong
MARGIN = 1.25
# verdicts of what was tested, from the best news to the worst
TESTED = ("consistent", "explained", "partly_explained", "unexplained")
# kinds of residuals of a device, which share the significance: gravity norm, pose rate, rotation,
# two of velocity, and of each sensor the bias at rest and what a reference shows
RESIDUALS = 9
# verdicts that leave something to look for
LEFT = ("unexplained", "partly_explained")


def not_testable(why):
    """Return the contract's fields where nothing could be tested, with the reason, text."""
    lists = ("effects", "candidates", "confounded")
    return {"verdict": "not_testable", "why": why, "residuals": {}} | {name: [] for name in lists}


@dataclass(frozen=True)
class Judged:
    """The residual of a fit, compared with alternatives of the noise."""

    p_value: float  # probability that the noise leaves as much
    heldout: float  # probability that the noise gives as large errors of what is held out
    estimated: float  # as `p_value`, by the noise as estimated, the first alternative
    reduced_chi2: float  # by the noise as estimated


def judge(alternatives, squares, fitted=0, predicted=True):
    """Return the probability of each alternative of the noise, and the Judged of each kind.

    Of an alternative it takes the logarithm of its probability beforehand, and of independent
    groups of rows values, covariance, derivative, parts and the rows of each kind, as of
    `chi_square` and `held_out_covariance`; further the sum of the squares of the held-out errors of
    each kind, how many parameters beside those of the derivative were fitted, and, of one group,
    which rows have held-out errors, (n,) of bool.
    """

    def of_predicted(covariance, rows):
        return covariance[np.ix_(rows & predicted, rows & predicted)]

    found, heldout, logs = [], [], []
    for prior, groups in alternatives:
        each = [chi_square(values, c, jacobian, kinds) for values, c, jacobian, _, kinds in groups]
        found.append(np.sum([left for left, _ in each], axis=0) - [0, fitted])
        logs.append(prior + sum(likelihood for _, likelihood in each))
        spreads = [(held_out_covariance(*g[1:4]), g[4]) for g in groups]
        heldout.append(
            [
                chance(square, [of_predicted(spread, rows[k]) for spread, rows in spreads])
                for k, square in enumerate(squares)
            ]
        )
    weights, judged = softmax(logs), []
    for left, by_chance in zip(np.swapaxes(found, 0, 1), np.transpose(heldout), strict=True):
        p_values = [float(chdtrc(dof, square)) for square, dof in left]
        square, dof = left[0]
        averaged = float(weights @ p_values), float(weights @ by_chance)
        judged.append(Judged(*averaged, p_values[0], float(square / dof)))
    return weights, judged


def verdict(above_before, above_after, effects):
    """Return the verdict, a word of the contract, on a residual.

    By whether it is above its floor without and with the effects that were added, bool each.
    """
    if not effects:
        return "unexplained" if above_before else "consistent"
    return "partly_explained" if above_after else "explained"


def of_calibration(records, static):
    """Return the worst verdict of the records that a sensor's parameters and effects come from.

    Poses and what a reference shows are; a static record where a `static` session was recorded for
    it; others, as motion, where they added an effect.
    """
    kinds = ("poses", "reference", *["static_record"] * static)
    own = [c["verdict"] for kind, c in records.items() if kind in kinds or c["effects"]]
    return max((v for v in own if v in TESTED), key=TESTED.index, default="not_testable")


def leaves(content):
    """Return whether a verdict leaves something to look for.

    Where all is explained by more slow noise than was estimated, a pattern may pass for noise.
    """
    return content["verdict"] in LEFT or content.get("slow_noise", False)


def above_floor(judged, share, heldout, floor, chosen):
    """Return whether a residual is larger than the noise explains.

    It is where the fit leaves more than noise and the error of held-out data is above its floor
    too; and where that error is above it by more than a quarter and by more than noise makes it,
    however well the fit went: a model with a wrong effect fits what it was chosen by. Without
    effects, the fit itself has had its test, and a tenth of the significance is left for this one.

    `share` is the significance, `floor` what the noise alone predicts for the held-out error,
    `chosen` whether there are effects, which the data chose.
    """
    own = share if chosen else share / 10
    beyond = judged.heldout < own and heldout > MARGIN * floor
    return (judged.p_value < share and heldout > floor) or beyond


def why_not_shown(kind, limits, units):
    """Return why these data cannot show an effect at all, text, or None.

    By its kind, its detection limits by parameter, SI, and the units of the parameters.
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
