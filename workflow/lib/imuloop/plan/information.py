"""What a sensor's parameters are known to, and what another recording would add to it."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from imuloop.calibrate.least_squares import FitResult
from imuloop.calibrate.pose_fits import Solution, as_logged, residuals
from imuloop.core.units import DEGREE

# rate that errors of the gyroscope's output are weighed at, rad/s; the accelerometer's at 1 g
RATE_IN_USE = 100 * DEGREE


@dataclass(frozen=True)
class Information:
    """What is known of a sensor's parameters: ``Jᵀ Σ⁻¹ J``, (p, p), zero of what was not recorded.

    The residuals of the AccelerometerPoses or GyroscopePoses are linear about the solution. Excess
    is the reduced chi square by which variances are multiplied, at least 1.
    """

    model: object
    solution: Solution
    matrix: np.ndarray
    names: tuple[str, ...]
    excess: float = 1.0

    @classmethod
    def of(cls, model, solution, calibration, force, recording):
        """Return what a recording, of which there may be none, says of a sensor.

        Takes the sensor's model and its fit, None where the poses determine none; then its
        calibration and the accelerometer's are what the residuals are linear about.
        """
        if solution is not None:
            matrix = of_recording(model, solution, recording)
            reduced = solution.fit.reduced_chi2 if solution.fit.dof > 0 else 1.0
            return cls(model, solution, matrix, solution.calibration.names, max(1.0, reduced))
        x = as_logged(calibration, model.names)
        matrix = np.zeros((len(x), len(x)))
        fit = FitResult(x, np.full(matrix.shape, np.inf), np.nan, 0, matrix[:0], x[:0])
        start = Solution((), fit, calibration)
        if model.sensor == "gyroscope":
            # effects from elsewhere may need channels that a plan has not
            model = replace(model, accelerometer=replace(force, effects=()))
        # a pose without specific force, as of a channel scaled to nothing, has no direction
        felt = np.linalg.norm(recording.poses.f, axis=1) > 0
        if len(recording.poses) and len(recording.rotations) and felt.all():
            matrix = of_recording(model, start, recording)
        return cls(model, start, matrix, model.names)

    def std(self, more=0.0):
        """Return standard errors by name, with more information; None where unknown."""
        total = self.matrix + more
        size = np.sqrt(np.diag(total))
        if np.all(size > 0):
            scaled = total / np.outer(size, size)
            if np.linalg.cond(scaled) <= 1e10:
                variance = np.diag(np.linalg.inv(scaled)) / size**2 * self.excess
                return dict(zip(self.names, np.sqrt(variance).tolist(), strict=True))
        return dict.fromkeys(self.names)

    def with_recording(self, recording):
        """Return standard errors by name with another recording, of independent noise."""
        return self.std(of_recording(self.model, self.solution, recording))


def of_recording(model, solution, recording):
    """Return ``Jᵀ Σ⁻¹ J`` of a recording about a solution, shape (p, p)."""
    _, jacobian = residuals(model.model(solution, recording), solution.fit.x)
    root = cholesky(model.covariances(solution, recording)(model.noise), lower=True)
    white = solve_triangular(root, jacobian, lower=True)
    return white.T @ white
