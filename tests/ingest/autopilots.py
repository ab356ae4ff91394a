"""What logs of autopilots have in common: stamps, warmth, increments with their own interval."""

from fractions import Fraction

import numpy as np

# PX4 counts from its start; odd, so that no stamp is a whole number of anything
STAMPS = (12_345_678_901 + 10_003 * np.arange(500)).astype("u8")
WARM = np.linspace(20, 30, 500, dtype=np.float32)


def of_own_interval(increments, ticks, per_s):
    """Return the float64 nearest to each increment over its interval; without one, no row."""
    return [
        [float(Fraction(x) * per_s / Fraction(dt)) for x, dt in zip(*row, strict=True)]
        for row in zip(increments.tolist(), ticks.tolist(), strict=True)
        if all(row[1])
    ]
