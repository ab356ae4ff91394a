"""Two faults of rows: gravity in place of the angular rate, and a sample repeated in two units.

Both tests use the values as logged, so that the declared units do not matter.
"""

from itertools import permutations

import numpy as np

from imuloop.core.samples import SENSORS
from imuloop.core.units import FACTORS, STANDARD_GRAVITY

# largest relative error of the length of gravity in a fusion filter's output, and of the ratio of
# two units, both as rounding to two or three digits leaves it
_NEAR = 0.01
# two vectors count as parallel if the cosine of their angle exceeds this; a log holds gravity if
# more than this share of its rows looks like gravity
_MOST = 0.9
# a log is in two units if more than this share of its rows repeats the row before in another unit:
# it is one half if each row is written twice, and less if only some are
_REPEATED = 0.25


def _compare(one, other):
    """Return the lengths of n vectors, of n other vectors, and the cosines between them, (n,) each.

    `one` and `other` are the two sets of vectors, (3, n) each: axes x, y, z, and rows.
    """
    length, other_length = np.linalg.norm(one, axis=0), np.linalg.norm(other, axis=0)
    return length, other_length, (one * other).sum(axis=0) / (length * other_length)


# values of a broken log can be of any size
@np.errstate(all="ignore")
def is_gravity(raw):
    """Return whether the columns of the angular rate hold the vector of gravity in most rows.

    A vector is taken as gravity if it is about 1 or 9.81 long, as in g or m/s^2, and lies along the
    acceleration, in the same or the opposite direction.

    `raw` are the n values of each channel as logged, (n,), by name.
    """
    # every eighth row is enough
    force, rate = (np.array([raw[axis][::8] for axis in axes]) for axes in SENSORS.values())
    _, length, cosine = _compare(force, rate)
    near = np.minimum(np.abs(length - 1), np.abs(length / STANDARD_GRAVITY - 1)) < _NEAR
    return np.count_nonzero(near & (np.abs(cosine) > _MOST)) > _MOST * len(length)


@np.errstate(all="ignore")
def in_two_units(x, raw):
    """Return the sensor whose samples are logged twice, in two units, a dict, or None.

    A row then has the time stamp of the row before and the same vector in another unit. The dict
    has ``sensor``, the unit of the row before, ``unit``, the unit of the repeated row, ``other``,
    and the number ``n`` of repeated rows. The result is None if these are at most the share
    `_REPEATED` of all rows. `x` are the time stamps of all rows, (n,), and `raw` the channels as
    logged, (n,) by name.
    """
    repeats = np.flatnonzero(x[1:] == x[:-1]) + 1
    for (sensor, axes), units in zip(SENSORS.items(), FACTORS.values(), strict=True):
        one, other = (np.array([raw[axis][k] for axis in axes]) for k in (repeats - 1, repeats))
        length, other_length, cosine = _compare(one, other)
        ratio = other_length / length
        for unit, other_unit in permutations(units, 2):
            expected = units[unit] / units[other_unit]
            near = (np.abs(ratio / expected - 1) < _NEAR) & (cosine > _MOST)
            rows = np.count_nonzero(near)
            # mg and cm/s^2 are too near to each other to be told apart
            if not 0.5 < expected < 2 and rows > _REPEATED * len(x):
                return {"sensor": sensor, "unit": unit, "other": other_unit, "n": rows}
    return None
