"""A test of whether both sensors of a log have the same axes, by the turns of the device.

While a device turns at the rate ω, the direction u of gravity on its axes obeys ``du/dt = u × ω``.
Over two neighbouring windows of T seconds, with the means u₁ and u₂ of u, this gives exactly

    u₂ - u₁ = ∫ w u × P (r - b) dt

The weight w rises from 0 to 1 over the first window and falls to 0 over the second. r is the
angular rate as logged, b its bias, and P one of the 48 signed permutations of the axes, a mapping.
In a good log P is the identity. The test finds P. It cannot show which of the two sensors has wrong
axes, nor whether all three signs of the accelerometer are wrong.
"""

from itertools import permutations, product

import numpy as np

from imuloop.core.samples import ANGULAR_RATE

# length of a window, s; and about how many steps of a long log are used at most
TURN_WINDOW, KEPT = 0.25, 4096
# a step is used if it turns gravity by more than this angle, rad, and if the size of the specific
# force differs from gravity by less than this share
LEAST_STEP, MOST_SHAKEN = 0.1, 0.3
# fewer steps show no orientation
LEAST_STEPS = 4
# a mapping is stated if its agreement exceeds the first number, as accelerations by the hand lower
# the agreement; another mapping remains possible if its agreement is less than the second number
# below the best one
AGREEMENT, LEAD = 0.9, 0.05
# signed permutations, the identity first
MAPPINGS = np.array(
    [
        np.eye(3)[list(order)] * np.array(signs)[:, None]
        for order in permutations(range(3))
        for signs in product((1, -1), repeat=3)
    ]
)
# component i of u × r is the sum of CROSS[i, j, k] u[j] r[k] over j and k
CROSS = np.cross(np.eye(3)[:, None], np.eye(3)[None]).transpose(2, 0, 1)


def fit_axes(means, step):
    """Return how well the axes of both sensors agree, the entry ``axes`` of quality.json, or None.

    `means` are m successive means of the six channels, each over `step` s, SI, (6, m): specific
    force x, y, z, then angular rate x, y, z. The entry is a dict: ``agreement``, the mean cosine
    between the measured turns of gravity and the turns that the angular rate gives with the axes as
    logged; ``best``, the same with the best signed permutation of the axes; ``ratio``, turns by the
    angular rate over turns of gravity, or None; and ``mapping``, the best permutation as a list
    that `mapping_words` explains. ``mapping`` is None if the axes as logged fit about as well as
    the best ones, or if none fit well. The whole result is None if gravity turns in fewer than
    `LEAST_STEPS` pairs of neighbouring windows of `TURN_WINDOW` s.
    """
    fine = max(round(TURN_WINDOW / step), 1)
    count = means.shape[1] // fine
    force, rate = means[:, : count * fine].reshape(2, 3, count, fine)
    size = np.linalg.norm(force, axis=0)
    gravity = np.nanmedian(size) if np.isfinite(size).any() else np.nan
    u = force / np.where(size > 0, size, 1.0)
    calm = (np.abs(size / gravity - 1) < MOST_SHAKEN).all(axis=1)
    calm &= np.isfinite(rate).all(axis=(0, 2))
    change = np.diff(u.mean(axis=2), axis=1).T
    angle, calm = np.linalg.norm(change, axis=1), calm[1:] & calm[:-1]
    steps = np.flatnonzero(calm & (angle > LEAST_STEP))
    steps = steps[:: max(len(steps) // KEPT, 1)]
    if len(steps) < LEAST_STEPS:
        return None
    rests = rate.mean(axis=2)[:, :-1][:, calm & (angle < LEAST_STEP / 4)]
    bias = np.median(rests, axis=1) if rests.size else np.zeros(3)
    rise = (np.arange(fine) + 0.5) / fine * step
    weighted = np.concatenate([u[:, steps] * rise, u[:, steps + 1] * rise[::-1]], axis=2)
    both = np.concatenate([rate[:, steps], rate[:, steps + 1]], axis=2) - bias[:, None, None]
    by_axis = np.einsum("ijk,jnt,lnt->nkli", CROSS, weighted, both, optimize=True)
    turned = np.einsum("pkl,nkli->pni", MAPPINGS, by_axis)
    change, size = change[steps], np.linalg.norm(turned, axis=2)
    # a turn about gravity does not show P: a least size keeps its cosine small
    size = np.maximum(size, 0.1 * np.median(size[0]) + 1e-12) * angle[steps]
    cosine = (turned * change).sum(axis=2) / size
    agreement = cosine.mean(axis=1)
    best = int(np.argmax(agreement))
    common = (turned[best] * change).sum()
    possible, mapping = agreement > agreement[best] - LEAD, None
    if agreement[best] > AGREEMENT and not possible[0]:
        same = (MAPPINGS[possible] == MAPPINGS[best]).all(axis=(0, 2))
        mapping = ((MAPPINGS[best] @ [1, 2, 3]) * same).astype(int).tolist()
    return {
        "agreement": float(agreement[0]),
        "best": float(agreement[best]),
        "ratio": float((turned[best] ** 2).sum() / common) if common > 0 else None,
        "mapping": mapping if any(mapping or ()) else None,
    }


def mapping_words(mapping):
    """Return in words which axis of the gyroscope fits each axis of the accelerometer.

    The text is such as "x as gy, y as -gx: turned axes". `mapping` has for each axis x, y, z of the
    accelerometer the axis of the gyroscope: 1, 2, 3 for gx, gy, gz, negative if the sign is turned,
    and 0 if it is not known.
    """
    axes = [
        f"{axis} as {'-' * (number < 0)}{ANGULAR_RATE[abs(number) - 1]}"
        for axis, number in zip("xyz", mapping, strict=True)
        if number
    ]
    matrix = np.eye(3)[np.abs(mapping) - 1] * np.sign(mapping)[:, None]
    kind = "turned" if np.linalg.det(matrix) > 0 else "swapped or mirrored"
    return f"{', '.join(axes)}: {kind} axes"
