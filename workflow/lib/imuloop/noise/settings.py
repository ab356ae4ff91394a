"""Settings of the noise stage."""

from dataclasses import dataclass


@dataclass(frozen=True)
class NoiseSettings:
    """Settings of the noise stage, for records from a minute to days.

    The schema of the config describes each.
    """

    # averaging times
    points_per_decade: float = 10.0
    # of the longest clean stretch, below one half
    longest_tau_share: float = 1 / 3
    # level at which a coefficient counts as supported by the data
    significance: float = 0.001
    # that of a Gauss-Markov process or a line, which are looked for in many places
    hump_significance: float = 0.001
    # psd, autocorrelation, total, modified, hadamard, and M of M-sample deviations
    views: tuple = ("psd", "autocorrelation")
    m_samples: tuple = ()
