"""What a sensor's parameters are known to, and what another recording would add to it."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from imuloop.calibrate.least_squares import Fit
from imuloop.calibrate.pose_fits import Solution, residuals


@dataclass(frozen=True)
class Outlook:
    """What is known of a sensor's parameters, and what a recording would add.

    Attributes
    ----------
    model : AccelerometerPoses or GyroscopePoses
        How the sensor is fitted.
    solution : Solution
        About which the residuals are linear.
    information : ndarray, shape (p, p)
        ``Jᵀ Σ⁻¹ J`` of what was recorded; zero of what was not.
    names : tuple of str
        The parameters.
    excess : float
        Reduced chi square by which variances are multiplied, at least 1.
    """

    model: object
    solution: Solution
    information: np.ndarray
    names: tuple[str, ...]
    excess: float = 1.0

    def std(self, *more):
        """Return standard errors by name, of what was recorded and of more; None where unknown."""
        total = self.information + sum(more)
        size = np.sqrt(np.diag(total))
        if not np.all(size > 0):
            return dict.fromkeys(self.names)
        scaled = total / np.outer(size, size)
        if np.linalg.cond(scaled) > 1e10:
            return dict.fromkeys(self.names)
        variance = np.diag(np.linalg.inv(scaled)) / size**2 * self.excess
        return dict(zip(self.names, np.sqrt(variance).tolist(), strict=True))

    def adds(self, recording):
        """Return the information of another recording, of independent noise."""
        return information(self.model, self.solution, recording)


def information(model, solution, recording):
    """Return ``Jᵀ Σ⁻¹ J`` of a recording about a solution, shape (p, p).

    Parameters
    ----------
    model : AccelerometerPoses or GyroscopePoses
        How the sensor is fitted.
    solution : Solution
        Where the derivative is taken.
    recording : Recording
        Poses and rotations.
    """
    _, jacobian = residuals(model.model(solution, recording), solution.fit.x)
    root = cholesky(model.covariance(solution, recording), lower=True)
    white = solve_triangular(root, jacobian, lower=True)
    return white.T @ white


def outlook(model, solution, calibration, force, recording):
    """Return the Outlook of a sensor.

    Parameters
    ----------
    model : AccelerometerPoses or GyroscopePoses
        How the sensor is fitted.
    solution : Solution or None
        Its fit; None where the poses determine none.
    calibration, force : SensorCalibration
        The sensor's and the accelerometer's, to linearise about without a fit.
    recording : Recording
        Poses and rotations, of which there may be none.
    """
    if solution is not None:
        known = information(model, solution, recording)
        reduced = solution.fit.reduced_chi2 if solution.fit.dof > 0 else 1.0
        return Outlook(model, solution, known, solution.calibration.names, max(1.0, reduced))
    x, names = parameters(model.sensor, calibration)
    nothing = np.zeros((0, len(x)))
    fit = Fit(x, np.full((len(x), len(x)), np.inf), np.nan, 0, nothing)
    # effects from elsewhere may need channels that a plan has not
    force = replace(force, effects=())
    start = Solution((), fit, force, calibration)
    known = np.zeros((len(x), len(x)))
    # a pose without specific force, as of a channel scaled to nothing, has no direction
    felt = np.linalg.norm(recording.poses.f, axis=1) > 0
    if len(recording.poses) and len(recording.rotations) and felt.all():
        known = information(model, start, recording)
    return Outlook(model, start, known, names)


def parameters(sensor, calibration):
    """Return the base parameters of a calibration, SI as logged, and their names."""
    upper = sensor == "accelerometer"
    pairs = [(i, j) for i in range(3) for j in range(3) if (i < j if upper else i != j)]
    unit = calibration.raw_unit
    x = np.concatenate(
        [[calibration.T[p] for p in pairs], calibration.K / unit.scale, unit.to_si(calibration.b)]
    )
    return x, (*(f"T{i}{j}" for i, j in pairs), *(f"{p}{i}" for p in "Kb" for i in range(3)))
