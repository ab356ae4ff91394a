"""Settings of the segment stage."""

from dataclasses import dataclass

from imuloop.core.setting import setting


@dataclass(frozen=True)
class SegmentSettings:
    """Settings of the segment stage: the conditions for a rest and for a disturbance."""

    window_s: float = setting(1.0, "Sliding window of the static detector, s", gt=0)
    # larger than the gyroscope's g-sensitivity (at most 0.3 deg/s per g in common parts), smaller
    # than the slowest turn by hand
    rate_tolerance: float = setting(0.01, "Largest mean rate of a rest, less its bias, rad/s", gt=0)
    shortest_rest_s: float = setting(1.0, "Shortest rest, s; at least 4 samples", gt=0)
    false_alarm: float = setting(0.01, "Probability that a cut is made without need", gt=0, lt=1)
    # slower changes are drift
    longest_scale_s: float = setting(300.0, "Longest scale of disturbances, s", gt=0)
    guard_s: float = setting(1.0, "Cut on each side of a disturbance, s", ge=0)
    # between two disturbances; a shorter one counts as disturbed
    shortest_static_s: float = setting(10.0, "Shortest rest between disturbances, s", ge=0)
