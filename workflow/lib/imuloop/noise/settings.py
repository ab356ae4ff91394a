"""Settings of the noise stage."""

from dataclasses import dataclass


@dataclass(frozen=True)
class NoiseSettings:
    """Settings of the noise stage; the defaults suit records from a minute to days.

    Attributes
    ----------
    points_per_decade : float
        Averaging times per decade, 1.
    longest_tau_share : float
        Longest averaging time as a share of the longest clean stretch, 1; below one half.
    significance : float
        Level at which a coefficient counts as supported by the data, 1.
    hump_significance : float
        Level at which a Gauss-Markov process or a line does, 1; they are looked for in many places.
    views : tuple of str
        Other views of each record: psd, autocorrelation, total, modified, hadamard.
    m_samples : tuple of int
        M of the M-sample deviations among these views, 2 or more.
    """

    points_per_decade: float = 10.0
    longest_tau_share: float = 1 / 3
    significance: float = 0.001
    hump_significance: float = 0.001
    views: tuple = ("psd", "autocorrelation")
    m_samples: tuple = ()
