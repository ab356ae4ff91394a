"""Detection limits in static records: what would have been found with the wanted power."""

import numpy as np
from scipy.special import ndtri

from imuloop.core.root import root
from imuloop.diagnose.static_noise import log_f_tail, log_sum
from imuloop.diagnose.static_search import fisher

# logarithm of the p-value in the middle of chance, for the axes that show nothing
CHANCE = np.log(0.5)


def detection_limits(search, base, trial, power):
    """Return the smallest size of each parameter of a trial that these records would have shown.

    A parameter of size s that alone is not zero gives the F test at each point of the grid the
    noncentrality ``s² I``, I its information there. Its statistic is taken at the quantile that
    the wanted power leaves below, and the p-values are averaged as in the test.

    Parameters
    ----------
    search : StaticSearch
        The search.
    base : tuple of Pattern
        The effects beside it.
    trial : StaticTrial
        The candidate's trial beside `base`.
    power : float
        Probability of finding the effect.

    Returns
    -------
    dict of str to float
        By parameter; parameters that no axis shows are left out.
    """
    pattern, limits = trial.pattern, {}
    names = list(pattern.effect.parameters)
    needed = search.threshold(len(base)) - trial.tries
    own = root(lambda p: fisher([p] + [CHANCE] * (trial.axes - 1)) - needed, -1e4, 0.0)[0]
    for axis, columns in enumerate(pattern.columns):
        fit = search.fit((*base, pattern), axis) if columns else None
        if fit is None:
            continue
        q = len(columns)
        likely = fit.log_weight - log_sum(fit.log_weight)
        kept = likely > np.log(1e-12)
        information = np.linalg.inv(fit.covariance[kept][:, -q:, -q:])
        scale = search.sight.model.scale(pattern, axis)
        # (points of the grid, parameters)
        inform = np.einsum("gqq->gq", information) * scale**2

        def excess(log_size, inform=inform, q=q, dof=fit.dof, likely=likely[kept, None]):
            statistic = noncentral_quantile(1 - power, q, np.exp(2 * log_size) * inform) / q
            tail = likely + log_f_tail(statistic, q, dof)
            top = tail.max(axis=0)
            return top + np.log(np.exp(tail - top).sum(axis=0)) - own

        start = -0.5 * np.log(inform.max(axis=0))
        sizes = np.exp(root(excess, start - 5, start + 25))
        for parameter, size in zip(pattern.parameters[axis], sizes.tolist(), strict=True):
            limits[names[parameter]] = size
    return {name: limits[name] for name in names if name in limits}


def noncentral_quantile(probability, q, noncentrality):
    """Return the quantile of noncentral χ² with q degrees of freedom.

    References
    ----------
    M. Sankaran, Biometrika 46 (1959) 235: a power h of the ratio to the mean is nearly normal.
    """
    n = np.asarray(noncentrality, dtype=float)
    h = 1 - 2 / 3 * (q + n) * (q + 3 * n) / (q + 2 * n) ** 2
    p = (q + 2 * n) / (q + n) ** 2
    m = (h - 1) * (1 - 3 * h)
    centre = 1 + h * p * (h - 1 - 0.5 * (2 - h) * m * p)
    spread = h * np.sqrt(2 * p) * (1 + 0.5 * m * p)
    return (q + n) * np.maximum(centre + spread * ndtri(probability), 0.0) ** (1 / h)
