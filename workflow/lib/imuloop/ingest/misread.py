"""Rows that are not what their columns say: gravity as the angular rate, a sample in two units.

Both are looked for in the values as they are logged: the units that are declared do not matter.
"""

from itertools import permutations

import numpy as np

from imuloop.core.samples import SENSORS
from imuloop.core.units import ACCELERATION, ANGULAR_RATE, STANDARD_GRAVITY

# length of gravity's vector as a filter gives it, in g or m/s^2, and how far one may be from it, as
# a share; cosine of its angle to the acceleration
_LENGTHS, _NEAR, _ALONG = (1.0, STANDARD_GRAVITY), 0.005, 0.9
# one row in so many is looked at for it, and the share of these rows that have it
_STRIDE, _SHARE = 8, 0.8
# ratio of a value in one unit to that in another, where they differ by a factor of two or more: to
# the two units
_UNITS = {"accelerometer": ACCELERATION, "gyroscope": ANGULAR_RATE}
_RATIOS = {
    sensor: {
        known[one] / known[other]: (one, other)
        for one, other in permutations(known, 2)
        if not 0.5 < known[one] / known[other] < 2
    }
    for sensor, known in _UNITS.items()
}
# share by which a ratio may differ from it, least cosine, and the share of rows that repeat one
_OFF, _PARALLEL, _REPEATED = 0.03, 0.95, 0.25


# values of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def _lengths_and_cosine(one, other):
    """Return the lengths of two sets of vectors, (3, n), and the cosine of their angles."""
    lengths = np.linalg.norm(one, axis=0), np.linalg.norm(other, axis=0)
    return *lengths, (one * other).sum(axis=0) / (lengths[0] * lengths[1])


def like_gravity(raw):
    """Return in how many rows the rate is gravity's vector, and how many rows were looked at.

    `raw` are the values of each channel as logged, (n,).
    """
    force, rate = (np.array([raw[axis][::_STRIDE] for axis in axes]) for axes in SENSORS.values())
    _, length, cosine = _lengths_and_cosine(force, rate)
    near = [np.abs(length / each - 1) < _NEAR for each in _LENGTHS]
    return np.array(
        [np.count_nonzero(np.any(near, axis=0) & (np.abs(cosine) > _ALONG)), len(length)]
    )


# values of a broken log can be of any size
@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def in_two_units(x, raw):
    """Return (sensor, unit, other unit) -> rows that repeat the one before in the other unit.

    Such rows have its stamp, `x`, (n,); of the other sensor they repeat the values, or these in
    another unit too.
    """
    at = np.flatnonzero(x[1:] == x[:-1]) + 1
    if not len(at):
        return {}
    found, repeats = {}, np.ones(len(at), dtype=bool)
    for sensor, axes in SENSORS.items():
        one, other = (np.array([raw[axis][rows] for axis in axes]) for rows in (at - 1, at))
        length, longer, cosine = _lengths_and_cosine(one, other)
        scaled = np.zeros(len(at), dtype=bool)
        for ratio, units in _RATIOS[sensor].items():
            fits = (np.abs(longer / length / ratio - 1) < _OFF) & (cosine > _PARALLEL)
            found[sensor, *units] = fits
            scaled |= fits
        repeats &= scaled | (one == other).all(axis=0)
    rows = {key: np.count_nonzero(fits & repeats) for key, fits in found.items()}
    return {key: count for key, count in rows.items() if count}


def fault(counts):
    """Return why the rows of a log are not what they are taken for, or None; of `Counts`."""
    alike, looked_at = counts.like_gravity
    if alike > _SHARE * looked_at:
        return (
            "the columns of the angular rate hold gravity: vectors of constant length along the "
            "acceleration, as a fusion filter gives them; name the gyroscope's own columns in "
            "columns.angular_rate, or declare it as null where it was not logged"
        )
    (sensor, unit, other), rows = max(
        counts.in_two_units.items(), key=lambda each: each[1], default=(("", "", ""), 0)
    )
    if rows > _REPEATED * counts.read:
        return (
            f"{rows} rows repeat the one before, with its time stamp, in another unit: the "
            f"{sensor} in {unit} and again in {other}; log each sample once, or keep the rows of "
            "one unit"
        )
    return None
