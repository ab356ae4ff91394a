"""P-values of the additional parameters of a fit, averaged over the noise hypotheses."""

from dataclasses import replace

import numpy as np
from scipy.special import betainc, betaln


def log_f_tail(statistic, q, dof):
    """Return the logarithm of the upper tail of F with q and `dof` degrees of freedom.

    ``I_x(dof/2, q/2)`` at ``x = dof/(dof + q F)``; below the smallest double its leading term
    ``x^a (1-x)^(b-1) / (a B(a, b))``.
    """
    a, b = dof / 2, q / 2
    x = dof / (dof + q * np.asarray(statistic, dtype=float))
    tail = betainc(a, b, x)
    if np.all(tail > 1e-280):
        return np.log(tail)
    safe = np.minimum(x, 1 - 1e-16)
    leading = a * np.log(safe) + (b - 1) * np.log1p(-safe) - np.log(a) - betaln(a, b)
    with np.errstate(divide="ignore"):
        return np.where(tail > 1e-280, np.log(tail), leading)


def averaged_log_p(without, fit, q, hypotheses=slice(None)):
    """Return the logarithm of the p-value of q parameters that one fit has beyond another.

    Under each hypothesis the F test is exact. What the noise is, the fit with the parameters
    tells: the p-values are averaged with its restricted likelihood as weight. So a pattern as
    smooth as slow noise that the data cannot exclude gains nothing from being smooth. Where data
    beside these tell how large the noise is, the fit without the parameters has the weight of its
    probability, half at most, by Schwarz (Ann. Stat. 6, 1978, 461), ``ln L - q/2 ln n`` under each
    hypothesis: a pattern of many parameters takes up noise, but what is many times it is none.

    Of m records at once, shape (m,), from fits with squares and weights of shape (h, m). With
    `hypotheses`, a mask, by some about the noise alone.
    """
    drop = np.maximum(without.square - fit.square, 0.0)
    tail = log_f_tail(drop / q / fit.scale, q, fit.dof)[hypotheses]
    total = np.logaddexp.reduce
    weight = fit.log_weight[hypotheses] - total(fit.log_weight[hypotheses])
    if fit.least > 0:
        known = without.log_weight[hypotheses] - total(without.log_weight[hypotheses])
        gain = total(known + (without.spent - fit.spent)[hypotheses])
        share = -np.logaddexp(0.0, np.maximum(gain - q / 2 * np.log(without.dof), 0.0))
        weight = np.logaddexp(weight + np.log1p(-np.exp(share)), known + share)
    return total(weight + tail)


def log_p_values(pairs, hypotheses=slice(None)):
    """Return `averaged_log_p` of the parameters that of each pair of Fits the second has more."""
    found, alike = [None] * len(pairs), {}
    for k, (without, fit) in enumerate(pairs):
        alike.setdefault((without.dof, fit.dof), []).append(k)
    for (more, dof), at in alike.items():
        each = [_together([pairs[k][side] for k in at]) for side in (0, 1)]
        log_p = averaged_log_p(*each, more - dof, hypotheses).tolist()
        for k, own in zip(at, log_p, strict=True):
            found[k] = own
    return found


def _together(fits):
    """Return what tests need of m fits of as many parameters as one, its records those of all."""
    square, log_weight = (
        np.stack([getattr(fit, name) for fit in fits], axis=-1) for name in ("square", "log_weight")
    )
    return replace(fits[0], square=square, log_weight=log_weight)
