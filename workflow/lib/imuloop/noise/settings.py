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
        Level at which a term counts as supported by the data, 1.
    """

    points_per_decade: float = 10.0
    longest_tau_share: float = 1 / 3
    significance: float = 0.01
