"""Information on a device's parameters, and what another recording would add."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from imuloop.calibrate.calibrated_pair import CalibratedPair
from imuloop.calibrate.sensor_pair import OfSensor
from imuloop.core.samples import SENSORS
from imuloop.core.units import DEGREE

# rate that errors of the gyroscope's output are weighed at, rad/s; the accelerometer's at 1 g
RATE_IN_USE = 100 * DEGREE
# condition number up to which information is inverted
LARGEST = 1e10
# share of a direction of which nothing is known, from which on a parameter is not known either
UNKNOWN = 1e-6


@dataclass(frozen=True)
class Information:
    """What is known of the parameters of both sensors: the inverse of their covariance, SI.

    Of what calibration.json holds that covariance is its own, whatever recording shows it. Of the
    rest it is that of the recording at hand, zero where this says nothing.

    Attributes
    ----------
    about : CalibratedPair
        The final calibration, which residuals are linear about.
    matrix : ndarray, shape (p, p)
        The information.
    excess : dict of str to float
        Reduced chi square of each sensor's residuals at the poses, at least 1: the variances of a
        recording are so many times those of the noise.
    recorded : ndarray, shape (p, p), or None
        What the recording at hand says alone.
    """

    about: CalibratedPair
    matrix: np.ndarray
    excess: dict
    recorded: np.ndarray | None = None

    @classmethod
    def of(cls, diagnosed):
        """Return what a Diagnosed knows."""
        calibration, recording = diagnosed.calibration, diagnosed.recording
        solution = diagnosed.poses.solution
        held = {OfSensor(e.effect, s) for s in SENSORS for e in getattr(calibration, s).effects}
        # effects from elsewhere may need channels that a plan has not
        effects = [e for e in solution.effects if e in held] if solution else []
        about = CalibratedPair.of(calibration, diagnosed.noise, calibration.gravity, effects)
        reduced = solution.reduced_chi2 if solution else {}
        excess = {owner: max(1.0, chi2 or 1.0) for owner, chi2 in reduced.items()}
        known, recorded = cls(about, np.zeros((len(about.names),) * 2), excess), None
        # a pose without specific force, as of a channel scaled to nothing, has no direction
        felt = np.linalg.norm(recording.poses.f, axis=1) > 0
        if len(recording.poses) and len(recording.rotations) and felt.all():
            recorded = known.of_recording(recording)
        matrix = combined(about.covariance, known.matrix if recorded is None else recorded)
        return replace(known, matrix=matrix, recorded=recorded)

    def std(self, more=None):
        """Return standard errors by name, with more information; None where unknown."""
        names = self.about.names
        total = self.matrix if more is None else self.matrix + more
        size = np.sqrt(np.diag(total))
        size[size == 0] = 1.0
        values, axes = np.linalg.eigh(total / np.outer(size, size))
        shown = values > values[-1] / LARGEST
        unknown = (axes[:, ~shown] ** 2).sum(axis=1) > UNKNOWN
        after = np.sqrt((axes[:, shown] ** 2 / values[shown]).sum(axis=1)) / size
        found = dict(zip(names, np.where(unknown, None, after).tolist(), strict=True))
        # of what the calibration holds, now the same to the last digit
        held = np.sqrt(np.diag(self.about.covariance)).tolist()
        for name, size in zip(names, held, strict=True):
            if size > 0 and (more is None or found[name] is None):
                found[name] = size
        return found

    def of_recording(self, recording):
        """Return ``Jᵀ Σ⁻¹ J`` of another recording, (p, p), its noise with the excess."""
        about, matrix = self.about, np.zeros((len(self.about.names),) * 2)
        _, jacobian = about.model(recording).residuals(about.x)
        owners = about.pair.kinds_of_rows(recording)[1]
        size = np.sqrt([self.excess.get(owner, 1.0) for owner in owners])
        root = cholesky(about.noise(recording), lower=True)
        white = solve_triangular(root, jacobian / size[:, None], lower=True)
        matrix[: len(about.x), : len(about.x)] = white.T @ white
        return matrix


def combined(covariance, recorded):
    """Return the information on parameters, (p, p): of what is held C⁻¹, its covariance's.

    Of the rest that of a recording, (p, p), which leaves open what is held; what both say of each
    other is left out.
    """
    known = np.diag(covariance) > 0
    across, own = recorded[np.ix_(~known, known)], recorded[np.ix_(known, known)]
    matrix = np.zeros_like(covariance)
    matrix[np.ix_(known, known)] = _inverse(covariance[np.ix_(known, known)])
    rest = recorded[np.ix_(~known, ~known)] - across @ _inverse(own) @ across.T
    matrix[np.ix_(~known, ~known)] = rest
    return matrix


def _inverse(matrix):
    """Return the inverse of a covariance or an information; zero of what has none."""
    size = np.sqrt(np.diag(matrix))
    size[size == 0] = 1.0
    size = np.outer(size, size)
    return np.linalg.pinv(matrix / size, rcond=1 / LARGEST, hermitian=True) / size
