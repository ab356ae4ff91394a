"""Settings of the calibration."""

from dataclasses import dataclass


@dataclass(frozen=True)
class CalibrateSettings:
    """Settings of the calibration; the schema of the config describes each."""

    # 'rests': estimated from all rests together with the other parameters; 'initial_rest': held at
    # the mean of the first rest, as imu_tk does, but never in the diagnosis or beside effects
    gyroscope_bias: str = "rests"
    # degrees between specific force and an axis
    face_tolerance: float = 20.0
    # s; a longer way from one pose to the next is left out of the fit
    longest_rotation: float = 30.0
    # condition number of the design beyond which parameters are called undetermined
    largest_condition: float = 100.0
