"""Whether a reference is in the convention, order and units that are declared, by the sensors."""

from dataclasses import replace
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from imuloop.core.samples import ORIENTATION, POSITION
from imuloop.core.units import DEGREE
from imuloop.ingest.attitudes import angles, at_instants, turns

# m in each unit of a position
LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
# share of the turns that may be left where a convention fits
FITS = 0.3
# cosine of the angle between two worlds from which on they are one
ALONG = 0.95
# to 10 % the two scales of a sensor and its reference may differ
SCALE = 0.1
# fewest samples by which a convention, or places, are judged
_LEAST = 50


def _frame(turn, angle):
    """Return the rotation that takes the sensor's turns to the reference's, and what it leaves.

    Least squares of the vectors (Kabsch), the worst tenth left out the second time; the share of
    the reference's turns that is left, root mean square.
    """
    keep = np.ones(len(turn), bool)
    for _ in range(2):
        u, _, v = np.linalg.svd(turn[keep].T @ angle[keep])
        frame = u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v
        left = np.linalg.norm(turn - angle @ frame.T, axis=1)
        keep = left <= np.quantile(left, 0.9)
    return frame, float(np.sqrt((left[keep] ** 2).mean() / (turn[keep] ** 2).sum(axis=1).mean()))


def convention_faults(reference, t, w, f, declared):
    """Return why the attitudes do not fit the angular rate, the frame, and the share that is left.

    Both conventions and orders of the quaternion are tried: what fits is said. Turns alone cannot
    tell a wrong order from other axes of body and world: the right one has the places' axes, or, if
    there are none, the sensor's.
    """
    found = {}
    for order, convention in product(("wxyz", "xyzw"), ("body_to_world", "world_to_body")):
        q = reference.q if order == "wxyz" else reference.q[:, [3, 0, 1, 2]]
        q = q * [1, -1, -1, -1] if convention == "world_to_body" else q
        start, end, turn = turns(replace(reference, q=q))
        inside = (start >= t[0]) & (end <= t[-1])
        if inside.sum() < _LEAST:
            why = "the reference's clock overlaps with that of the log for less than 50 samples"
            return [f"reference: {why}"], np.eye(3).tolist(), 1.0
        turn, angle = turn[inside], angles(t, w, start[inside], end[inside])
        # noise and swaps lengthen turns: the median of those that are long
        lengths = [np.linalg.norm(v, axis=1) for v in (turn, angle)]
        long = lengths[1] >= np.median(lengths[1])
        size = np.median(lengths[0][long] / np.maximum(lengths[1][long], 1e-12))
        frame, left = _frame(turn, angle * size)
        gain = _gain(replace(reference, q=q), t, f, frame) if left < FITS else None
        axes = -1.0 if gain is None else _alike_axes(gain)
        found[order, convention] = left, size, frame, axes, np.trace(frame)
    left, size, frame, axes, _ = found["wxyz", declared]
    fitting = [key for key in found if found[key][0] < FITS]
    best = max(fitting, key=lambda key: found[key][3:], default=None)
    why = None
    if left > FITS:
        why = f"read as {declared} it leaves {left:.0%} of the turns of the gyroscope unexplained"
    elif -1 < axes < ALONG < found[best][3]:
        why = f"read as {declared} its axes of the world are not those of the places"
    elif abs(size - 1) > SCALE:
        units = {1 / DEGREE: "deg/s taken for rad/s", DEGREE: "rad/s for deg/s"}
        said = [text for factor, text in units.items() if abs(size * factor - 1) < SCALE]
        cause = f"units.angular_rate, {said[0]}" if said else "wrong unit or full scale"
        best, why = None, f"its turns are {size:.3g} times those of the gyroscope: {cause}"
    if why and best:
        why += (
            f"; it fits where they are {best[0]}, {best[1]}: name its columns in the order w, x, "
        )
        why += f"y, z and declare convention: {best[1]}"
    return [f"reference.orientation: {why}"] if why else [], frame.tolist(), left


def _gain(reference, t, f, frame):
    """Return what takes specific force in the world to the places' second difference, (3, 3).

    None where places or motion are too few.
    """
    columns = at_instants(reference, t)
    q, p = (np.column_stack([columns[c] for c in names]) for names in (ORIENTATION, POSITION))
    step = float(np.median(np.diff(t)))
    k = max(1, round(0.2 / step))
    whole = np.isfinite(p[:, 0]) & np.isfinite(q[:, 0])
    middle = np.arange(k, len(t) - k, max(1, k // 2))
    middle = middle[whole[middle] & whole[middle - k] & whole[middle + k]]
    second = (p[middle - k] - 2 * p[middle] + p[middle + k]) / (k * step) ** 2
    force = np.full((len(t), 3), np.nan)
    if whole.any():
        force[whole] = Rotation.from_quat(q[whole], scalar_first=True).apply(f[whole] @ frame.T)
    weight = np.concatenate([np.arange(1, k + 1), np.arange(k - 1, 0, -1)]) / k**2
    pushed = np.column_stack([np.convolve(c, weight, "valid") for c in force.T])[middle - k + 1]
    sound = np.isfinite(pushed[:, 0])
    if sound.sum() < _LEAST:
        return None
    pushed, second = (x[sound] - np.median(x[sound], axis=0) for x in (pushed, second))
    gain = np.linalg.lstsq(pushed, second, rcond=None)[0].T
    left = np.sqrt(((second - pushed @ gain.T) ** 2).sum() / (second**2).sum())
    # hardly any motion, or an arm: nothing is said
    return gain if left < 2 * FITS else None


def _alike_axes(gain):
    """Return the cosine of the angle between the axes of force and places."""
    size = np.linalg.det(gain)
    return (np.trace(gain) / np.cbrt(size) - 1) / 2


def place_faults(reference, t, f, frame, declared):
    """Return why the places do not fit specific force, carried by the attitudes."""
    gain = _gain(reference, t, f, frame)
    if gain is None:
        return []
    size, why = np.cbrt(np.linalg.det(gain)), None
    unit = (declared.get("units") or {}).get("position", "m")
    tens = [x for x in (1e3, 1e2, 1e-3, 1e-2, 10.0, 0.1) if abs(abs(size) / x - 1) < 3 * SCALE]
    if tens:
        fits = [u for u, m in LENGTH.items() if np.isclose(m * tens[0], LENGTH[unit])]
        say = f": declare units.position: {fits[0]}" if fits else ""
        why = f"{tens[0]:g} times as far as specific force says{say}"
    elif size < 0:
        why = "accelerates against specific force: it is mirrored; change the sign of one axis, or "
        why += "of orientation's vector part"
    elif _alike_axes(gain) < ALONG:
        angle = np.degrees(np.arccos(np.clip(_alike_axes(gain), -1, 1)))
        why = f"its axes are {angle:.0f} degrees from those of orientation"
    return [f"reference.position: {why}"] if why else []
