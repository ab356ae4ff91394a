"""Tests of whether a reference has the declared convention, order and units, by the sensors."""

from dataclasses import replace
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from imuloop.core.samples import ORIENTATION, POSITION
from imuloop.ingest.attitudes import angles, at_instants, turns

# size of each unit of a position, m
LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
# a convention fits if its residual is less than this share of the turns
FITS = 0.3
# largest share by which the scales of a sensor and its reference may differ, and the cosine of the
# angle between the axes of two worlds from 1
SCALE = 0.1
# s; windows over which places and specific force are compared
_WINDOW = 0.2
# least number of samples for a verdict on the convention or on the places
LEAST = 50


def _frame(turn, angle):
    """Return the rotation from the sensor's axes to the reference's axes, (3, 3), and its residual.

    `turn` are the rotation vectors of n turns by the reference and `angle` those by the sensor,
    rad, (n, 3) each; the rotation times a vector of `angle` fits the vector of `turn`. The rotation
    is their least-squares fit (Kabsch), made twice: the second fit leaves out the worst tenth of
    the turns. The residual is the root mean square of the errors that the fit leaves over the root
    mean square of the turns, 0 for a perfect fit; it, too, leaves out the worst tenth.
    """
    keep = np.ones(len(turn), bool)
    for _ in range(2):
        u, _, v = np.linalg.svd(turn[keep].T @ angle[keep])
        frame = u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v
        away = np.linalg.norm(turn - angle @ frame.T, axis=1)
        keep = away <= np.quantile(away, 0.9)
    return frame, float(np.sqrt((away[keep] ** 2).mean() / (turn[keep] ** 2).sum(axis=1).mean()))


def convention_faults(reference, t, w, declared):
    """Return reasons why attitudes of a reference do not fit the angular rate, and fitted axes.

    The convention says what a quaternion rotates to what. Both conventions and both orders of the
    quaternion are tried, so that the reason can name the ones that fit. A wrong order may look like
    other axes of the world; `place_faults` tells the two apart.

    Parameters
    ----------
    reference : Reference
        Attitudes as declared.
    t, w : array
        Time of n samples, s, (n,), and their angular rates, rad/s, (n, 3).
    declared : str
        Convention, "body_to_world" or "world_to_body".

    Returns
    -------
    reasons : list of str
        The reasons; empty if the attitudes fit.
    frame : array, shape (3, 3)
        Rotation from the axes of the sensor to the axes of the reference.
    residual : float
        Share of the turns of the reference that the gyroscope does not explain.
    """
    tried = {}
    for order, convention in product(("wxyz", "xyzw"), ("body_to_world", "world_to_body")):
        q = reference.q if order == "wxyz" else reference.q[:, [3, 0, 1, 2]]
        q = q * [1, -1, -1, -1] if convention == "world_to_body" else q
        start, end, turn = turns(replace(reference, q=q))
        inside = (start >= t[0]) & (end <= t[-1])
        if inside.sum() < LEAST:
            why = f"its clock overlaps with the clock of the log for less than {LEAST} samples"
            return [f"reference: {why}"], np.eye(3), 1.0
        turn, angle = turn[inside], angles(t, w, start[inside], end[inside])
        # noise and swapped markers lengthen short turns: use the median of the longer half
        lengths = [np.linalg.norm(v, axis=1) for v in (turn, angle)]
        long = lengths[1] >= np.median(lengths[1])
        size = np.median(lengths[0][long] / np.maximum(lengths[1][long], 1e-12))
        tried[order, convention] = *_frame(turn, angle * size), size
    frame, residual, size = tried["wxyz", declared]
    # among the readings that fit, take the one with the smallest turn from sensor to body
    order, convention = max(tried, key=lambda key: (tried[key][1] < FITS, np.trace(tried[key][0])))
    why = []
    if residual > FITS:
        why = [f"read as {declared} it does not explain {residual:.0%} of the gyroscope's turns"]
        if tried[order, convention][1] < FITS:
            why.append(
                f"it fits where they are {order}, {convention}: name its columns in the order "
                f"w, x, y, z and declare convention: {convention}"
            )
    elif abs(size - 1) > SCALE:
        why = [f"its turns are {size:.3g} times the gyroscope's: see units.angular_rate, as deg/s"]
    return [f"reference.orientation: {'; '.join(why)}"] if why else [], frame, residual


def _gain(reference, t, f, frame):
    """Return the matrix from the specific force to the acceleration by a reference, (3, 3).

    The rows are axes of the acceleration, the columns axes of the force, both x, y, z of the world.
    The matrix is the identity if the places of the reference are on the axes of its attitudes and
    in m. The acceleration is the second difference of three places that are `_WINDOW` s apart, and
    the force is its weighted mean over the same time. The matrix is the least-squares fit of the
    force to the acceleration, each without its median over the log. `reference` is the Reference,
    `t` are the times of n samples, s, (n,), `f` is their specific force, m/s^2, (n, 3), and `frame`
    rotates from the axes of the sensor to the axes of the reference, (3, 3). The result is None if
    there are too few places, or if the fit leaves a large error, as with too little motion.
    """
    columns = at_instants(reference, t)
    q, p = (np.column_stack([columns[c] for c in names]) for names in (ORIENTATION, POSITION))
    k = max(1, round(_WINDOW / np.median(np.diff(t))))
    valid = np.isfinite(p[:, 0]) & np.isfinite(q[:, 0])
    middle = np.arange(k, len(t) - k, max(1, k // 2))
    middle = middle[valid[middle] & valid[middle - k] & valid[middle + k]]
    force = np.full((len(t), 3), np.nan)
    if valid.any():
        force[valid] = Rotation.from_quat(q[valid], scalar_first=True).apply(f[valid] @ frame.T)
    # a second difference is a mean of the acceleration with these weights
    weight = np.concatenate([np.arange(1, k + 1), np.arange(k - 1, 0, -1)]) / k**2
    mean = np.column_stack([np.convolve(c, weight, "valid") for c in force.T])[middle - k + 1]
    moved = (p[middle - k] - 2 * p[middle] + p[middle + k]) / (t[k] - t[0]) ** 2
    pairs = np.hstack([mean, moved])[np.isfinite(mean[:, 0])]
    if len(pairs) < LEAST:
        return None
    mean, moved = np.hsplit(pairs - np.median(pairs, axis=0), 2)
    gain = np.linalg.lstsq(mean, moved, rcond=None)[0].T
    residual = np.sqrt(((moved - mean @ gain.T) ** 2).sum() / (moved**2).sum())
    # with hardly any motion, or a lever arm, the matrix says nothing
    return gain if residual < 2 * FITS else None


def place_faults(reference, t, f, frame, unit):
    """Return the reasons why the places of a reference do not fit the specific force, a list.

    The list is empty if they fit, or if nothing can be said. `reference` is the Reference, `t` the
    times of n samples, s, (n,), `f` their specific force, m/s^2, (n, 3), `frame` the rotation from
    the axes of the sensor to the axes of the reference, (3, 3), and `unit` the declared unit of the
    places.
    """
    gain = _gain(reference, t, f, frame)
    if gain is None:
        return []
    size, why = np.cbrt(np.linalg.det(gain)), None
    # without its size the matrix is a rotation, if all fits: cosine of its angle
    cosine = np.clip((np.trace(gain) / size - 1) / 2, -1, 1)
    scales = {name: abs(size) * metres / LENGTH[unit] for name, metres in LENGTH.items()}
    fits = [name for name, scale in scales.items() if abs(scale - 1) < 3 * SCALE]
    if fits and fits != [unit]:
        why = f"{abs(size):.3g} times too far: declare units.position: {fits[0]}"
    elif size < 0:
        why = "mirrored: change the sign of one axis, or of the vector part of orientation"
    elif cosine < 1 - SCALE:
        angle = np.degrees(np.arccos(cosine))
        why = f"its axes are {angle:.0f} degrees from the axes of orientation"
    return [f"reference.position: {why}"] if why else []
