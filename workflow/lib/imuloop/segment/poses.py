"""Poses: which rests are one attitude."""

import numpy as np

from imuloop.core.rotation import exponential, prefix_product, step_vectors
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, TIME
from imuloop.core.stretches import lengths
from imuloop.segment.attitudes import SAME_ATTITUDE

# largest excursion between two rests that is still no turn, rad
TURNED = 0.087


def _turned(rows, first, last, bias):
    """Return whether a device turned away from its first attitude by more than `TURNED`."""
    t, *w = rows.read((TIME, *ANGULAR_RATE), first, last)
    attitudes = prefix_product(exponential(step_vectors(np.transpose(w) - bias, np.diff(t))))
    half = np.linalg.norm(attitudes[:, 1:], axis=1), np.abs(attitudes[:, 0])
    return np.max(2 * np.arctan2(*half), initial=0.0) > TURNED


def number_poses(rows, rests, table, stretches):
    """Return the pose number of each rest: 0, 1, 2 … in order of time.

    A rest has the number of the one before it if their directions of specific force agree within
    `SAME_ATTITUDE` (or four standard errors of the two means, where the noise is larger) and the
    gyroscope, its bias taken from both rests, never turned by more than `TURNED` in between. So a
    full turn, or one about the vertical, which leave gravity where it was, make a new pose. What
    happened in a gap is not known: the rest after it is a new pose. Takes Samples, rests, their
    rows of the table of segments, and stretches between long gaps.
    """
    numbers = np.zeros(len(rests), dtype=np.int64)
    force, rate = (
        table[[f"{name}_mean" for name in axes]].to_numpy() for axes in (ACCELERATION, ANGULAR_RATE)
    )
    # without specific force no attitude is told from another
    if not force.any():
        return numbers
    spread = table[[f"{name}_std" for name in ACCELERATION]].to_numpy()
    errors = np.linalg.norm(spread, axis=1) / np.sqrt(lengths(rests))
    stretch = np.searchsorted(np.asarray(stretches)[:, 0], rests[:, 0], side="right")
    first = 0
    for k in range(1, len(rests)):
        a, b = force[first], force[k]
        angle = np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)
        noise = np.hypot(errors[first], errors[k]) / np.linalg.norm(b)
        same = stretch[k] == stretch[k - 1] and angle <= max(SAME_ATTITUDE, 4 * noise)
        if same:
            between = rests[k - 1, 1] - 1, rests[k, 0] + 1
            bias = (rate[k - 1] + rate[k]) / 2
            same = not _turned(rows, *between, bias)
        numbers[k] = numbers[k - 1] + (not same)
        first = first if same else k
    return numbers
