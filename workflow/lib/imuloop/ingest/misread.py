"""Rows that are not what their columns say: gravity as the angular rate, a sample in two units.

Both are looked for in the values as they are logged: the units that are declared do not matter.
"""

from itertools import permutations

import numpy as np

from imuloop.core.samples import SENSORS
from imuloop.core.units import ACCELERATION, ANGULAR_RATE, STANDARD_GRAVITY

# share by which the length of gravity's vector may be off 1 g as a filter gives it, and by which
# a ratio may be off the ratio of two units
_NEAR, _OFF = 0.005, 0.03
# least cosine of the angle of two vectors that are parallel
_PARALLEL = 0.9
# share of the rows that look like gravity, and that repeat the one before, in a log that is so
_SHARE, _REPEATED = 0.8, 0.25
# ratio of a value in one unit to that in another, where they differ by a factor of two or more: to
# the sensor and the two units
_RATIOS = [
    (sensor, one, other, units[one] / units[other])
    for sensor, units in (("accelerometer", ACCELERATION), ("gyroscope", ANGULAR_RATE))
    for one, other in permutations(units, 2)
    if not 0.5 < units[one] / units[other] < 2
]


def _lengths_and_cosine(one, other):
    """Return the lengths of two sets of vectors, (3, n), and the cosine of their angles."""
    lengths = np.linalg.norm(one, axis=0), np.linalg.norm(other, axis=0)
    return *lengths, (one * other).sum(axis=0) / (lengths[0] * lengths[1])


# values of a broken log can be of any size
@np.errstate(all="ignore")
def is_gravity(raw):
    """Return whether the angular rate of most rows is gravity's vector.

    `raw` are the values of each channel as logged, (n,).
    """
    # each eighth row will do
    force, rate = (np.array([raw[axis][::8] for axis in axes]) for axes in SENSORS.values())
    _, length, cosine = _lengths_and_cosine(force, rate)
    near = np.minimum(np.abs(length - 1), np.abs(length / STANDARD_GRAVITY - 1)) < _NEAR
    return np.count_nonzero(near & (np.abs(cosine) > _PARALLEL)) > _SHARE * len(length)


@np.errstate(all="ignore")
def in_two_units(x, raw):
    """Return the sensor, units and number of rows that repeat the one before in another unit.

    Such rows have its stamp, `x`, (n,); of the other sensor they repeat the values, or these in
    another unit too. None if they are few.
    """
    at = np.flatnonzero(x[1:] == x[:-1]) + 1
    fits, repeats = {}, len(at) > 0
    for sensor, axes in SENSORS.items():
        one, other = (np.array([raw[axis][rows] for axis in axes]) for rows in (at - 1, at))
        length, longer, cosine = _lengths_and_cosine(one, other)
        scaled = (one == other).all(axis=0)
        for whose, *units, ratio in _RATIOS:
            if whose == sensor:
                near = np.abs(longer / length / ratio - 1) < _OFF
                fits[sensor, *units] = near & (cosine > _PARALLEL)
                scaled |= fits[sensor, *units]
        repeats &= scaled
    rows = {key: np.count_nonzero(each & repeats) for key, each in fits.items()}
    found = max(rows, key=rows.get, default=None)
    if not found or rows[found] <= _REPEATED * len(x):
        return None
    return dict(zip(("sensor", "unit", "other", "n"), (*found, rows[found]), strict=True))
