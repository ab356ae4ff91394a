"""Simulated static records of known coefficients, and what imuloop estimates of one."""

from dataclasses import dataclass, field
from zlib import crc32

import numpy as np

from imuloop.noise.axis import estimate_record
from imuloop.noise.settings import NoiseSettings
from imuloop.simulate import noise as process
from imuloop.simulate.truth import GaussMarkovProcess, Noise, SpectralLine

# Hz
RATE = 10.0
# the axis stands at this level, which no estimator knows
LEVEL = 9.8
SETTINGS = NoiseSettings()
TERMS = "QNBKR"


@dataclass(frozen=True, eq=False)
class Scenario:
    """Processes of a simulated axis, SI."""

    # name in the tables
    label: str
    # coefficients by letter: Q, N, B, K, R
    terms: dict = field(default_factory=dict)
    # pairs (q, tc in s) and (amplitude, frequency in Hz)
    gauss_markov: tuple = ()
    sinusoid: tuple = ()
    # the log rounds to multiples of it
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


def estimate(x, rate):
    """Return imuloop's AxisNoise of one record without gaps."""
    return estimate_record(x, rate, SETTINGS).noise


def by_scenario(one, scenarios, seeds, each, length):
    """Return what `one` makes of each of `seeds` records of each scenario.

    `each` is the `map` of several processes; `one` takes (scenario, seed, length).
    """
    jobs = [(scenario, seed, length) for scenario in scenarios for seed in range(seeds)]
    made = list(each(one, jobs))
    return {s: [m for job, m in zip(jobs, made, strict=True) if job[0] is s] for s in scenarios}
