"""Settings of the segment stage."""

from dataclasses import dataclass

from imuloop.core.setting import setting


@dataclass(frozen=True)
class SegmentSettings:
    """Settings of the segment stage: the conditions for a rest and for a disturbance."""

    window_s: float = setting(1.0, "Sliding window of the static detector, s", gt=0)
    # larger than the gyroscope's g-sensitivity (at most 0.3 deg/s per g in common parts), smaller
    # than the slowest turn by hand
    rate_tolerance: float = setting(
        0.01,
        "Largest departure of the windowed mean angular rate from its level at rest, rad/s",
        gt=0,
    )
    shortest_rest_s: float = setting(
        1.0, "Shortest rest kept as a pose, s; at least 4 samples", gt=0
    )
    false_alarm: float = setting(
        0.01,
        "Probability that an undisturbed session, or any of its rests, is cut at all",
        gt=0,
        lt=1,
    )
    # slower changes are drift
    longest_scale_s: float = setting(
        300.0, "Longest scale on which disturbances are looked for, s", gt=0
    )
    guard_s: float = setting(1.0, "Cut on each side of a disturbance, s", ge=0)
    shortest_static_s: float = setting(
        10.0, "Shorter stretches between two disturbances count as disturbed, s", ge=0
    )
