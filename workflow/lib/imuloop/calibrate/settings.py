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
        "Estimated from all rests with the other parameters, or the mean of the first rest",
    )
    longest_rotation: float = setting(
        30.0, "A rotation between two poses that lasts longer is left out of the fit, s", gt=0
    )
