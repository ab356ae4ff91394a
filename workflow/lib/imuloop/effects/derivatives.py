"""How fast a sensor's output, and the other's, change: rates of a whole log."""

from imuloop.core.memory import in_pieces, secant, slope

# s; the neighbours of a sample lie within it, and what it is where it was late
REACH, LATEST = 0.1, 0.1


@in_pieces
def own_change(channels, seconds):
    """Return the mean rate of change of the sensor's output until `seconds` later, (n, 3)."""
    return secant(channels.t, channels.output, seconds, channels.step)


@in_pieces
def drifting_change(channels, gained, middle):
    """Return the same until `gained` seconds per second from the `middle`, s, later, (n, 3)."""
    return secant(channels.t, channels.output, gained * (channels.t - middle), channels.step)


@in_pieces
def other_slope(channels):
    """Return the rate of change of the other sensor's output, shape (n, 3)."""
    return slope(channels.t, channels.other)


def unheld(self, design, low, high):
    """Return the derivative of a delay as it is: a time is the same however fast all changes."""
    return design
