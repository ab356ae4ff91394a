"""What a sensor's parameters are known to, and what another recording would add to it."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag, cholesky, solve_triangular

from imuloop.calibrate.least_squares import FitResult
from imuloop.calibrate.pose_fits import Solution, as_logged, residuals
from imuloop.core.units import DEGREE

# rate that errors of the gyroscope's output are weighed at, rad/s; the accelerometer's at 1 g
RATE_IN_USE = 100 * DEGREE
# condition number up to which information is inverted
LARGEST = 1e10


@dataclass(frozen=True)
class Information:
    """What is known of a sensor's parameters: the inverse of their covariance, (p, p), SI.

    Of what calibration.json holds that covariance is its own, whatever recording shows it, and so
    are the standard errors, `held`. Of the rest it is that of the poses at hand, zero where these
    say nothing. The solution is what the residuals of the AccelerometerPoses or GyroscopePoses
    are linear about; its parameters come first. Excess is the reduced chi square by which the
    variances of a recording are multiplied, at least 1.
    """

    model: object
    solution: Solution
    names: tuple[str, ...]
    held: dict
    matrix: np.ndarray
    recorded: np.ndarray | float = 0.0  # what the poses at hand say alone
    excess: float = 1.0

    @classmethod
    def of(cls, model, solution, calibration, recording):
        """Return what a Calibration and a recording, of which there may be none, say of a sensor.

        Takes the sensor's model and its fit to the poses, None where these determine none.
        """
        own, excess = getattr(calibration, model.sensor), 1.0
        fitted = [e for e in own.effects if solution and e.effect in solution.effects]
        if solution is None and model.sensor == "gyroscope":
            # effects from elsewhere may need channels that a plan has not
            model = replace(model, accelerometer=replace(calibration.accelerometer, effects=()))
        elif solution and solution.fit.dof > 0:
            excess = max(1.0, solution.fit.reduced_chi2)
        x = np.concatenate([as_logged(own, model.names), *(e.vector for e in fitted)])
        fit = FitResult(x, np.full((len(x),) * 2, np.inf), np.nan, 0, np.zeros((0, len(x))), x[:0])
        about = Solution(tuple(e.effect for e in fitted), fit, own)
        held, covariance = held_by(own)
        names = (*model.names, *(f"{e.name}.{p}" for e in fitted for p in e.effect.parameters))
        names += tuple(name for name in held if name not in names)
        recorded = np.zeros((len(names),) * 2)
        # a pose without specific force, as of a channel scaled to nothing, has no direction
        felt = np.linalg.norm(recording.poses.f, axis=1) > 0
        if len(recording.poses) and len(recording.rotations) and felt.all():
            recorded = of_recording(model, about, recording, len(names)) / excess
        matrix = combined(names, held, covariance, recorded)
        std = dict(zip(held, np.sqrt(np.diag(covariance)).tolist(), strict=True))
        return cls(model, about, names, std, matrix, recorded, excess)

    def std(self, more=None):
        """Return standard errors by name, with more information; None where unknown."""
        total = self.matrix if more is None else self.matrix + more
        found = dict.fromkeys(self.names) | self.held
        seen = np.diag(total) > 0
        total = total[np.ix_(seen, seen)]
        size = np.sqrt(np.diag(total))
        scaled = total / np.outer(size, size)
        if len(size) and np.linalg.cond(scaled) <= LARGEST:
            after = np.sqrt(np.diag(np.linalg.inv(scaled))) / size
            found |= zip(np.array(self.names)[seen].tolist(), after.tolist(), strict=True)
        return found if more is not None else found | self.held

    def with_recording(self, recording):
        """Return standard errors by name with another recording, of independent noise."""
        more = of_recording(self.model, self.solution, recording, len(self.names))
        return self.std(more / self.excess)


def held_by(own):
    """Return names and covariance, SI as logged, of all that a SensorCalibration holds.

    Effects that come from another record than its parameters have standard errors alone.
    """
    more = {f"{e.name}.{p}": s for e in own.effects for p, s in e.std.items() if s > 0}
    more = {name: std for name, std in more.items() if name not in own.names}
    unit = {"K": 1 / own.raw_unit.scale, "b": own.raw_unit.scale}
    factor = [1.0 if "." in name else unit.get(name[0], 1.0) for name in own.names]
    covariance = np.zeros((0, 0)) if own.covariance is None else own.covariance
    covariance = covariance * np.outer(factor, factor)
    return (*own.names, *more), block_diag(covariance, np.diag(np.square([*more.values()])))


def combined(names, held, covariance, recorded):
    """Return the information on parameters by name, (p, p): of what is held C⁻¹, its covariance's.

    Of the rest that of a recording, (p, p), which leaves open what is held; what both say of each
    other is left out.
    """
    known = np.isin(names, held)
    at = [list(names).index(name) for name in held]
    matrix = np.zeros((len(names),) * 2)
    matrix[np.ix_(at, at)] = _inverse(covariance)
    across, own = recorded[np.ix_(~known, known)], recorded[np.ix_(known, known)]
    rest = recorded[np.ix_(~known, ~known)] - across @ _inverse(own) @ across.T
    matrix[np.ix_(~known, ~known)] = rest
    return matrix


def _inverse(matrix):
    """Return the inverse of a covariance or an information; zero of what has none."""
    size = np.sqrt(np.diag(matrix))
    size[size == 0] = 1.0
    size = np.outer(size, size)
    return np.linalg.pinv(matrix / size, rcond=1 / LARGEST, hermitian=True) / size


def of_recording(model, solution, recording, count=0):
    """Return ``Jᵀ Σ⁻¹ J`` of a recording about a solution, (p, p), of `count` parameters at least.

    What the model does not have is zero.
    """
    _, jacobian = residuals(model.model(solution, recording), solution.fit.x)
    root = cholesky(model.covariances(solution, recording)(model.noise), lower=True)
    white = solve_triangular(root, jacobian, lower=True)
    rest = np.zeros((max(0, count - jacobian.shape[1]),) * 2)
    return block_diag(white.T @ white, rest)
