"""Multi-position calibration of a gyroscope: its rotations carry gravity from pose to pose."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from imuloop.calibrate.gyroscope_covariance import (
    cross_matrix,
    residual_covariance,
    tangents,
)
from imuloop.calibrate.least_squares import condition_number, fit, too_large
from imuloop.calibrate.poses import Rotations
from imuloop.core.effect import effect_design
from imuloop.core.rotation import exponential, matrix, multiply, prefix_product, step_vectors

# parameters of the base model
NAMES = ("T01", "T02", "T10", "T12", "T20", "T21", "K0", "K1", "K2", "b0", "b1", "b2")
# what data sheets of MEMS gyroscopes allow: misalignment, rad; scale factor, 1
AXES, SCALE = 0.02, 0.03
_OFF_DIAGONAL = ((0, 0, 1, 1, 2, 2), (1, 2, 0, 2, 0, 1))


def unpack(x):
    """Return T (3, 3), K (3,) and b (3,) of the parameters in the order of `NAMES`."""
    T = np.eye(3)
    T[_OFF_DIAGONAL] = x[:6]
    return T, x[6:9], x[9:12]


@dataclass(frozen=True)
class Path:
    """What residuals and covariances take of the attitude C along m rotations.

    Attributes
    ----------
    last : ndarray, shape (m, 3, 3)
        C at the end: takes body axes to those at the start.
    turn : ndarray, shape (m, 3, 12 + p)
        ``∫ C (dw/dx) dt``, the rotation at the start that a change of each parameter makes, rad.
    mean : ndarray, shape (m, 3, 3)
        ``∫ C dt``, s.
    middle : ndarray, shape (m, 3, 3, k - 1)
        C at the middle of each step.
    steps : ndarray, shape (m, k - 1)
        Steps, s.
    added : ndarray, shape (m, 3, 3), or None
        Covariance that the time stamps add, on axes at the start, rad²; None where they are right.
    """

    last: np.ndarray
    turn: np.ndarray
    mean: np.ndarray
    middle: np.ndarray
    steps: np.ndarray
    added: np.ndarray | None = None

    @cached_property
    def spread(self):
        """``∫ c cᵀ dt`` with c the column of C of each axis of the sensor, s, (m, 3, 3, 3)."""
        columns = self.middle.swapaxes(1, 2)
        return (columns * self.steps[:, None, None]) @ columns.swapaxes(2, 3)


@dataclass(frozen=True)
class GyroscopeModel:
    """``w = T (K (y - b) - e)``, from the mean rate of each pose and every rotation between poses.

    Attributes
    ----------
    rate : ndarray, shape (n, 3)
        Mean angular rate of each pose, rad/s as logged.
    rate_design : ndarray, shape (n, 3, p)
        Derivative of e at the poses.
    rotations : Rotations
        Rotations, m of them.
    rotation_design : ndarray, shape (m, k, 3, p)
        Derivative of e along the rotations.
    directions : ndarray, shape (n, 3)
        Unit vector of calibrated specific force at each pose.
    bias : ndarray, shape (3,), or None
        Held at this value, rad/s, instead of estimated.
    rate_known, rotation_known : ndarray, shape (n, 3) and (m, k, 3), or 0
        Part of e that is known, rad/s.
    """

    rate: np.ndarray
    rate_design: np.ndarray
    rotations: Rotations
    rotation_design: np.ndarray
    directions: np.ndarray
    bias: np.ndarray | None = None
    rate_known: np.ndarray | float = 0.0
    rotation_known: np.ndarray | float = 0.0
    # the last path, which depends on no direction: residuals and covariance at one x share it
    _paths: dict = field(default_factory=dict, compare=False, repr=False)

    def start(self):
        """Return parameters to start from: as logged, the mean rate of the poses as bias."""
        bias = self.rate.mean(axis=0) if self.bias is None else self.bias
        effects = np.zeros(self.rate_design.shape[2])
        return np.concatenate([np.zeros(6), np.ones(3), bias, effects])

    def free(self):
        """Return which parameters are estimated, shape (12 + p,)."""
        free = np.ones(12 + self.rate_design.shape[2], dtype=bool)
        free[9:12] = self.bias is None
        return free

    def pose_rates(self, x):
        """Return ``K (y - b) - e`` at the poses, rad/s, zero at rest, and its derivative.

        Returns
        -------
        ndarray, shape (n, 3)
            Residual on the sensor's own axes.
        ndarray, shape (n, 3, 12 + p)
            Derivative.
        """
        _, K, b = unpack(x)
        n = len(self.rate)
        jacobian = np.zeros((n, 3, len(x)))
        axes = np.arange(3)
        jacobian[:, axes, 6 + axes] = self.rate - b
        jacobian[:, axes, 9 + axes] = -K
        jacobian[:, :, 12:] = -self.rate_design
        return K * (self.rate - b) - self.rate_known - self.rate_design @ x[12:], jacobian

    def path(self, x):
        """Return the Path with parameters x."""
        key = np.asarray(x, dtype=float).tobytes()
        if key not in self._paths:
            self._paths.clear()
            self._paths[key] = self._path(x)
        return self._paths[key]

    def _path(self, x):
        T, K, b = unpack(x)
        steps = self.rotations.steps
        m, k = steps.shape
        # an axis after the other, the samples of a rotation side by side
        raw, effects = self._logged - b[:, None, None], self._effects(x)
        output = K[:, None, None] * raw if effects is None else K[:, None, None] * raw - effects
        rates = (T @ output.reshape(3, -1)).reshape(output.shape)
        half = exponential(
            step_vectors(np.moveaxis(rates, 0, -1), steps, self.rotations.uneven) / 2
        )
        after = prefix_product(multiply(half, half))
        # the middle of a step is half a step back from its end
        half[..., 1:] *= -1
        middle = np.moveaxis(matrix(multiply(after, half)), 1, -1)
        # moments of the attitude with what each step turns by, one product a rotation
        factors = [midpoints(raw) * steps, steps[None]]
        factors += [] if effects is None else [midpoints(effects) * steps]
        factors = np.concatenate(factors).transpose(1, 2, 0)
        moments = (middle.reshape(m, 9, k) @ factors).reshape(m, 3, 3, -1)
        of_raw, mean = moments[..., :3], moments[..., 3]
        of_output = K * of_raw if effects is None else K * of_raw - moments[..., 4:]
        turn = np.zeros((m, 3, len(x)))
        rows, columns = _OFF_DIAGONAL
        turn[:, :, :6] = of_output[:, :, rows, columns]
        turn[:, :, 6:9] = np.einsum("maij,ij->maj", of_raw, T)
        turn[:, :, 9:12] = -mean @ (T * K)
        if len(x) > 12:
            entries = middle.transpose(1, 2, 0, 3).reshape(3, 3, m * k)
            seen = (T.T @ entries).reshape(3, 3, m, k).transpose(1, 2, 0, 3)
            turn[:, :, 12:] = -(seen @ self._design_steps.transpose(0, 2, 3, 1)).sum(axis=0)
        return Path(matrix(after[:, -1]), turn, mean, middle, steps, self._added(middle))

    def _added(self, middle):
        """Return the covariance that time stamps add, each error turned by the attitude there."""
        rotations = self.rotations
        if rotations.added is None:
            return None
        attitude = middle[np.arange(len(middle))[:, None], :, :, rotations.added_at]
        return (attitude @ rotations.added @ attitude.swapaxes(2, 3)).sum(axis=1)

    @cached_property
    def _logged(self):
        """Angular rate along the rotations, rad/s as logged, shape (3, m, k)."""
        return np.ascontiguousarray(np.moveaxis(self.rotations.w, -1, 0))

    def _effects(self, x):
        """Return e along the rotations, shape (3, m, k); None where there is none."""
        m, k, _, p = self.rotation_design.shape
        if not p and not np.ndim(self.rotation_known):
            return None
        estimated = (self.rotation_design.reshape(3 * m * k, p) @ x[12:]).reshape(m, k, 3)
        return np.moveaxis(estimated + self.rotation_known, -1, 0)

    @cached_property
    def _design_steps(self):
        """What each parameter of the effects adds in each step, shape (3, p, m, k - 1)."""
        design = np.moveaxis(self.rotation_design, (2, 3), (0, 1))
        return midpoints(design) * self.rotations.steps

    def turned(self, x):
        """Return gravity's direction after each rotation and its derivative.

        With C the attitude, ``u_end = Cᵀ u_start`` and a small change of rate δw gives

            δu_end = Cᵀ (u_start × φ),   φ = ∫ C(t) δw(t) dt

        Returns
        -------
        ndarray, shape (m, 3)
            Predicted direction on the axes at the end.
        ndarray, shape (m, 3, 12 + p)
            Derivative.
        """
        path = self.path(x)
        start = self.directions[self.rotations.first]
        turned = np.einsum("mji,mj->mi", path.last, start)
        return turned, path.last.swapaxes(1, 2) @ (cross_matrix(start) @ path.turn)

    def rotation_errors(self, x):
        """Return the angle between predicted and measured gravity, two components a rotation.

        Returns
        -------
        ndarray, shape (m, 2)
            Error in the plane normal to the measured direction, rad.
        ndarray, shape (m, 2, 12 + p)
            Derivative.
        """
        turned, jacobian = self.turned(x)
        return np.einsum("mij,mj->mi", self.plane, turned), self.plane @ jacobian

    @cached_property
    def plane(self):
        """Two unit vectors normal to the measured direction after each rotation, (m, 2, 3)."""
        return tangents(self.directions[self.rotations.first + 1])

    def residuals(self, x):
        """Return all residuals in one vector, and their derivative."""
        rates, rates_jacobian = self.pose_rates(x)
        errors, errors_jacobian = self.rotation_errors(x)
        residuals = np.concatenate([rates.ravel(), errors.ravel()])
        jacobian = np.concatenate(
            [rates_jacobian.reshape(-1, len(x)), errors_jacobian.reshape(-1, len(x))]
        )
        return residuals, jacobian


def midpoints(values):
    """Return the means of neighbours along the last axis."""
    return (values[..., 1:] + values[..., :-1]) / 2


def seen_only(model, x, keep, inside, rotations):
    """Return the model of some poses and rotations for their covariance with parameters x.

    Parameters
    ----------
    model : GyroscopeModel
        Of n poses and m rotations.
    x : array_like, shape (12 + p,)
        Parameters.
    keep, inside : ndarray of bool, shape (n,) and (m,)
        The poses and the rotations.
    rotations : Rotations
        Those rotations, numbered by these poses.
    """
    path, m = model.path(x), len(rotations)
    # what a covariance takes; the samples themselves would be held once for each part
    nothing = np.zeros((m, 0, 3))
    none = dict.fromkeys(("temperature", "uneven", "added_at", "added"))
    rotations = replace(rotations, t=nothing[..., 0], w=nothing, f=nothing, **none)
    part = Path(
        path.last[inside],
        path.turn[inside],
        path.mean[inside],
        np.zeros((m, 3, 3, 0)),
        nothing[..., 0],
        None if path.added is None else path.added[inside],
    )
    vars(part)["spread"] = path.spread[inside]
    return replace(
        model,
        rate=model.rate[keep],
        rate_design=model.rate_design[keep],
        rotations=rotations,
        rotation_design=np.zeros((m, 0, 3, len(x) - 12)),
        rotation_known=0.0,
        directions=model.directions[keep],
        _paths={np.asarray(x, dtype=float).tobytes(): part},
    )


def fit_gyroscope(
    recording, force, noise, *, effects=(), known=(), bias=None, start=None, prior=None
):
    """Fit the twelve-parameter model, and effects, to pose rates and rotations together.

    Parameters
    ----------
    recording : Recording
        Poses and the rotations between them.
    force : Force
        Calibrated specific force at the poses and along the rotations.
    noise : NoiseModel
        Noise of the device.
    effects : sequence of Effect
        Effects to estimate.
    known : sequence of FittedEffect
        Effects that are known from elsewhere.
    bias : array_like, shape (3,), optional
        rad/s; held instead of estimated.
    start : array_like, optional
        First parameters of a fit with fewer effects, to start from.
    prior : (ndarray, ndarray), optional
        What other data tell of the parameters, as of `least_squares.fit`; not with `bias`.

    Returns
    -------
    Fit, GyroscopeModel, ndarray
        Parameters in the order of `NAMES`, then the effects', SI units as logged (the fit's
        covariance and derivative are without the bias where it is held); the model; the covariance
        of its residuals, rates before rotations.

    References
    ----------
    Tedaldi, Pretto, Menegatti, ICRA 2014, section IV-B; here every rotation at once, with the
    bias and the effects among the parameters and full covariances as weights.
    """
    poses = recording.poses
    model = gyroscope_model(recording, force, None, effects, known, bias)
    x = model.start()
    if start is not None:
        x[: len(start)] = start
    free = model.free()
    # weights need the attitude along the rotations, effects the output: the first fit gives both
    for _ in range(3 if start is None and (effects or known) else 2):
        model = gyroscope_model(recording, force, x, effects, known, bias)
        covariance = residual_covariance(model, x, poses, force.direction_covariance, noise)

        base = x.copy()

        def residuals(values, base=base, model=model):
            full = base.copy()
            full[free] = values
            r, jacobian = model.residuals(full)
            return r, jacobian[:, free]

        result = fit(residuals, x[free], covariance, prior)
        x[free] = result.x
    return replace(result, x=x), model, covariance


def gyroscope_model(recording, force, x=None, effects=(), known=(), bias=None):
    """Return the model of the poses' rates and rotations, its effects seen with parameters x.

    Parameters
    ----------
    recording, force, effects, known, bias
        As of `fit_gyroscope`.
    x : array_like, optional
        Parameters whose K and b give the output that the effects depend on; as logged without.
    """
    _, K, b = (None, 1.0, 0.0) if x is None else unpack(x)
    rotations = recording.rotations

    def output(y):
        return K * (y - b)

    poses = recording.pose_channels("gyroscope", output, force.poses)
    shape, along = rotations.w.shape, None
    if effects or known:
        along = recording.rotation_channels("gyroscope", output, force.rotations)
    return GyroscopeModel(
        rate=recording.poses.w,
        rate_design=effect_design(effects, poses),
        rotations=rotations,
        rotation_design=effect_design(effects, along).reshape(*shape, -1)
        if effects
        else np.zeros((*shape, 0)),
        directions=force.poses / np.linalg.norm(force.poses, axis=1, keepdims=True),
        bias=None if bias is None else np.asarray(bias, dtype=float),
        rate_known=sum(effect.output(poses) for effect in known),
        rotation_known=sum(effect.output(along).reshape(shape) for effect in known),
    )


def untestable_gyroscope(recording, force, largest_condition):
    """Return why the rotations do not determine T and K, or None if they do."""
    reason = undetermined(start_derivative(recording, force), largest_condition)
    return reason and reason + recording.lost.reason


def start_derivative(recording, force):
    """Return the derivative of the rotations' errors at the start of a fit, shape (m, 2, 12)."""
    if not len(recording.rotations):
        return np.zeros((0, 2, 12))
    model = gyroscope_model(recording, force)
    return model.rotation_errors(model.start())[1]


def undetermined(jacobian, largest_condition):
    """Return the same from what `start_derivative` gives."""
    count, needed = len(jacobian), 5
    if count < needed:
        return (
            f"{count} rotations between poses found, at least {needed} needed for the "
            f"9 parameters of misalignment and scale factor"
        )
    condition = condition_number(jacobian.reshape(-1, 12)[:, :9], np.ones(9))
    if condition > largest_condition:
        return (
            f"the axes of {count} rotations do not determine misalignment and scale "
            f"factor: {too_large(condition, largest_condition)}; turn about each axis, both ways, "
            "by 90 degrees and more"
        )
    return None


def lost_gyroscope(fit, rotations, largest_condition):
    """Return why a fit is none, or None if it is one: where it ends nothing is determined.

    Parameters
    ----------
    fit : Fit
        From `fit_gyroscope`.
    rotations : int
        Number of rotations, whose rows are the last.
    largest_condition : float
        Condition number beyond which parameters are called undetermined.
    """
    sizes = np.concatenate([np.ones(6), np.abs(fit.x[6:9])])
    condition = condition_number(fit.jacobian[len(fit.jacobian) - 2 * rotations :, :9], sizes)
    if condition > largest_condition:
        return (
            f"no misalignment and scale factor carries gravity through {rotations} rotations: the "
            f"fit leads to where they determine nothing, {too_large(condition, largest_condition)};"
            " was the angular rate clipped or wrapped around, did scale or axes change midway?"
        )
    std = np.sqrt(np.diag(fit.scaled_covariance)[:9])
    axes, scale = std[:6].max(), np.max(std[6:] / np.abs(fit.x[6:9]))
    if axes > AXES or scale > SCALE:
        return (
            f"{rotations} rotations tell misalignment to {axes:.2g} rad and scale factor to "
            f"{100 * scale:.2g} %, a data sheet to {AXES:g} rad and {100 * SCALE:g} %: they are "
            "too few, or contradict each other; was the angular rate clipped?"
        )
    return None
