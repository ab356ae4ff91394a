"""A sensor's fit to poses, with effects: parameters, calibration, what is left."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from imuloop.calibrate.calibrate import in_raw_units
from imuloop.calibrate.least_squares import Fit
from imuloop.core.effect import Effect
from imuloop.core.model import SensorCalibration
from imuloop.diagnose.residuals import judge
from imuloop.diagnose.trial import Linear


@dataclass(frozen=True)
class Solution:
    """A sensor fitted with some effects.

    Attributes
    ----------
    effects : tuple of Effect
        The effects that were estimated.
    fit : Fit
        Parameters of the base model, then the effects', SI as logged.
    values : ndarray, shape (n,)
        Residuals of the fit, kind after kind.
    covariance : ndarray, shape (n, n)
        Their predicted covariance.
    parts : dict of str to (str, int, slice)
        Kinds of residuals: unit, components and rows.
    calibration : SensorCalibration
        Fitted calibration.
    accelerometer : SensorCalibration
        Calibration that gave the direction of gravity.
    fitted : tuple or None
        Model of the residuals next to the solution, and its parameters there; None if not kept.
    """

    effects: tuple[Effect, ...]
    fit: Fit
    values: np.ndarray
    covariance: np.ndarray
    parts: dict[str, tuple[str, int, slice]]
    calibration: SensorCalibration
    accelerometer: SensorCalibration
    fitted: tuple | None = None

    @cached_property
    def residuals(self):
        """Each kind of residual against its floor, by name; of most fits nobody asks for it."""
        # by the covariance at the solution: the fit's own is that of its last step's weights
        root = cholesky(self.covariance, lower=True)
        white = solve_triangular(root, self.fit.jacobian, lower=True)
        parameters = np.linalg.inv(white.T @ white)
        return {
            kind: judge(
                unit,
                self.values[at].reshape(-1, components),
                self.covariance[at, at],
                self.fit.jacobian[at],
                parameters,
            )
            for kind, (unit, components, at) in self.parts.items()
        }


def linear(values, jacobian, parameters, shapes, kinds, components):
    """Return the `Linear` of residuals whose derivative holds the shapes' columns at its end."""
    widths = [len(shape.parameters) for shape in shapes]
    columns = np.split(jacobian[:, parameters:], np.cumsum(widths)[:-1], axis=1) if shapes else ()
    return Linear(
        values, jacobian[:, :parameters], tuple(shapes), tuple(columns), kinds, components
    )


def fitted_calibration(model, base, fit, effects):
    """Return the calibration of a fit; variances grow with what it leaves unexplained."""
    return in_raw_units(
        model.unit,
        base,
        fit.x,
        fit.scaled_covariance,
        method="multi_position",
        effects=effects,
        known=model.known,
        reduced_chi2=fit.reduced_chi2,
    )


def padded(start, base, effects):
    """Return parameters to start from, those of more effects zero."""
    count = base + sum(len(e.parameters) for e in effects)
    return np.concatenate([start, np.zeros(count - len(start))])


def inside_of(recording, keep):
    """Return which rotations lie between two poses that are kept."""
    first = recording.rotations.first
    return keep[first] & keep[first + 1]


def key_of(effects, poses):
    """Return what tells fits apart."""
    columns = poses.session, poses.start_s, poses.end_s, poses.f
    return tuple(effects), *(np.asarray(c).tobytes() for c in columns)


def size_of(design):
    """Return the root mean square of the vectors of a design, (n, 3, p) to (p,)."""
    return np.sqrt((design**2).sum(axis=1).mean(axis=0))
