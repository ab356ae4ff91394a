"""Settings of the noise stage."""

from dataclasses import dataclass

from imuloop.core.setting import setting


@dataclass(frozen=True)
class NoiseSettings:
    """Settings of the noise stage; the defaults suit records from a minute to days."""

    points_per_decade: float = setting(10.0, "Averaging times per decade", gt=0)
    longest_tau_share: float = setting(
        1 / 3, "Longest averaging time as a share of the longest clean stretch", gt=0, lt=0.5
    )
    significance: float = setting(
        0.001, "Level at which a coefficient, a process or a line counts as found", gt=0, lt=1
    )
