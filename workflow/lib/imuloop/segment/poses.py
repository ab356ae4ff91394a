"""Poses: which rests are one attitude."""

import numpy as np

from imuloop.core.rotation import exponential, prefix_product, step_vectors


def largest_turn(t, w, bias):
    """Return the largest angle, rad, by which a device turned away from its first attitude.

    Parameters
    ----------
    t : array_like, shape (n,)
        Time, s.
    w : array_like, shape (n, 3)
        Angular rate, rad/s.
    bias : array_like, shape (3,)
        Rate at rest, rad/s.
    """
    if len(t) < 2:
        return 0.0
    attitude = prefix_product(exponential(step_vectors(w - bias, np.diff(t))))
    half = np.linalg.norm(attitude[:, 1:], axis=1), np.abs(attitude[:, 0])
    return float(np.max(2 * np.arctan2(*half)))


def number_poses(t, f, w, rests, stretches, settings):
    """Return the pose number of each rest: 0, 1, 2 … in order of time.

    A rest has the number of the one before it if their directions of specific force agree within
    `same_attitude` (or four standard errors of the two means, where the noise is larger) and the
    gyroscope, its bias taken from both rests, never turned by more than `turned` in between. So a
    full turn, or one about the vertical, which leave gravity where it was, make a new pose. What
    happened in a gap is not known: the rest after it is a new pose.

    Parameters
    ----------
    t : array_like, shape (n,)
        Time, s.
    f, w : array_like, shape (n, 3)
        Specific force, m/s², and angular rate, rad/s.
    rests : array_like of int, shape (m, 2)
        Ranges of samples, in order of time.
    stretches : array_like of int, shape (k, 2)
        Stretches without a gap.
    settings : SegmentSettings
        The two angles.

    Returns
    -------
    ndarray of int, shape (m,)
    """
    numbers = np.zeros(len(rests), dtype=np.int64)
    means = np.array([[f[i:j].mean(axis=0), w[i:j].mean(axis=0)] for i, j in rests])
    errors = np.array([np.linalg.norm(f[i:j].std(axis=0)) / np.sqrt(j - i) for i, j in rests])
    stretch = np.searchsorted(np.asarray(stretches)[:, 0], rests[:, 0], side="right")
    first = 0
    for k in range(1, len(rests)):
        a, b = means[first, 0], means[k, 0]
        angle = np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)
        noise = np.hypot(errors[first], errors[k]) / np.linalg.norm(b)
        same = stretch[k] == stretch[k - 1] and angle <= max(settings.same_attitude, 4 * noise)
        if same:
            between = slice(rests[k - 1, 1] - 1, rests[k, 0] + 1)
            bias = (means[k - 1, 1] + means[k, 1]) / 2
            same = largest_turn(t[between], w[between], bias) <= settings.turned
        numbers[k] = numbers[k - 1] + (not same)
        first = first if same else k
    return numbers
