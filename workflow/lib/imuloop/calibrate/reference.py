"""The set-up of a device with a reference, such as motion capture, estimated in one fit.

The set-up is the offset of the clock, the mounting, the place of the marker and the biases. A
window is a short part of a log in which one sensor is compared with the reference.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from imuloop.calibrate.reference_windows import SESSION_STD, Windows
from imuloop.estimate.least_squares import covariance_of


@dataclass(frozen=True)
class SetUp:
    """The fit of the set-up to all windows of both sensors, with a Gaussian prior.

    It has p parameters and n residuals, three for each window.
    """

    windows: tuple[Windows, ...]
    # (p,): the parameters of each session, then the shared parameters of each of the `windows`, SI
    x: np.ndarray
    covariance: np.ndarray  # (p, p): of x
    # (n + p, p + 1): Jacobian at x, and in the last column the residuals. The last p rows are of
    # the prior. Each row is scaled so that its residual has the variance one
    white: np.ndarray
    floor: np.ndarray  # (n,): variance of each residual by the noise alone, SI units squared
    variance: np.ndarray  # (n,): variance of each residual as estimated, SI units squared

    def of_windows(self, values):
        """Return for each of the n residuals a value of its window, (n,).

        `values` is a function that takes the Windows of a sensor and returns a value for each
        window.
        """
        return np.repeat(np.concatenate([values(w) for w in self.windows]), 3)

    def errors(self, folds, without=()):
        """Return the held-out errors of the n residuals in a cross-validation, (n,), SI.

        The held-out error is a residual that is computed with parameters to which its own fold was
        not fitted. This holds for the shared parameters, which are the same for all sessions.
        Exception: the parameters of single sessions, such as a bias, are fitted to all residuals.
        The residuals are taken as linear in x.

        Parameters
        ----------
        folds : ndarray of int, shape (n,)
            Fold of each residual. Residuals of fold -1 are never held out.
        without : sequence of int, optional
            Indices in x of parameters that are set to zero, to see how much the errors grow without
            them.
        """
        jacobian, residual = self.white[:, :-1], self.white[:, -1]
        # the residuals if the parameters `without` are zero, and the Jacobian of the others
        residual = residual - jacobian[:, [*without]] @ self.x[[*without]]
        first_shared = min(w.shared[0] for w in self.windows)
        shared = np.setdiff1d(np.arange(first_shared, len(self.x)), without)
        rows = np.column_stack([jacobian[:, shared], residual])
        # remove the part of each column that the parameters of the sessions can explain
        by_session = np.linalg.qr(jacobian[:, :first_shared])[0]
        rows -= by_session @ (by_session.T @ rows)
        # the rows of the prior, the last ones, belong to fold -1, which all fits use
        fold_of_row = np.append(folds, np.full(len(self.x), -1))
        errors = np.zeros(len(rows))
        for fold in np.unique(folds):
            held_out, used = fold_of_row == fold, (fold_of_row != fold) | (fold_of_row < 0)
            change = np.linalg.lstsq(rows[used, :-1], -rows[used, -1])[0]
            errors[held_out] = rows[held_out, -1] + rows[held_out, :-1] @ change
        return errors[: len(folds)] * np.sqrt(self.variance)


def fit_set_up(windows, noise):
    """Return the SetUp that fits the windows of all sensors best.

    `windows` is a tuple of Windows, one for each sensor, and `noise` the NoiseModel of the device.
    The function sets the attribute `shared` of the Windows: the indices of their shared parameters.
    """
    prior = np.tile(SESSION_STD, len(windows[0].logs))
    for w in windows:
        w.shared, prior = len(prior) + np.arange(len(w.prior)), np.append(prior, w.prior)
    x = np.zeros(len(prior))
    # each round estimates the variances from the residuals of the round before
    for _ in range(4):
        set_up = _fit_round(windows, noise, prior, x)
        x = set_up.x
    return set_up


def _fit_round(windows, noise, prior, start):
    """Return the SetUp of one round of the fit; each round has better weights than the one before.

    The variances of the residuals and their Jacobian are computed at the p parameters `start`, SI,
    (p,), which are the result of the round before. The Jacobian is constant in the fit, because it
    changes little. `windows` is a tuple of Windows, `noise` is a NoiseModel, and `prior` are the
    prior standard deviations of the parameters, SI, (p,).
    """
    floor, residuals = [w.floor(start, noise) for w in windows], [w.values(start) for w in windows]
    variance = np.concatenate([*map(_estimate_variance, residuals, floor)]).repeat(3)
    # the parameters are residuals too, with the standard deviations of the prior
    size = np.append(np.sqrt(variance), prior)
    slope = np.concatenate([*(w.derivative(start) for w in windows), np.eye(len(start))])
    jacobian = slope / size[:, None]

    def white(x):
        """Return the n residuals at `x` and then the p parameters `x`, as one array, (n + p,).

        Each residual is divided by its standard deviation, and each parameter by that of the prior.
        """
        return np.concatenate([*(w.values(x).ravel() for w in windows), x]) / size

    x = least_squares(white, start, lambda x: jacobian, method="lm", x_scale="jac").x
    return SetUp(
        windows=windows,
        x=x,
        covariance=covariance_of(jacobian),
        white=np.column_stack([jacobian, white(x)]),
        floor=np.concatenate(floor).repeat(3),
        variance=variance,
    )


def _estimate_variance(values, floor):
    """Return the variance of a residual in each of m windows, (m,), for the weights of a fit.

    `values` are the residuals, (m, 3). The result is the variance by the noise, `floor`, (m,), plus
    a variance that all windows share. The shared variance is estimated from a median, which
    outliers hardly change: the sum of squares in a window has the median 2.366, that of χ² with
    three degrees of freedom, times the variance. Windows above three standard deviations get a
    larger variance, as by Huber's weights, so that their influence is limited.
    """
    square = (values**2).sum(axis=1)
    variance = floor + max(np.median(square / 2.366 - floor), 0.0)
    deviations = np.sqrt(square / variance / 3)
    return variance * np.maximum(deviations / 3, 1.0)
