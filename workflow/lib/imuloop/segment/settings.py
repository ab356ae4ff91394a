"""Settings of the segment stage."""

from dataclasses import dataclass

from imuloop.core.samples import LONG_GAP_STEPS


@dataclass(frozen=True)
class SegmentSettings:
    """What the segment stage asks of a rest and of a disturbance; lengths in s, angles in rad.

    Attributes
    ----------
    window_s : float
        Sliding window of the static detector; slow turns and tremor inside a rest are looked for
        in half of it.
    initial_rest_s : float
        Longest stretch at the start of a log that sets the level of rest.
    accelerometer_multiples, gyroscope_multiples : tuple of float
        Multiples of the variance at rest to choose from, one of each.
    rate_tolerance : float
        Largest departure of the windowed mean angular rate from its level at rest, rad/s. It has
        to leave room for the gyroscope's g-sensitivity (0.3 deg/s per g at worst in common parts)
        and to lie below the slowest turn by hand.
    trim_s : float
        Cut from each end of a rest that touches motion. The window ends a rest up to half its
        length early as it is, and each second cut is one more to integrate the gyroscope over.
    shortest_rest_s : float
        Shortest rest kept as a pose after trimming; it has at least 4 samples.
    same_attitude, turned : float
        Rests whose directions of specific force agree within the first, and between which the
        gyroscope turned by no more than the second, are one pose. Two means that are θ apart pool
        to a norm short by θ²/8, so half a degree costs 1e-5 of g.
    gap_factor : float
        A step of time longer than this multiple of the median step is a gap: it ends a rest, and a
        rotation over it is not used. Where fewer samples are lost, a rest or a move goes on.
    false_alarm : float
        Probability that an undisturbed session is cut at all: as disturbed, where it is static, or
        as a slow turn or tremor inside a rest.
    longest_scale_s, guard_s : float
        Longest scale on which disturbances are looked for, slower changes are drift, and what is
        cut on each side of one.
    shortest_static_s : float
        Stretches of a static session between two disturbances count as disturbed if shorter.
    """

    window_s: float = 1.0
    initial_rest_s: float = 50.0
    accelerometer_multiples: tuple = (1, 2, 3, 4, 5, 6, 7, 8, 9, 10)
    gyroscope_multiples: tuple = (3, 10, 30, 100, 300)
    rate_tolerance: float = 0.01
    trim_s: float = 0.05
    shortest_rest_s: float = 1.0
    same_attitude: float = 0.0087
    turned: float = 0.087
    gap_factor: float = LONG_GAP_STEPS
    false_alarm: float = 0.01
    longest_scale_s: float = 300.0
    guard_s: float = 1.0
    shortest_static_s: float = 10.0
