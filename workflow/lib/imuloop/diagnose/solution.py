"""A sensor's fit to poses, with effects: parameters, calibration, what is left."""

from dataclasses import dataclass

import numpy as np

from imuloop.calibrate.calibrate import in_raw_units
from imuloop.core.effect import Effect
from imuloop.core.model import SensorCalibration
from imuloop.diagnose.residuals import Residual
from imuloop.diagnose.trial import Linear


@dataclass(frozen=True)
class Solution:
    """A sensor fitted with some effects.

    Attributes
    ----------
    effects : tuple of Effect
        The effects that were estimated.
    x : ndarray, shape (p,)
        Parameters of the base model, then the effects', SI as logged.
    calibration : SensorCalibration
        Fitted calibration.
    accelerometer : SensorCalibration
        Calibration that gave the direction of gravity.
    chi2, dof : float, int
        Of the whole fit, against the noise model.
    residuals : dict of str to Residual
        Each kind of residual of the sensor, on the data of the fit.
    covariance : ndarray, shape (n, n)
        Predicted covariance of all residuals, kind after kind.
    jacobian : ndarray, shape (n, p)
        Their derivative with respect to all parameters.
    fitted : tuple or None
        Model of the residuals next to the solution, and its parameters there; None if not kept.
    """

    effects: tuple[Effect, ...]
    x: np.ndarray
    calibration: SensorCalibration
    accelerometer: SensorCalibration
    chi2: float
    dof: int
    residuals: dict[str, Residual]
    covariance: np.ndarray
    jacobian: np.ndarray
    fitted: tuple | None = None


def linear(values, jacobian, parameters, shapes, kinds, components):
    """Return the `Linear` of residuals whose derivative holds the shapes' columns at its end."""
    widths = [len(shape.parameters) for shape in shapes]
    columns = np.split(jacobian[:, parameters:], np.cumsum(widths)[:-1], axis=1) if shapes else ()
    return Linear(
        values, jacobian[:, :parameters], tuple(shapes), tuple(columns), kinds, components
    )


def fitted_calibration(model, base, x, parameters, chi2, dof, effects):
    """Return the calibration of a fit; variances grow with what it leaves unexplained."""
    reduced = chi2 / dof if dof > 0 else np.nan
    return in_raw_units(
        model.unit,
        base,
        x,
        parameters * (max(1.0, reduced) if np.isfinite(reduced) else 1.0),
        method="multi_position",
        effects=effects,
        known=model.known,
        reduced_chi2=reduced,
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
