"""Detection limit of a Gauss–Markov process: what is found with 90 %."""

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtri

from imuloop.noise.likelihood import weighted_nnls
from imuloop.noise.processes import densities, gauss_markov_density
from imuloop.noise.settings import NoiseSettings

# chance of finding what lies at one limit
PROBABILITY = 0.9
# correlation times that count as tried independently of each other
TIMES = 10
# chance of a process in noise that has none
LEVEL = NoiseSettings().significance


def gauss_markov_limit(theta, tc, length, rate, level=LEVEL):
    r"""Return the density q of a Gauss-Markov process that is found with 90 %.

    The likelihood gains what the spectrum s with the process has over the nearest one s' that Q,
    N, B and K can make without it, :math:`g = \tfrac12 \sum_k (s_k/s'_k - 1 - \ln s_k/s'_k)` at
    :math:`f_k = k/2T`, and the process is found with probability P at the level a where
    :math:`\sqrt{2 g} = z_{1 - a} + z_P`.
    """
    k = np.unique(np.rint(np.geomspace(1, length - 1, 600)))
    count, f = np.gradient(k), k * rate / (2 * length)
    units = densities(f, 1 / rate)
    shape = gauss_markov_density(f, 1 / rate, tc) * tc / 2
    aim = ndtri(PROBABILITY) - ndtri(level / TIMES)

    def excess(log_q):
        there = without = units @ theta + np.exp(2 * log_q) * shape
        for _ in range(30):
            without = units @ weighted_nnls(units, there, count / without**2)
        ratio = there / without
        return np.sqrt(max(count @ (ratio - 1 - np.log(ratio)), 0)) - aim

    return float(np.exp(brentq(excess, np.log(1e-8), np.log(1e2), xtol=1e-3)))
