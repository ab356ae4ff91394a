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
    axes = [a for a, c in enumerate(pattern.columns) if c and search.fit((*base, pattern), a)]
    for q in {len(pattern.columns[a]) for a in axes}:
        own_axes = [a for a in axes if len(pattern.columns[a]) == q]
        sizes = _sizes(search, base, pattern, own_axes, q, power, own)
        for axis, found in zip(own_axes, sizes.tolist(), strict=True):
            limits |= zip((names[p] for p in pattern.parameters[axis]), found, strict=True)
    return {name: limits[name] for name in names if name in limits}


def _sizes(search, base, pattern, axes, q, power, threshold):
    """Return the sizes of the q parameters of some axes, shape (axes, q)."""
    fits = [search.fit((*base, pattern), axis) for axis in axes]
    likely = np.array([fit.log_weight - log_sum(fit.log_weight) for fit in fits])
    # what is next to impossible says nothing
    likely = np.where(likely > np.log(1e-12), likely, -np.inf)
    scale = np.array([search.sight.model.scale(pattern, axis) for axis in axes])
    information = np.linalg.inv(np.array([fit.covariance[:, -q:, -q:] for fit in fits]))
    # (points of the grid, axes times parameters)
    inform = (np.einsum("agqq->gaq", information) * scale**2).reshape(len(likely[0]), -1)
    likely = np.repeat(likely.T, q, axis=1)

    def excess(log_size):
        statistic = noncentral_quantile(1 - power, q, np.exp(2 * log_size) * inform) / q
        tail = likely + log_f_tail(statistic, q, fits[0].dof)
        top = tail.max(axis=0)
        return top + np.log(np.exp(tail - top).sum(axis=0)) - threshold

    start = -0.5 * np.log(np.where(np.isfinite(likely), inform, 0.0).max(axis=0))
    return np.exp(root(excess, start - 5, start + 25)).reshape(len(axes), q)


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
