"""Frequencies at which a spectrum departs from its model, and smaller weights for them."""

import numpy as np
from scipy.ndimage import convolve1d
from scipy.special import chdtrc, chdtri, polygamma, psi

# groups of rows that are compared with the model: least number of values of a group, and most
# groups per decade
VALUES, GROUPS = 8, 24
# groups over which a misfit keeps its sign and its size: half a decade
TOGETHER = GROUPS // 2


def misfit(selection, terms):
    r"""Return the largest relative misfit of a spectrum, and weights of its rows that allow for it.

    A row is a frequency or a band of frequencies (`Modes`). Neighbouring rows form groups. Let q be
    the measured power of a group over the power that the terms predict, and n the number of its
    values. In noise alone q is a chi-square variable over n, so ln q has the mean :math:`\psi(n/2)
    - \ln(n/2)` and the variance :math:`\psi_1(n/2)`. Over half a decade to each side of a group,
    the mean squared distance of ln q from its expected value exceeds that variance by
    :math:`\epsilon^2`. Where the excess is significant, the groups of half a decade are taken to
    share one relative error of the spectrum, of the size :math:`\epsilon`. So they tell less about
    the terms, and their rows get smaller weights.

    `selection` is the Selection, the likelihood of an axis by its noise terms, and `terms` are the
    terms that it supports.

    Returns
    -------
    size : float
        Largest :math:`\epsilon`; 0 if noise explains the misfit of the whole spectrum.
    weight : ndarray, shape (r,)
        Weight of each row; all 1 if noise explains the misfit of the whole spectrum.
    """
    likelihood, level, fit = selection.likelihood, selection.level, selection.fit(terms)
    expected = likelihood.above_rounding(selection.units(terms) @ fit.theta)
    ratio = likelihood.above_rounding(likelihood.power(fit.ramp)) / expected
    group = _groups(selection.modes.frequency, selection.modes.count)
    n = np.bincount(group, likelihood.count)
    # groups of leakage behind a filter have next to no weight
    used = n > 1
    half = np.where(used, n, 2.0) / 2
    r = np.maximum(np.bincount(group, likelihood.count * ratio) / (2 * half), 1e-12)
    variance = polygamma(1, half)
    square = used * (np.log(r * half) - psi(half)) ** 2
    dof = used.sum() - len(terms)
    if dof < 2 or chdtrc(dof, (square / variance).sum()) >= level:
        return 0.0, np.ones(len(group))

    def around(values):
        """Return, for each of g groups, the sum of values over the groups near it, (g,).

        The groups near it lie within half a decade to each side. `values`, (g,) or a number, has
        the value of each group. A group whose rows have next to no weight counts as 0.
        """
        return convolve1d(used * values, np.ones(2 * TOGETHER + 1), mode="constant")

    near = np.maximum(around(1.0), 1)
    beyond = around(square / variance) > chdtri(near, level / 10)
    excess = np.where(beyond, np.maximum(around(square - variance) / near, 0.0), 0.0)
    return float(np.sqrt(excess.max())), (1 / (1 + TOGETHER * excess * n / 2))[group]


def _groups(frequency, count):
    """Return the group of each of r rows of a spectrum, a number from 0, (r,) of int.

    A row is a frequency or a band of frequencies. A group has neighbouring rows, and group 0 the
    lowest frequencies. `frequency`, (r,), is the frequency of each row, Hz, and `count`, (r,), the
    number of its values. Every group but the last has at least `VALUES` values, and there are at
    most `GROUPS` groups per decade.
    """
    number = np.empty(len(frequency), dtype=int)
    group, values, first = -1, VALUES, 0.0
    for row in np.argsort(frequency, kind="stable"):
        if values >= VALUES and frequency[row] >= first * 10 ** (1 / GROUPS):
            group, values, first = group + 1, 0, frequency[row]
        number[row] = group
        values += count[row]
    return number
