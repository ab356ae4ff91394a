"""P-values of the parameters that one fit has and another has not, averaged over hypotheses.

A noise hypothesis is one covariance that the noise of the residuals may have.
"""

import numpy as np
from scipy.special import betainc, betaln

from imuloop.estimate.axis_fit import ChiSquare


def log_f_tail(statistic, q, dof):
    """Return the natural log of the upper tail probability of an F distribution.

    The distribution has q and `dof` degrees of freedom. `statistic` is F, a float or an array; the
    result has its shape. The tail is the regularised incomplete beta function ``I_x(a, b)`` with
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


def averaged_log_p(without, with_parameters, q, hypotheses=slice(None)):
    """Return the logarithm of the p-value of the q parameters that only one of two fits has.

    Under each of h noise hypotheses, covariances that the noise may have, the F test gives an exact
    p-value. The p-values are averaged with the probabilities of the hypotheses in the fit with the
    parameters. So an effect that is as smooth as slow noise is not significant if the data cannot
    exclude this noise.

    If other data say how large the noise is (`least_scale` above zero), the average also includes
    the probabilities in the fit without the parameters, because q parameters fit some of the noise,
    too. They get the weight of that fit by Schwarz's criterion ``ln L - q/2 ln n`` of n residuals
    with the likelihood L, but half at most.

    Parameters
    ----------
    without, with_parameters : ChiSquare
        χ² of the fit without and with the parameters, of one fit or of m at once.
    q : int
        Number of parameters.
    hypotheses : ndarray, shape (h,) of bool, optional
        The noise hypotheses to average over; all by default.

    Returns
    -------
    float or ndarray, shape (m,)
        The natural logarithm of the p-value.

    References
    ----------
    G. Schwarz, Ann. Statist. 6 (1978) 461.
    """
    log_sum, fit = np.logaddexp.reduce, with_parameters
    drop = np.maximum(without.chi2 - fit.chi2, 0.0)
    tail = log_f_tail(drop / q / fit.scale, q, fit.dof)[hypotheses]
    log_with, log_without = (f.log_probability[hypotheses] for f in (fit, without))
    log_weight, log_without = log_with - log_sum(log_with), log_without - log_sum(log_without)
    if fit.least_scale > 0:
        # logarithm of the likelihood ratio of the two fits, and the weight of the one without
        gain = log_sum(log_without + (without.loss - fit.loss)[hypotheses])
        log_share = -np.logaddexp(0.0, np.maximum(gain - q / 2 * np.log(without.dof), 0.0))
        log_weight = log_weight + np.log1p(-np.exp(log_share))
        log_weight = np.logaddexp(log_weight, log_without + log_share)
    return log_sum(log_weight + tail)


def log_p_values(pairs, hypotheses=slice(None)):
    """Return the log p-value of the parameters that one of two fits has, a list of float.

    `pairs` is a list of (ChiSquare, ChiSquare): the fit without some parameters and the fit with
    them. The p-value is averaged over the noise hypotheses in the mask `hypotheses`, (h,) of bool;
    all by default.
    """
    # by degrees of freedom of both fits, the indices of the pairs
    log_p, groups = [None] * len(pairs), {}
    for k, (without, fit) in enumerate(pairs):
        groups.setdefault((without.dof, fit.dof), []).append(k)
    for (dof_without, dof), indices in groups.items():
        # fits of equal degrees of freedom are tested at once
        without, with_parameters = (_stack([pairs[k][side] for k in indices]) for side in (0, 1))
        q = dof_without - dof
        values = averaged_log_p(without, with_parameters, q, hypotheses).tolist()
        for k, value in zip(indices, values, strict=True):
            log_p[k] = value
    return log_p


def _stack(fits):
    """Return one ChiSquare of m fits of equal degrees of freedom, with arrays (h, m).

    h is the number of noise hypotheses.
    """
    chi2, log_prior = (
        np.stack([getattr(f, name) for f in fits], axis=-1) for name in ("chi2", "log_prior")
    )
    return ChiSquare(chi2, log_prior, fits[0].dof, fits[0].least_scale)
