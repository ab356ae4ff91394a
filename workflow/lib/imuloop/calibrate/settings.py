"""Settings of the calibration."""

from dataclasses import dataclass
from typing import Literal

from imuloop.core.setting import setting


@dataclass(frozen=True)
class CalibrateSettings:
    """Settings of the calibration."""

    # imu_tk uses initial_rest; the diagnosis and fits with effects always use rests
    gyroscope_bias: Literal["rests", "initial_rest"] = setting(
        "rests",
        "From all rests together with the other parameters, or held at the mean of the first",
    )
    longest_rotation: float = setting(
        30.0, "A longer way from one pose to the next is left out of the fit, s", gt=0
    )
