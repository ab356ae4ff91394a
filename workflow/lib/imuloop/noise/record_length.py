"""How long a record would have to be to show a term."""

from bisect import bisect_left

import numpy as np
from scipy.special import ndtri

from imuloop.noise.likelihood import Likelihood
from imuloop.noise.processes import NAMES, densities, density

# chance with which the term would be found
POWER = 0.9
# bins per decade, and the longest record worth naming: a year, s
BINS, LONGEST = 12, 3.2e7


def record_seconds(name, value, squares, dt, level):
    r"""Return the seconds of an unbroken record in which a term would be found nine times in ten.

    The record's expected spectrum with the term is fitted without it. The root of twice the loss
    of log-likelihood is normal about its expectation, so that it has to reach
    :math:`z_{1-\alpha} + z_{0.9}`.

    Takes name and size, SI, of the term (Q, N, B, K or R), the variances of the others as `density`
    does, the interval of the samples, s, and the level of the test. Gives the length to a tenth;
    None where no record that can be made would show it.
    """
    wanted = ndtri(POWER) - ndtri(level / 2 if name == "R" else level)
    others = {term: square for term, square in squares.items() if term != name}

    def shown(seconds):
        return _expected_root(name, value, others, dt, seconds / dt) >= wanted

    lengths = 100 * dt * 1.1 ** np.arange(np.log(LONGEST / (100 * dt)) / np.log(1.1))
    shortest = bisect_left(lengths, True, key=shown)
    return float(lengths[shortest]) if shortest < len(lengths) else None


def _expected_root(name, value, others, dt, n):
    """Return the root of twice the expected loss of log-likelihood in a record of n samples."""
    edges = np.unique(np.rint(np.geomspace(1, n, int(BINS * np.log10(n)))).astype(np.int64))
    count = np.diff(edges).astype(float)
    k = np.sqrt(edges[:-1] * (edges[1:] - 1.0))
    frequency = k / (2 * n * dt)
    spectrum = density(frequency, dt, others) / dt
    if name == "R":
        # odd modes hold a ramp: |c_k| = 2 dt sqrt(2 n^3) / (pi k)^2; half of all are odd
        square = 8 * dt**2 * n**3 / (np.pi * k) ** 4 * np.where(count > 1, count / 2, k % 2)
        return value * np.sqrt((square / spectrum).sum())
    spectrum = spectrum + density(frequency, dt, {name: value**2}) / dt
    # white noise, flicker and walk stay free, as in the intervals
    free = [t for t in NAMES if t != name and (others.get(t) or t != "Q")]
    processes = {tc: square for tc, square in others.items() if tc not in NAMES}
    units = densities(frequency, dt)[:, [NAMES.index(t) for t in free]] / dt
    likelihood = Likelihood(np.zeros(0), spectrum, count, np.zeros(0))
    start = np.array([others.get(t, 0.0) for t in free])
    fit = likelihood.fit(units, fixed=density(frequency, dt, processes) / dt, start=start)
    return np.sqrt(2 * max(likelihood.value(spectrum, spectrum) - fit.value, 0.0))
