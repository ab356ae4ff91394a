"""Numbers of poses: consecutive rests in one attitude, without a turn between, are one pose."""

import numpy as np

from imuloop.core.rotation import exponential, prefix_product, step_vectors
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, TIME
from imuloop.core.stretches import lengths
from imuloop.segment.attitudes import SAME_ATTITUDE

# largest angle by which the device may turn and return between two rests of one pose, rad
TURNED = 0.087


def _has_turned(rows, first, last, bias):
    """Return whether the device turns by more than `TURNED` from its first attitude, a bool.

    `rows` are the Samples of the session. The range of rows `first` to `last`, half-open, is
    searched; the first attitude is the one at its start. `bias`, (3,), is the bias of the
    gyroscope, rad/s.
    """
    t, *w = rows.read((TIME, *ANGULAR_RATE), first, last)
    attitudes = prefix_product(exponential(step_vectors(np.transpose(w) - bias, np.diff(t))))
    # sine and cosine of half the angle of rotation
    sine, cosine = np.linalg.norm(attitudes[:, 1:], axis=1), np.abs(attitudes[:, 0])
    return np.max(2 * np.arctan2(sine, cosine), initial=0.0) > TURNED


def number_poses(rows, rests, table, stretches):
    """Return the number of the pose of each rest, 0, 1, 2 … in order of time, (m,).

    A pose is one attitude in which the device lies during one or more rests. A rest is in the pose
    of the rest before it under three conditions; otherwise a new pose begins:

    - No long gap lies between the two rests.
    - The direction of specific force agrees with that in the first rest of the pose: within
      `SAME_ATTITUDE`, or within four standard errors of the angle between them if these are larger.
    - The device never turned by more than `TURNED` between the two rests. The turn is the integral
      of the angular rate less the bias, which is the mean rate of both rests. So a full turn, or a
      turn about the vertical, makes a new pose although the direction of gravity is the same.

    Exception: without specific force, attitudes cannot be distinguished; all numbers are then 0.

    Parameters
    ----------
    rows : Samples
        The samples of the session.
    rests : ndarray of int, shape (m, 2)
        Ranges of samples of the rests.
    table : DataFrame
        Rows of the m rests in the table of segments, with mean and standard deviation of each
        channel.
    stretches : ndarray of int, shape (k, 2)
        Ranges of samples between long gaps.
    """
    numbers = np.zeros(len(rests), dtype=np.int64)
    force, rate = (
        table[[f"{name}_mean" for name in axes]].to_numpy() for axes in (ACCELERATION, ANGULAR_RATE)
    )
    # without specific force, attitudes cannot be distinguished
    if not force.any():
        return numbers
    # standard errors of the mean specific force, and index of the stretch that each rest lies in
    spread = table[[f"{name}_std" for name in ACCELERATION]].to_numpy()
    errors = np.linalg.norm(spread, axis=1) / np.sqrt(lengths(rests))
    stretch = np.searchsorted(np.asarray(stretches)[:, 0], rests[:, 0], side="right")
    # `first` is the index of the first rest of the pose
    first = 0
    for k in range(1, len(rests)):
        a, b = force[first], force[k]
        angle = np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)
        angle_error = np.hypot(errors[first], errors[k]) / np.linalg.norm(b)
        same = stretch[k] == stretch[k - 1] and angle <= max(SAME_ATTITUDE, 4 * angle_error)
        if same:
            # from the last sample of the rest before to the first of this one
            start, end = rests[k - 1, 1] - 1, rests[k, 0] + 1
            bias = (rate[k - 1] + rate[k]) / 2
            same = not _has_turned(rows, start, end, bias)
        numbers[k] = numbers[k - 1] if same else numbers[k - 1] + 1
        first = first if same else k
    return numbers
