"""P-values of the parameters that one fit has and another has not, averaged over hypotheses."""

from dataclasses import replace

import numpy as np
from scipy.special import betainc, betaln


def log_f_tail(statistic, q, dof):
    """Return the log of the upper tail probability of F with q and `dof` degrees of freedom.

    `statistic` is F. The tail is the regularised incomplete beta function ``I_x(a, b)`` with
    ``x = dof/(dof + q F)``, ``a = dof/2`` and ``b = q/2``. Tails below the range of floating point
    numbers are its leading term, ``x^a (1-x)^(b-1) / (a B(a, b))``.
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
    """Return the logarithm of the p-value of the q parameters that only one of two fits has.

    Under each noise hypothesis the F test gives an exact p-value. The p-values are averaged with
    the probabilities of the hypotheses in the fit with the parameters. So a pattern that is as
    smooth as slow noise is not significant if the data cannot exclude this noise.

    If other data say how large the noise is (`Fit.least` above zero), the average also includes
    the probabilities in the fit without the parameters. They get the weight of that fit by
    Schwarz's criterion ``ln L - q/2 ln n``, half at most: q parameters fit some of the noise, too.

    Parameters
    ----------
    without, fit : Fit
        The `training_fit.Fit` without and with the parameters, of one fit or of m at once.
    q : int
        Number of parameters.
    hypotheses : ndarray, shape (h,) of bool, optional
        The noise hypotheses to average over; all by default.

    Returns
    -------
    float or ndarray, shape (m,)

    References
    ----------
    G. Schwarz, Ann. Statist. 6 (1978) 461.
    """
    drop = np.maximum(without.square - fit.square, 0.0)
    tail = log_f_tail(drop / q / fit.scale, q, fit.dof)[hypotheses]
    total = np.logaddexp.reduce
    weight = fit.log_weight[hypotheses] - total(fit.log_weight[hypotheses])
    if fit.least > 0:
        plain = without.log_weight[hypotheses] - total(without.log_weight[hypotheses])
        gain = total(plain + (without.loss - fit.loss)[hypotheses])
        share = -np.logaddexp(0.0, np.maximum(gain - q / 2 * np.log(without.dof), 0.0))
        weight = np.logaddexp(weight + np.log1p(-np.exp(share)), plain + share)
    return total(weight + tail)


def log_p_values(pairs, hypotheses=slice(None)):
    """Return the log p of each pair of Fits, a list of float, as `averaged_log_p`.

    A pair has the Fit without and the Fit with some parameters.
    """
    log_p, groups = [None] * len(pairs), {}
    for k, (without, fit) in enumerate(pairs):
        groups.setdefault((without.dof, fit.dof), []).append(k)
    for (more, dof), indices in groups.items():
        fits = [_combine([pairs[k][side] for k in indices]) for side in (0, 1)]
        values = averaged_log_p(*fits, more - dof, hypotheses).tolist()
        for k, value in zip(indices, values, strict=True):
            log_p[k] = value
    return log_p


def _combine(fits):
    """Return one Fit that has `square` and `log_weight`, (h, m), of m fits of equal `dof`."""
    square, log_weight = (
        np.stack([getattr(fit, name) for fit in fits], axis=-1) for name in ("square", "log_weight")
    )
    return replace(fits[0], square=square, log_weight=log_weight)
