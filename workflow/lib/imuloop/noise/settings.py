"""Settings of the noise stage."""

from dataclasses import dataclass


@dataclass(frozen=True)
class NoiseSettings:
    """Settings of the noise stage; the defaults suit records from a minute to days.

    The schema of the config describes each.
    """

    points_per_decade: float = 10.0
    # of the longest clean stretch; below one half
    longest_tau_share: float = 1 / 3
    significance: float = 0.001
