"""The verdict on a residual: consistent, explained, partly explained or unexplained."""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, softmax

from imuloop.estimate.held_out import exceedance_probability
from imuloop.estimate.least_squares import chi_square

# ratio of held-out error to floor that an error of the floor itself can explain
MARGIN = 1.25
# verdicts after a test, from the best to the worst
TESTED = ("consistent", "explained", "partly_explained", "unexplained")
# verdicts after which a missing effect may still be found
LEFT = ("unexplained", "partly_explained")


def not_testable(why):
    """Return the fields of diagnosis.json for data that cannot be tested, a dict.

    They are the verdict ``not_testable``, the reason `why`, one line of text, and fields without
    content for the residuals and effects.
    """
    lists = ("effects", "candidates", "confounded")
    return {"verdict": "not_testable", "why": why, "residuals": {}} | {name: [] for name in lists}


@dataclass(frozen=True)
class ResidualGroup:
    """n residuals whose noise is independent of the noise of all other groups.

    The noise has one of m covariances, the alternatives.
    """

    values: np.ndarray  # (n,): residuals of a fit, SI
    errors: np.ndarray  # (n, 1): held-out errors; nan for a residual that was not predicted
    jacobian: np.ndarray  # (n, p): derivative with respect to the parameters of the fit
    # m arrays, (n, n): covariance of the residuals by each alternative; the first is the noise as
    # estimated
    covariances: list
    # m arrays, (n, n): covariance of the held-out errors by each alternative
    error_covariances: list
    kinds: list  # for each kind of residual, such as rotation, a mask of its residuals, (n,)


@dataclass(frozen=True)
class NoiseComparison:
    """The residuals of one kind, compared with those that the noise alone would give."""

    # the first two are averaged over the alternatives of the noise
    p_value: float  # probability that the noise gives so large a χ² of the fit
    heldout_p_value: float  # probability that the noise gives so large held-out errors
    p_value_as_estimated: float  # the same as `p_value`, but for the noise as estimated alone
    reduced_chi2: float  # reduced χ² of the fit with the noise as estimated


def compare_with_noise(groups, log_prior, fitted=0):
    """Return the comparison of residuals with the residuals that the noise alone would give.

    Parameters
    ----------
    groups : list of ResidualGroup
        The residuals, with m alternatives of their noise: covariances that it may have.
    log_prior : sequence of float
        Logarithm of the prior probability of each of the m alternatives.
    fitted : int
        Number of fitted parameters that are not columns of a Jacobian. This number is subtracted
        from the degrees of freedom of every kind.

    Returns
    -------
    ndarray, shape (m,)
        Posterior probability of each alternative.
    list of NoiseComparison
        The comparison for each kind of residual.
    """
    # by alternative: χ² and degrees of freedom of each kind, p-value of its held-out errors, and
    # the logarithm of prior times likelihood of all residuals
    chi2, heldout_p_values, log_weights = [], [], []
    for m, prior in enumerate(log_prior):
        fits = [chi_square(g.values, g.covariances[m], g.jacobian, g.kinds) for g in groups]
        chi2.append(np.sum([by_kind for by_kind, _ in fits], axis=0) - [0, fitted])
        log_weights.append(prior + sum(likelihood for _, likelihood in fits))
        of_kinds = range(len(groups[0].kinds))
        heldout_p_values.append([heldout_p_value(groups, m, k) for k in of_kinds])
    weights, comparisons = softmax(log_weights), []
    for fits, heldout in zip(np.swapaxes(chi2, 0, 1), np.transpose(heldout_p_values), strict=True):
        p_values = [float(chdtrc(dof, square)) for square, dof in fits]
        # the first alternative is the noise as estimated
        square, dof = fits[0]
        comparison = NoiseComparison(
            p_value=float(weights @ p_values),
            heldout_p_value=float(weights @ heldout),
            p_value_as_estimated=p_values[0],
            reduced_chi2=float(square / dof),
        )
        comparisons.append(comparison)
    return weights, comparisons


def heldout_p_value(groups, m, k):
    """Return the probability that noise alone gives larger held-out errors than measured, a float.

    Compared is the sum of squared errors over all residuals of kind number `k`. `groups` are
    ResidualGroups, which hold the measured errors and their possible covariances. The noise is
    taken to have the covariance number `m`.
    """
    square, blocks = 0.0, []
    for group in groups:
        rows = group.kinds[k] & np.isfinite(group.errors[:, 0])
        square += (group.errors[rows] ** 2).sum()
        blocks.append(group.error_covariances[m][np.ix_(rows, rows)])
    return exceedance_probability(square, blocks)


def verdict(above_before, above_after, effects):
    """Return the verdict on a residual, one of `TESTED`.

    `above_before` and `above_after`, bool, say whether the residual is larger than the noise
    explains: before and after effects were added to the model. `effects`, bool, says whether any
    effect was added. Without effects the verdict is ``consistent`` or ``unexplained``, with effects
    ``explained`` or ``partly_explained``.
    """
    if not effects:
        return "unexplained" if above_before else "consistent"
    return "partly_explained" if above_after else "explained"


def calibration_verdict(records, static):
    """Return the worst verdict of the records that a sensor's calibration comes from, one word.

    Poses and the comparison to a reference always count. The static record counts if there is a
    static session. Any other record, such as motion, counts if it added an effect. The result is
    ``not_testable`` if no record was tested.

    Parameters
    ----------
    records : dict of str to dict
        For each kind of record of the sensor, its part of diagnosis.json.
    static : bool
        Whether there is a static session.
    """
    always_counted = ("poses", "reference", *["static_record"] * static)
    verdicts = [
        content["verdict"]
        for kind, content in records.items()
        if kind in always_counted or content["effects"]
    ]
    return max((v for v in verdicts if v in TESTED), key=TESTED.index, default="not_testable")


def may_lack_effect(content):
    """Return whether the model of a record may lack an effect, a bool.

    `content` is the part of diagnosis.json on this record, a dict. The model may lack an effect in
    two cases. In the first, the verdict is ``unexplained`` or ``partly_explained``. In the second,
    the residuals need more slow noise than was estimated (``slow_noise``): a missing effect can
    look like slow noise.
    """
    return content["verdict"] in LEFT or content.get("slow_noise", False)


def above_floor(comparison, significance, heldout, floor, has_effects):
    """Return whether a residual is larger than the noise explains, a bool.

    The floor is the held-out error that the noise alone gives. A residual is too large in two
    cases:

    - The p-value of χ² of the fit is below `significance`, and the held-out error is above its
      floor.
    - The held-out error is above its floor by more than the factor `MARGIN`, and the p-value of
      this error is below the significance. χ² does not matter here: even a wrong effect fits the
      data by which it was chosen.

    Parameters
    ----------
    comparison : NoiseComparison
        The p-values of the residual by the noise alone.
    significance : float
        Largest p-value that counts as too large a residual.
    heldout, floor : float
        Root mean square of the held-out error, and of the one that the noise alone predicts, SI.
    has_effects : bool
        Whether the model has effects, which the data chose. Without effects the first case is the
        main test, so the second one has a tenth of the significance.
    """
    level = significance if has_effects else significance / 10
    far_above = comparison.heldout_p_value < level and heldout > MARGIN * floor
    return (comparison.p_value < significance and heldout > floor) or far_above


def why_not_shown(kind, limits, units):
    """Return the reason for which not even the largest possible effect would show, text, or None.

    The reason is that the detection limit of every parameter is above the largest possible size, or
    that no limit exists. The result is None if some parameter could show. `kind` is the kind of
    effect, whose `limit` is the largest possible size. `limits` are the least sizes that the data
    would show, SI, and `units` their units, both dicts by parameter. `limits` is empty if the data
    would show no size that was tried.
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
