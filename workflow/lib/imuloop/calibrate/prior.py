"""What is known of a device before its data: a Gaussian over the parameters of both sensors."""

from dataclasses import dataclass, replace

import numpy as np

from imuloop.calibrate import accelerometer, gyroscope
from imuloop.core.sensor_calibration import FAR_OFF
from imuloop.sensors import GENERIC, Tolerance

# parameters of both base models
BASES = {"accelerometer": accelerometer.NAMES, "gyroscope": gyroscope.NAMES}
DATA_SHEET = "data sheet"


@dataclass(frozen=True)
class SensorPrior:
    """The prior of one sensor, ``x ~ N(mean, covariance)``, SI as logged.

    Attributes
    ----------
    source : str
        ``data sheet``, or the file that it comes from.
    mean : ndarray, shape (p,)
        Expected parameters, in the order of `BASES`.
    covariance : ndarray, shape (p, p)
        Their covariance.
    """

    source: str
    mean: np.ndarray
    covariance: np.ndarray

    @classmethod
    def data_sheet(cls, sensor, tolerance=None):
        """Return the prior of a sensor with a `Tolerance`, `GENERIC` by default."""
        names, given = BASES[sensor], tolerance or GENERIC[sensor]
        each = {"T": given.misalignment, "K": given.scale_factor, "b": given.bias}
        std = np.array([each[name[0]] for name in names])
        mean = np.array([float(name[0] == "K") for name in names])
        return cls(DATA_SHEET, mean, np.diag(std**2))

    @property
    def std(self):
        """Standard deviations, shape (p,)."""
        return np.sqrt(np.diag(self.covariance))

    def widened(self, x):
        """Return the same, wider where parameters x, (p,), are beyond `FAR_OFF`: as wide as they.

        Data that contradict the data sheet so clearly are of another unit, range or board.
        """
        far = np.abs(x - self.mean)
        factor = np.where(far > FAR_OFF * self.std, far / self.std, 1.0)
        return replace(self, covariance=self.covariance * np.outer(factor, factor))

    def rows(self):
        """Return rows R, (p, p), and z with ``R x - z`` of variance one, ``Rᵀ R`` the precision."""
        size = self.std
        root = np.linalg.cholesky(self.covariance / np.outer(size, size))
        rows = np.linalg.inv(root) / size
        return rows, rows @ self.mean


def data_sheets(tolerances=None):
    """Return the SensorPrior of both sensors by name.

    `tolerances` by sensor, the fields of a `Tolerance`, where they are known.
    """
    known = {sensor: Tolerance(**each) for sensor, each in (tolerances or {}).items()}
    return {sensor: SensorPrior.data_sheet(sensor, known.get(sensor)) for sensor in BASES}
