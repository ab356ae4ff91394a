"""How fast a sensor's output, and the other's, change: rates of a whole log."""

from imuloop.core.memory import in_pieces, slope

# s; the neighbours of a sample lie within it
REACH = 0.1


@in_pieces
def own_slope(channels):
    """Return the rate of change of the sensor's own output, shape (n, 3)."""
    return slope(channels.t, channels.output)


@in_pieces
def other_slope(channels):
    """Return the rate of change of the other sensor's output, shape (n, 3)."""
    return slope(channels.t, channels.other)
