"""Where in time the clean stretches of a session lie."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Layout:
    """Clean stretches of one session on its grid of samples; gaps keep their place in time.

    Attributes
    ----------
    rate : float
        Sampling rate, Hz.
    starts : tuple of int
        First sample of each stretch, counted from the session's start.
    lengths : tuple of int
        Samples of each stretch.
    levels : tuple of int
        Stretches of equal number share a level (across a gap); a disturbance may have moved the
        device, so that a new number, hence a level of its own, begins after it.
    """

    rate: float
    starts: tuple[int, ...]
    lengths: tuple[int, ...]
    levels: tuple[int, ...]
