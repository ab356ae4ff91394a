"""The least-squares fit of one axis, the p-values of its parameters, and several axes combined.

A noise hypothesis is one covariance that the noise of the residuals may have.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import betainc, betaln, softmax


@dataclass(frozen=True)
class Fit:
    """Least-squares fits of the residuals on one axis: one fit under each noise hypothesis.

    A noise hypothesis is one of h covariances that the noise of the residuals may have. Each fit
    estimates the coefficients of k columns. A column is the derivative of the residuals with
    respect to one parameter of an effect, scaled to length one.

    An instance can also stand for m models with equal degrees of freedom, which are then tested at
    once. In this case all arrays (h,) have the shape (h, m), and the last three fields are None.
    """

    chi2: np.ndarray  # (h,): χ² of the residuals
    # (h,): log prior of each hypothesis, minus (log |Σ| + log |Jᵀ Σ⁻¹ J|)/2 with the covariance Σ
    # of the residuals and their Jacobian J
    log_prior: np.ndarray
    dof: int  # degrees of freedom
    least_scale: float  # lower limit of `scale`; above 0 if other data say how large the noise is
    # (h, k, k): normal matrix of the columns, after each column was divided by its norm
    normal: np.ndarray | None = None
    norms: np.ndarray | None = None  # (h, k): √(xᵀ Σ⁻¹ x) of each column x
    coefficients: np.ndarray | None = None  # (h, k): coefficients of the columns

    @property
    def scale(self):
        """Estimated factor s on the covariance of each noise hypothesis, (h,).

        A noise hypothesis is one of h covariances that the noise of the residuals may have. The
        factor is the reduced χ² under this hypothesis, or the lower limit `least_scale` if that is
        larger.
        """
        return np.maximum(self.least_scale, self.chi2 / self.dof)

    @property
    def loss(self):
        """The part of minus the log likelihood that depends on the residuals, (h,).

        For each noise hypothesis, a covariance that the noise may have, it is
        ``(dof log s + χ²/s)/2``, with dof degrees of freedom and the factor s on the covariance
        (`scale`).
        """
        return (self.dof * np.log(self.scale) + self.chi2 / self.scale) / 2

    @property
    def log_probability(self):
        """Logarithm of likelihood times prior of each noise hypothesis, (h,), up to a constant.

        A noise hypothesis is one of h covariances that the noise may have. The likelihood is the
        restricted one: the fitted parameters are integrated out.
        """
        return self.log_prior - self.loss

    @property
    def probability(self):
        """Posterior probability of each noise hypothesis, (h,); the sum is one.

        A noise hypothesis is one of h covariances that the noise may have.
        """
        return softmax(self.log_probability)

    def average(self):
        """Return the coefficients of the k columns, (k,), and their covariance, (k, k).

        A column is the derivative of the residuals with respect to one parameter, scaled to length
        one. Both results are averaged over the noise hypotheses, the covariances that the noise may
        have, with their posterior probabilities as weights. The covariance includes the scatter of
        the coefficients between hypotheses.
        """
        mean = self.probability @ self.coefficients
        deviation = self.coefficients - mean
        # `normal` has columns of length one, so its inverse is scaled back
        inverse = np.linalg.inv(self.normal) / self.norms[:, :, None] / self.norms[:, None]
        squares = inverse * self.scale[:, None, None] + deviation[:, :, None] * deviation[:, None]
        return mean, np.einsum("h,hpq->pq", self.probability, squares)


def scaled_inverse(matrix):
    """Return the inverse, (p, p), of `matrix`, (p, p), which is positive definite.

    The matrix is scaled to ones on its diagonal before it is inverted. Otherwise parameters of
    different units would make it ill-conditioned.
    """
    size = np.sqrt(np.diag(matrix))
    return np.linalg.inv(matrix / np.outer(size, size)) / np.outer(size, size)


def combine_axes(count, estimates):
    """Return p parameters and their covariance, averaged over the axes that estimate them.

    Each axis a has estimates θ_a of some of the parameters, with the covariance C_a. Parameters
    that several axes estimate are averaged with the weights C_a⁻¹: ``C = (Σ C_a⁻¹)⁻¹`` and
    ``θ = C Σ C_a⁻¹ θ_a``. Parameters that no axis estimates are zero and have the variance zero.

    Parameters
    ----------
    count : int
        The number p of parameters.
    estimates : list of (index, ndarray, ndarray)
        For each axis the indices of its parameters, their values θ_a and their covariance C_a.

    Returns
    -------
    ndarray, shape (p,), and ndarray, shape (p, p)
        The values θ and their covariance C.
    """
    values, covariance = np.zeros(count), np.zeros((count, count))
    for index, axis_values, axis_covariance in estimates:
        values[index], covariance[np.ix_(index, index)] = axis_values, axis_covariance
    # if no parameter is estimated twice, nothing has to be averaged
    indices = np.concatenate([np.zeros(0, int), *(index for index, _, _ in estimates)])
    # an axis that never changes has estimates of variance zero, which cannot be averaged
    estimates = [e for e in estimates if np.all(np.diag(e[2]) > 0)]
    if len(np.unique(indices)) == len(indices) or not estimates:
        return values, covariance
    precision, moment = np.zeros((count, count)), np.zeros(count)
    for index, axis_values, axis_covariance in estimates:
        inverse = scaled_inverse(axis_covariance)
        precision[np.ix_(index, index)] += inverse
        moment[index] += inverse @ axis_values
    index = np.flatnonzero(np.diag(precision))
    block = np.ix_(index, index)
    covariance[block] = scaled_inverse(precision[block])
    values[index] = covariance[block] @ moment[index]
    return values, covariance


def log_f_tail(statistic, q, dof):
    """Return the natural log of the p-value of an F statistic, its upper tail probability.

    `statistic` is F, a float or an array; the result has its shape. By chance alone F has an F
    distribution with `q` and `dof` degrees of freedom. The p-value is ``I_x(a, b)``, the
    regularised incomplete beta function, with ``x = dof/(dof + q F)``, ``a = dof/2`` and
    ``b = q/2``. A p-value that is too small for a floating point number is replaced by the leading
    term of this function, ``x^a (1-x)^(b-1) / (a B(a, b))``.
    """
    a, b = dof / 2, q / 2
    x = dof / (dof + q * np.asarray(statistic, dtype=float))
    tail = betainc(a, b, x)
    if np.all(tail > 1e-280):
        return np.log(tail)
    # this keeps log(1 - x) finite at x = 1
    safe = np.minimum(x, 1 - 1e-16)
    leading = a * np.log(safe) + (b - 1) * np.log1p(-safe) - np.log(a) - betaln(a, b)
    with np.errstate(divide="ignore"):
        return np.where(tail > 1e-280, np.log(tail), leading)


def averaged_log_p(without, with_parameters, q, hypotheses=slice(None)):
    """Return the log p-value of q parameters, from a fit without them and a fit with them.

    Under each of h noise hypotheses, covariances that the noise may have, the F test of the two
    fits gives an exact p-value. The result is the average of these p-values. Each weight is the
    probability of the hypothesis in the fit with the parameters. So an effect that changes as
    slowly as slow noise is not significant unless the data exclude this noise.

    If other data say how large the noise is (`least_scale` above zero), the weights are a mixture
    of these probabilities and the probabilities in the fit without the parameters. The latter count
    because q parameters also fit some of the noise. Their share in the mixture is
    ``1/(1 + max(1, B))``. By Schwarz's criterion, B is ``n^(-q/2)`` times the ratio of likelihoods,
    with the parameters over without them; n are the degrees of freedom of the fit without them. So
    the share is one half if the data do not need the parameters, and near zero if they clearly do.

    Parameters
    ----------
    without, with_parameters : Fit
        The fit without and the fit with the parameters. Each may be one fit, or stand for m fits.
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
    """Return the log p-values of several F tests, a list with one float for each pair of fits.

    `pairs` is a list of (Fit, Fit). Each pair tests some parameters: the first fit lacks them, the
    second has them. The p-value is averaged over those of h noise hypotheses, covariances that the
    noise may have, that the mask `hypotheses`, (h,) of bool, selects; all by default.
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
    """Return one Fit that holds m fits with equal degrees of freedom, to test them all at once.

    `fits` is the list of m Fits. The arrays of the result have the shape (h, m): h noise
    hypotheses, covariances that the noise may have, and m fits.
    """
    chi2, log_prior = (
        np.stack([getattr(f, name) for f in fits], axis=-1) for name in ("chi2", "log_prior")
    )
    return Fit(chi2, log_prior, fits[0].dof, fits[0].least_scale)
