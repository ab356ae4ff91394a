"""Settings of the segment stage."""

from dataclasses import dataclass

from imuloop.core.samples import LONG_GAP_STEPS


@dataclass(frozen=True)
class SegmentSettings:
    """Settings of rests and disturbances; s, rad and rad/s.

    The schema of the config describes each.
    """

    # slow turns and tremor inside a rest are looked for in half of it
    window_s: float = 1.0
    initial_rest_s: float = 50.0
    accelerometer_multiples: tuple = (1, 2, 3, 4, 5, 6, 7, 8, 9, 10)
    gyroscope_multiples: tuple = (3, 10, 30, 100, 300)
    # leaves room for the gyroscope's g-sensitivity (0.3 deg/s per g at worst in common parts) and
    # lies below the slowest turn by hand
    rate_tolerance: float = 0.01
    # the window ends a rest up to half its length early as it is, and each second cut is one more
    # to integrate the gyroscope over
    trim_s: float = 0.05
    shortest_rest_s: float = 1.0
    # two means that are θ apart pool to a norm short by θ²/8, so half a degree costs 1e-5 of g
    same_attitude: float = 0.0087
    turned: float = 0.087
    # where fewer samples are lost, a rest or a move goes on
    gap_factor: float = LONG_GAP_STEPS
    # that an undisturbed session is cut at all: as disturbed, as a slow turn or tremor in a rest
    false_alarm: float = 0.01
    # slower changes are drift
    longest_scale_s: float = 300.0
    guard_s: float = 1.0
    shortest_static_s: float = 10.0
