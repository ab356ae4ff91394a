"""White noise and random walk for a filter that models no other noise."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

# s: from the step of a filter's update to the time over which it follows a bias
SHORTEST, LONGEST = 0.1, 1000.0
RANGE = f"{SHORTEST:g} s to {LONGEST:g} s"
# times at which the bound holds; between two of them it falls short by less than 1e-3
POINTS = 201
# what lies above by such a share of the curve is rounding
ROUNDING = 1e-12


@lru_cache(maxsize=64)
def bounding(noise):
    r"""Return N and K whose Allan variance is nowhere below the Allan variance of an axis.

    .. math::
        N^2/\tau + K^2 \tau/3 \ge \sigma^2(\tau),
        \quad 0.1\,\mathrm{s} \le \tau \le 1000\,\mathrm{s}

    with N and K at least the values of the axis, or their 95 % upper limits. The pair exceeds the
    curve least among all such pairs: the sum of :math:`(N^2/\tau + K^2 \tau/3)/\sigma^2(\tau)` over
    times evenly spaced in :math:`\log\tau` is smallest, a linear program in :math:`N^2, K^2`.

    Quantisation, flicker, Gauss-Markov processes and the ramp are bounded: the ramp is
    deterministic, but a filter has no state for it and sees a bias that moves. Lines are not: they
    average out beyond their period, and a walk as large would take a vibration for a bias.

    Takes an AxisNoise with N and K known, or limited; N and K are in its units.

    References
    ----------
    IEEE Std 952-1997 (R2008), annex C: the Allan variances of white noise and random walk.
    """
    tau = np.geomspace(SHORTEST, LONGEST, POINTS)
    curve = replace(noise, sinusoid=()).allan_variance(tau)
    own = np.array([noise.N.size, noise.K.size])
    units = np.column_stack([1 / tau, tau / 3])
    excess = curve - units @ own**2
    above = excess > ROUNDING * curve
    if not above.any():
        return noise.N.size, noise.K.size
    # loads for a quarter of a second, and white noise and walk alone have no need of it
    from scipy.optimize import linprog

    # rows are scaled by the missing variance and columns by their size: tolerances are absolute
    rows = units[above] / excess[above, None]
    size = np.exp(np.log(rows).mean(axis=0))
    cost = (units / curve[:, None]).sum(axis=0) / size
    added = linprog(cost / cost.max(), -rows / size, -np.ones(len(rows))).x / size
    # from within the solver's tolerance onto the bound
    added /= (rows @ added).min()
    return tuple(np.where(added > 0, np.sqrt(own**2 + added), own).tolist())
