"""Settings of the calibration."""

from dataclasses import dataclass


@dataclass(frozen=True)
class CalibrateSettings:
    """Settings of the calibration.

    Attributes
    ----------
    gyroscope_bias : {'rests', 'initial_rest'}
        Where the gyroscope's bias comes from: estimated from all rests together with the other
        parameters, or held at the mean of the first rest, as imu_tk does; the diagnosis, and a
        model with effects, always estimate it.
    face_tolerance : float
        Degrees; a pose is a face if specific force lies this near to an axis.
    longest_rotation : float
        Seconds; a longer way from one pose to the next is left out of the fit.
    largest_condition : float
        Condition number of the design beyond which parameters are called undetermined.
    """

    gyroscope_bias: str = "rests"
    face_tolerance: float = 20.0
    longest_rotation: float = 30.0
    largest_condition: float = 100.0
