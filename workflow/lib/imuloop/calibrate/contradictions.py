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
    """Errors that one calibration leaves in m poses or m rotations, with c components each.

    The error of a pose is relative to gravity (c = 1), the error of a rotation is in rad (c = 2).
    They show which measurements contradict all others.
    """

    values: np.ndarray  # (m, c): errors
    # (m, c, 9): their derivative with respect to the first nine parameters of the sensor
    design: np.ndarray
    # (m, c, c): covariance of the errors that the uncertain direction of gravity causes; zero for
    # poses
    spread: np.ndarray

    def sizes(self):
        """Return the norm of each error, (m,), after a robust fit of nine parameters.

        The fit is to all errors; its parameters are the first nine of the sensor, such as its scale
        factors. An error that is still large after the fit belongs to a pose or a rotation that
        contradicts all others.
        """
        y, rows = self.values.ravel(), self.design.reshape(-1, 9)
        p = fit_robustly(lambda p: y + rows @ p, lambda p: rows, np.zeros(9))
        return np.linalg.norm(self.values + self.design @ p, axis=1)


def fit_robustly(residuals, derivative, start):
    """Return the parameters, (p,), of a least-squares fit that a few large residuals hardly change.

    The soft-L1 loss is quadratic for residuals below `SOFT_L1_SCALE` and linear for larger ones.
    `residuals` is a function of the parameters that returns the n residuals, (n,), and `derivative`
    one that returns their Jacobian, (n, p). The fit begins at the parameters `start`, (p,).
    """
    options = {"loss": "soft_l1", "f_scale": SOFT_L1_SCALE, "x_scale": "jac"}
    return least_squares(residuals, start, derivative, **options).x


def inverse_root(jacobian):
    """Return a root R of the covariance of p parameters, ``R Rᵀ = (Jᵀ J)⁻¹``, (p, p).

    J, `jacobian`, is the Jacobian of n residuals with variance one, (n, p). In directions of the
    parameters that J does not determine R is large but finite: singular values of J below `UNSEEN`
    times the largest one are raised to this value.
    """
    # columns of one length, so that the units of the parameters do not matter
    size = np.linalg.norm(jacobian, axis=0)
    size[size == 0] = 1.0
    # rows of zeros do not change Jᵀ J, and give p singular values even if there are fewer than p
    # residuals
    padded = np.concatenate([jacobian / size, np.zeros((len(size),) * 2)])
    _, values, axes = np.linalg.svd(padded, full_matrices=False)
    return axes.T / np.maximum(values, UNSEEN * (values[0] or 1.0)) / size[:, None]


def fit_gravity_norm(f):
    """Return the accelerometer's nine parameters that make the norm of gravity right at n poses.

    The fit is robust: a few poses with large errors hardly change it. A wide prior keeps parameters
    that the poses do not determine near the data sheet. `f` is the mean specific force at the
    poses, in units of gravity, (n, 3).

    Returns
    -------
    ndarray, shape (9,)
        Three elements of the misalignment T, the scale factors K, and the bias b in units of
        gravity.
    ndarray, shape (9, 9)
        A root R of their covariance ``R Rᵀ``.
    """
    n, prior, start = len(f), np.eye(9) / LOOSE, NOMINAL[:9]

    def linearise(x):
        """Return the errors of the norm, (n,), and their Jacobian, (n, 9), at parameters `x`."""
        sensor = State(np.append(x, NOMINAL[9:])).sensor("accelerometer")
        rows = gravity_norm(sensor, f, 1.0, np.zeros((n, 3, 0)))
        return rows.residual, rows.jacobian[:, 0]

    # the loss has the scale of the residuals, to which the prior's standard deviations are scaled
    x = fit_robustly(
        lambda x: np.append(linearise(x)[0], SOFT_L1_SCALE * prior @ (x - start)),
        lambda x: np.concatenate([linearise(x)[1], SOFT_L1_SCALE * prior]),
        start,
    )
    residual, jacobian = linearise(x)
    # standard deviation of n - 9 degrees of freedom by the median size, which is 0.67 of it
    std = np.median(np.abs(residual)) / 0.67 * np.sqrt(n / max(n - 9, 1))
    return x, std * inverse_root(np.concatenate([jacobian, std * prior]))


def sensor_errors(sensor, recording):
    """Return the Errors of a sensor in a Recording: of its n poses or of its m rotations.

    `sensor` is the name of the sensor, and `recording` the Recording. For the accelerometer the
    Errors are the errors of the norm of gravity at the n poses, in units of gravity, after a fit of
    its nine parameters. For the gyroscope the Errors are those of the m rotations, rad, with the
    nominal misalignment T and scale factors K. A rotation carries the direction of gravity from one
    pose to the next. Its error has two components, both across the direction of gravity that the
    accelerometer measures at the next pose. The bias in a rotation is taken as the mean angular
    rate at both poses, because the bias may drift.
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
    # the first n residuals are the norms of gravity, the next 3 n the rates at the poses
    if sensor == "accelerometer":
        values, jacobian = linearised.residual[:n], linearised.jacobian[:n]
        spread = np.zeros((n, 1, 1))
        return Errors(values=values[:, None], design=jacobian[:, None, :9], spread=spread)
    values = linearised.residual[4 * n :].reshape(-1, 2)
    jacobian = linearised.jacobian[4 * n :].reshape(len(moves), 2, COUNT)
    # root of the covariance by the uncertain directions of gravity
    by_force = jacobian[..., BASE["accelerometer"]] @ root
    # without the bias, the last of the gyroscope's parameters
    design = jacobian[..., BASE["gyroscope"]][..., :9]
    return Errors(values=values, design=design, spread=by_force @ by_force.swapaxes(1, 2))


def sensors_work(poses):
    """Return whether both sensors have values at all poses: specific force not zero, rate finite.

    `poses` are the Poses. The result is false if there are none.
    """
    norm = np.linalg.norm(poses.f, axis=1)
    return len(norm) > 0 and bool(np.all(norm > 0) and np.isfinite(poses.w).all())


def odd_turns(recording):
    """Return which of the m rotations of a Recording contradict all others, and all their errors.

    `recording` is the Recording. The first result is a mask, (m,). The second has the size of the
    error of each rotation, rad, (m,), after a robust fit of the gyroscope to all rotations. A
    rotation is called odd, and contradicts all others, if its error is larger than each of these:

    - `TURN`;
    - `TIMES` the median of all errors;
    - `TIMES` the standard deviation that undersampling, missing samples, jitter and the uncertain
      direction of gravity give this error.

    Exception: the mask is false everywhere if there are fewer than `FEWEST` rotations, if a sensor
    has no values at a pose, or if there are two or more odd rotations and these are more than
    `SHARE` times m. In the first two cases all sizes are zero.
    """
    rotations = recording.rotations
    if len(rotations) < FEWEST or not sensors_work(recording.poses):
        return np.zeros(len(rotations), dtype=bool), np.zeros(len(rotations))
    turns = sensor_errors("gyroscope", recording)
    errors = turns.sizes()
    # traces of the covariance of each error; sampling adds one for each part of a rotation
    by_part = rotations.aliasing_covariance + rotations.time_covariance
    by_sampling = np.trace(by_part.sum(axis=1), axis1=1, axis2=2)
    std = np.sqrt(np.trace(turns.spread, axis1=1, axis2=2) + by_sampling)
    odd = errors > np.maximum(TIMES * np.maximum(np.median(errors), std), TURN)
    return odd & (odd.sum() <= max(1, SHARE * len(odd))), errors


def find_change(errors, fewest, least):
    """Return the index k of the first error after a sensor changed; None if it did not change.

    For each k, the errors are divided in two parts: those before k, and those from k on. The
    parameters of the sensor are fitted to one part and predict the errors of the other part. The
    sensor may have changed at k if at least the fraction `MOST` of the predictions contradict the
    errors. Several k may qualify. First those are dropped whose fit has residuals with a standard
    deviation of more than `UNEVEN` times the smallest one. Of the k that remain, the result is the
    one whose fit uses the most errors.

    Parameters
    ----------
    errors : Errors
        Errors of poses, or of rotations, in order of time.
    fewest : int
        Fewest poses or rotations that determine the parameters.
    least : float
        Least difference of an error from its prediction, in the unit of `errors`, that can
        contradict the prediction.
    """
    n, splits = len(errors.values), []
    # without enough large errors, no part can contradict the other
    if np.sum(errors.sizes() > least) < CHANGED * MOST:
        return None
    for k in range(CHANGED, n - CHANGED + 1):
        before = np.arange(n) < k
        for fitted in (before, ~before):
            if fitted.sum() >= max(fewest, LONG * n):
                residual, contradicting = _predict_others(errors, fitted, least)
                if contradicting >= MOST:
                    splits.append((residual, fitted.sum(), k))
    smallest = min(splits, default=[0.0])[0]
    chosen = [(count, k) for residual, count, k in splits if residual <= UNEVEN * smallest]
    return max(chosen)[1] if chosen else None


def _predict_others(errors, fitted, least):
    """Return two numbers that tell how well a fit to some errors of a sensor predicts all others.

    The nine parameters of a sensor are fitted to the Errors `errors` that the mask `fitted`, (m,),
    chooses, and predict the other errors. The first result is the standard deviation of the
    residuals of the fit. The second is the fraction of the other errors that contradict the
    prediction: their difference from the prediction is larger than `least`, and larger than `TIMES`
    its own standard deviation.
    """
    jacobian, y = errors.design[fitted].reshape(-1, 9), errors.values[fitted].ravel()
    root = inverse_root(jacobian)
    # least-squares solution of J p = -y
    p = -root @ (root.T @ (jacobian.T @ y))
    std = np.sqrt(np.sum((y + jacobian @ p) ** 2) / (len(y) - len(p)))
    design = errors.design[~fitted]
    predicted = errors.values[~fitted] + design @ p
    # covariance by noise, by the error of p, and by uncertain directions of gravity
    by_p = design @ root
    noise = std**2 * (np.eye(design.shape[1]) + by_p @ by_p.swapaxes(1, 2))
    # without noise a covariance may be zero
    inverse = np.linalg.pinv(noise + errors.spread[~fitted])
    distance = np.einsum("mc,mcd,md->m", predicted, inverse, predicted)
    contradicts = (distance > TIMES**2) & (np.linalg.norm(predicted, axis=1) > least)
    return std, contradicts.mean()


def change_of_sensor(sensor, recording):
    """Return the time, s, at which a sensor changed, and a sentence on the change, or None.

    `sensor` is the name of the sensor, and `recording` the Recording. The sentence says which
    measurements contradict each other. The result is None if the sensor did not change, if the
    recording has several sessions, or if it has too few poses (accelerometer) or rotations
    (gyroscope).
    """
    poses, (measurements, part) = recording.poses, WORDS[sensor]
    table = poses if sensor == "accelerometer" else recording.rotations
    # the clocks of two sessions cannot be compared
    if len(table) < PARTS[sensor] + CHANGED or not sensors_work(poses) or np.ptp(poses.session):
        return None
    k = find_change(sensor_errors(sensor, recording), PARTS[sensor], LEAST[sensor])
    if k is None:
        return None
    time = (table.end_s[k - 1] + table.start_s[k]) / 2
    sentence = (
        f"{part} changed at about {time:.4g} s: the {k} {measurements} before contradict the "
        f"{len(table) - k} after; was its range, scale, mounting or clock changed there, or were "
        "logs joined? Calibrate one part: time_range"
    )
    return time, sentence


def why_changed(sensor, recording):
    """Return a sentence on when a sensor changed during a Recording, and on the evidence, or None.

    `sensor` is the name of the sensor, and `recording` the Recording. The result is None if no
    change can be shown.
    """
    time_and_text = change_of_sensor(sensor, recording)
    return time_and_text and time_and_text[1]
