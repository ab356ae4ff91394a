"""White noise and random walk for a filter that models no other noise."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

# averaging times of the bound, s: from a filter's update step to the time in which it tracks a bias
SHORTEST, LONGEST = 0.1, 1000.0
RANGE = f"{SHORTEST:g} s to {LONGEST:g} s"
# number of times at which the bound holds; between them the sum may be too small by up to 1e-3
POINTS = 201
# an excess below this share of the curve is rounding
ROUNDING = 1e-12


@lru_cache(maxsize=64)
def bounding(noise):
    r"""Return N and K whose Allan variance is at no time below the Allan variance of an axis.

    .. math::
        N^2/\tau + K^2 \tau/3 \ge \sigma^2(\tau),
        \quad 0.1\,\mathrm{s} \le \tau \le 1000\,\mathrm{s}

    τ is the averaging time. A filter with these N (white noise) and K (random walk) never assumes
    too little noise. `noise` is an AxisNoise whose N and K have a value or a 95 % upper limit;
    σ²(τ) is its Allan variance without lines. The returned N and K, in the same units, are not
    below the N and K of `noise`. Among all such pairs, the returned pair exceeds σ²(τ) least: the
    sum of :math:`(N^2/\tau + K^2 \tau/3)/\sigma^2(\tau)` over times evenly spaced in
    :math:`\log\tau` is smallest. This is a linear program in :math:`N^2, K^2`.

    Quantisation, flicker, Gauss-Markov processes and the ramp are bounded: the ramp is
    deterministic, but a filter has no state for it and sees a bias that moves. Lines (periodic
    disturbances) are not bounded: they average out beyond their period, and a random walk that
    bounds them would make a filter take vibration for a bias.

    References
    ----------
    IEEE Std 952-1997 (R2008), annex C: the Allan variances of white noise and random walk.
    """
    tau = np.geomspace(SHORTEST, LONGEST, POINTS)
    curve = replace(noise, sinusoid=()).allan_variance(tau)
    coefficients = np.array([noise.N.size, noise.K.size])
    units = np.column_stack([1 / tau, tau / 3])
    excess = curve - units @ coefficients**2
    above = excess > ROUNDING * curve
    if not above.any():
        return noise.N.size, noise.K.size
    # imported here, since loading takes a quarter of a second and only this function needs it
    from scipy.optimize import linprog

    # the solver's tolerances are absolute: scale rows by the missing variance, columns by size
    rows = units[above] / excess[above, None]
    size = np.exp(np.log(rows).mean(axis=0))
    cost = (units / curve[:, None]).sum(axis=0) / size
    added = linprog(cost / cost.max(), -rows / size, -np.ones(len(rows))).x / size
    # the solution may violate the bound within the solver's tolerance: scale it onto the bound
    added /= (rows @ added).min()
    return tuple(np.where(added > 0, np.sqrt(coefficients**2 + added), coefficients).tolist())
