"""Rotations that contradict all others, and the time at which a sensor changed during a recording.

All poses and rotations have equal weights. The noise model is not used, because contradictions are
much larger than noise. A rotation leads from one pose, a rest, to the next.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from imuloop.factors.factors import Factors
from imuloop.factors.rows import gravity_norm
from imuloop.model.state import BASE, COUNT, State

# ratio of an error to the errors of the others above which it contradicts them, and the least
# error of a rotation that is left out, rad: above the effects of sensors
TIMES = 10.0
TURN = 0.05
# error at which the soft-L1 loss goes over from quadratic to linear
SOFT_L1_SCALE = 1e-3
# fewest rotations that can contradict one of them, and the largest share that may be left out
FEWEST, SHARE = 12, 0.1
# a change of a sensor divides its poses, or rotations, in two parts. One part determines the nine
# parameters: the fewest poses or rotations in this part, and its least share of all
PARTS = {"accelerometer": 12, "gyroscope": 8}
LONG = 1 / 3
# the other part contradicts it: the fewest poses or rotations in it, the share of them that has to
# contradict, and the least error that contradicts, share of gravity or rad
CHANGED, MOST = 3, 0.5
LEAST = {"accelerometer": 5e-3, "gyroscope": 0.015}
# by sensor, the word for its measurements in a recording, and the part that may have changed
WORDS = {
    "accelerometer": ("poses", "the accelerometer"),
    "gyroscope": ("turns", "the gyroscope, or an axis of the accelerometer,"),
}
# parameters of both sensors without errors
NOMINAL = np.repeat([0.0, 1.0, 0.0, 0.0, 1.0, 0.0], [3, 3, 3, 6, 3, 3])
# prior standard deviation of misalignment, rad, scale factor, 1, and bias, share of gravity
LOOSE = 0.1
# least ratio of a singular value to the largest one: a smaller ratio is raised to this
UNSEEN = 1e-9
# largest ratio of the residuals of a fitted part to the smallest ones, for a possible change
UNEVEN = 2.0


@dataclass(frozen=True)
class Errors:
    """Errors of m poses or rotations, with c components each, by one calibration for all.

    Errors of poses are shares of gravity, errors of rotations are rad.
    """

    values: np.ndarray  # (m, c): errors
    # (m, c, 9): their derivative with respect to the first nine parameters of the sensor
    design: np.ndarray
    # (m, c, c): covariance of the errors by the uncertain direction of gravity; zero for poses
    spread: np.ndarray

    def sizes(self):
        """Return the norm of each error, (m,), after a fit of the nine parameters to all errors.

        The fit has the soft-L1 loss, so that few large errors hardly change it.
        """
        y, rows = self.values.ravel(), self.design.reshape(-1, 9)
        p = fit_robustly(lambda p: y + rows @ p, lambda p: rows, np.zeros(9))
        return np.linalg.norm(self.values + self.design @ p, axis=1)


def fit_robustly(residuals, derivative, start):
    """Return the p parameters of a fit with soft-L1 loss, (p,), from the parameters `start`, (p,).

    The loss is quadratic for small residuals and linear for large ones. `residuals` and
    `derivative` are functions of the parameters that return the residuals, (n,), and their
    Jacobian, (n, p).
    """
    options = {"loss": "soft_l1", "f_scale": SOFT_L1_SCALE, "x_scale": "jac"}
    return least_squares(residuals, start, derivative, **options).x


def inverse_root(rows):
    """Return R, (p, p), with ``R Rᵀ = (Jᵀ J)⁻¹``, of the Jacobian J, (n, p), the argument `rows`.

    R is large in the directions that J does not determine, but finite.
    """
    size = np.linalg.norm(rows, axis=0)
    size[size == 0] = 1.0
    # rows of zeros give all p singular values even if there are fewer than p rows
    square = np.concatenate([rows / size, np.zeros((len(size),) * 2)])
    _, values, axes = np.linalg.svd(square, full_matrices=False)
    return axes.T / np.maximum(values, UNSEEN * (values[0] or 1.0)) / size[:, None]


def fit_gravity_norm(f):
    """Fit the accelerometer to the norm of gravity at poses, with soft-L1 loss.

    A wide prior about the data sheet keeps parameters there that the poses do not determine.

    Parameters
    ----------
    f : ndarray, shape (n, 3)
        Mean specific force at n poses, in shares of gravity.

    Returns
    -------
    ndarray, shape (9,)
        The parameters: three elements of T, then K and b, the latter in shares of gravity.
    ndarray, shape (9, 9)
        A root R of their covariance ``R Rᵀ``.
    """
    n, loose, start = len(f), np.eye(9) / LOOSE, NOMINAL[:9]

    def linearise(x):
        """Return the errors of the norm of gravity and their Jacobian, RestRows."""
        sensor = State(np.append(x, NOMINAL[9:])).sensor("accelerometer")
        return gravity_norm(sensor, f, 1.0, np.zeros((n, 3, 0)))

    # standard deviations: `LOOSE` of the prior, and the scale of the loss of the residuals
    x = fit_robustly(
        lambda x: np.append(linearise(x).residual, SOFT_L1_SCALE * loose @ (x - start)),
        lambda x: np.concatenate([linearise(x).jacobian[:, 0], SOFT_L1_SCALE * loose]),
        start,
    )
    rows = linearise(x)
    # standard deviation of the residuals from their median size, which few large ones hardly change
    usual = np.median(np.abs(rows.residual)) / 0.67 * np.sqrt(n / max(n - 9, 1))
    return x, usual * inverse_root(np.concatenate([rows.jacobian[:, 0], usual * loose]))


def sensor_errors(sensor, recording):
    """Return the Errors of a sensor, given by its name, in a Recording.

    The errors of the accelerometer are those of the norm of gravity at the poses, in shares of
    gravity, after a fit of its nine parameters. The errors of the gyroscope are those of the
    rotations, rad, with nominal T and K. A rotation carries the direction of gravity from one pose
    to the next. The error has two components, across the direction that the accelerometer measures
    at the next pose. The bias of a rotation is the mean rate of both poses, as the bias may drift.
    """
    poses, moves, n = recording.poses, recording.rotations, len(recording.poses)
    # in shares of gravity, as the accelerometer's scale may be far from the declared one
    f = poses.f / np.median(np.linalg.norm(poses.f, axis=1))
    x, root = fit_gravity_norm(f)
    bias = (poses.w[moves.first] + poses.w[moves.first + 1]) / 2
    moves = replace(moves, w=moves.w - bias[:, None])
    poses = replace(poses, f=f, w_to_ends=poses.w_to_ends - poses.w[:, None])
    recording = replace(recording, poses=poses, rotations=moves)
    state = State(np.append(x, NOMINAL[9:]))
    linearised = Factors(1.0).linearised_about(recording, state).at(state.x)
    residual, jacobian = linearised.residual, linearised.jacobian
    if sensor == "accelerometer":
        design = jacobian[:n, None, :9]
        return Errors(values=residual[:n, None], design=design, spread=np.zeros((n, 1, 1)))
    # the poses have the first 4 n residuals: norm of gravity, and three of the rate
    design = jacobian[4 * n :].reshape(len(moves), 2, COUNT)
    # root of the covariance by the uncertain directions of gravity
    by_force = design[..., BASE["accelerometer"]] @ root
    by_turn = design[..., BASE["gyroscope"]][..., :9]
    return Errors(
        values=residual[4 * n :].reshape(-1, 2),
        design=by_turn,
        spread=by_force @ by_force.swapaxes(1, 2),
    )


def sensors_work(poses):
    """Return whether all Poses have a specific force above zero and a finite angular rate."""
    norm = np.linalg.norm(poses.f, axis=1)
    return len(norm) > 0 and bool(np.all(norm > 0) and np.isfinite(poses.w).all())


def odd_turns(recording):
    """Return which rotations of a Recording contradict the others, and the errors of all.

    The first result is a mask, (m,) of bool, of the m rotations. The second has the size of the
    error of each rotation, rad, (m,), by a robust fit of the gyroscope to all rotations. No
    rotation is marked if more than a few contradict the others, or if there are fewer than
    `FEWEST`. The uncertainty of a rotation by undersampling, and by directions of gravity that the
    poses do not determine, is allowed for.
    """
    rotations = recording.rotations
    if len(rotations) < FEWEST or not sensors_work(recording.poses):
        return np.zeros(len(rotations), dtype=bool), np.zeros(len(rotations))
    turns = sensor_errors("gyroscope", recording)
    errors = turns.sizes()
    extra = rotations.aliasing_covariance + rotations.time_covariance
    # trace of the covariance of each error, with the additional errors of all parts of a rotation
    variance = np.einsum("mcc->m", turns.spread) + np.einsum("mgii->m", extra)
    odd = errors > np.maximum(TIMES * np.maximum(np.median(errors), np.sqrt(variance)), TURN)
    return odd & (odd.sum() <= max(1, SHARE * len(odd))), errors


def find_change(errors, fewest, least):
    """Return the index k of the first error after a sensor changed; None if it did not change.

    For each k, the errors are split in those before k and those from k on. The nine parameters of
    the sensor are fitted to one part and predict the errors of the other. The parts contradict each
    other if most errors of the other part are larger than `least` and far larger than the
    uncertainty of the prediction. Among all k at which the parts contradict each other, those are
    kept whose fitted part has nearly the smallest residuals. Of these k, the one with the longest
    fitted part is returned.

    Parameters
    ----------
    errors : Errors
        Errors of m poses or rotations in order of time.
    fewest : int
        Fewest poses or rotations that determine the parameters.
    least : float
        Least size of an error that contradicts, in the unit of the errors.
    """
    n, splits = len(errors.values), []
    if np.sum(errors.sizes() > least) < CHANGED * MOST:
        return None
    # (residuals of the fitted part, its length, k) of each contradiction
    for k in range(CHANGED, n - CHANGED + 1):
        before = np.arange(n) < k
        for part in (before, ~before):
            if part.sum() < max(fewest, LONG * n):
                continue
            rows, y = errors.design[part].reshape(-1, 9), errors.values[part].ravel()
            root = inverse_root(rows)
            # least-squares solution of rows p = -y, and the standard deviation of its residuals
            p = -root @ (root.T @ (rows.T @ y))
            usual = np.sqrt(np.sum((y + rows @ p) ** 2) / (len(y) - len(p)))
            # the errors of the other part, and their covariance by noise and by the error of p
            design, leverage = errors.design[~part], errors.design[~part] @ root
            predicted = errors.values[~part] + design @ p
            noise = usual**2 * (np.eye(design.shape[1]) + leverage @ leverage.swapaxes(1, 2))
            inverse = np.linalg.pinv(noise + errors.spread[~part])
            far = np.einsum("mc,mcd,md->m", predicted, inverse, predicted) > TIMES**2
            if np.mean(far & (np.linalg.norm(predicted, axis=1) > least)) >= MOST:
                splits.append((usual, part.sum(), k))
    smallest = min(splits, default=[0.0])[0]
    chosen = [(count, k) for usual, count, k in splits if usual <= UNEVEN * smallest]
    return max(chosen)[1] if chosen else None


def change_of_sensor(sensor, recording):
    """Return when a sensor changed during a Recording, s, and a sentence on the change, or None.

    The result is None if the sensor, given by its name, did not change, if the recording has
    several sessions, or if the recording has too few poses or rotations to tell.
    """
    poses, (what, name) = recording.poses, WORDS[sensor]
    table = poses if sensor == "accelerometer" else recording.rotations
    # the clocks of two sessions cannot be compared
    if len(table) < PARTS[sensor] + CHANGED or not sensors_work(poses) or np.ptp(poses.session):
        return None
    k = find_change(sensor_errors(sensor, recording), PARTS[sensor], LEAST[sensor])
    if k is None:
        return None
    time = (table.end_s[k - 1] + table.start_s[k]) / 2
    return time, (
        f"{name} changed at about {time:.4g} s: the "
        f"{k} {what} before contradict the {len(table) - k} after; was its range, scale, "
        "mounting or clock changed there, or were logs joined? Calibrate one part: time_range"
    )


def why_changed(sensor, recording):
    """Return a sentence that says when a sensor changed during a Recording, and why this is so.

    The result is None if the sensor, given by its name, did not change or if the data cannot tell.
    """
    time_and_text = change_of_sensor(sensor, recording)
    return time_and_text and time_and_text[1]
