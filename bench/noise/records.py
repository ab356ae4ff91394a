"""Simulated static records of known coefficients."""

from dataclasses import dataclass, field
from zlib import crc32

import numpy as np

from imuloop.simulate import noise as process
from imuloop.simulate.truth import GaussMarkovProcess, Noise, SpectralLine

# Hz
RATE = 10.0
# the axis stands at this level, which no estimator is told
LEVEL = 9.8


@dataclass(frozen=True, eq=False)
class Scenario:
    """Processes of a simulated axis.

    Attributes
    ----------
    label : str
        Name in the tables.
    terms : dict of str to float
        Coefficients by letter: Q, N, B, K, R, SI.
    gauss_markov, sinusoid : tuple of pairs of float
        (q, tc in s) and (amplitude, frequency in Hz).
    step : float
        The log rounds to multiples of it, SI; 0 does not.
    """

    label: str
    terms: dict = field(default_factory=dict)
    gauss_markov: tuple = ()
    sinusoid: tuple = ()
    step: float = 0.0


def record(scenario, n, rate, seed):
    """Return `n` samples at `rate` Hz; a seed gives every scenario another record."""
    noise = Noise(
        **{name: (value,) * 3 for name, value in scenario.terms.items()},
        gauss_markov=tuple(GaussMarkovProcess((q,) * 3, tc) for q, tc in scenario.gauss_markov),
        sinusoid=tuple(SpectralLine((a,) * 3, f) for a, f in scenario.sinusoid),
    )
    entropy = np.random.SeedSequence((seed, crc32(scenario.label.encode())))
    x = LEVEL + process.axis_noise(n, 1 / rate, noise, 0, entropy)
    return np.rint(x / scenario.step) * scenario.step if scenario.step else x
