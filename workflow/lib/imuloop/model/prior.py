"""What is known of a device before its data: a Gaussian over the parameters of both sensors."""

from dataclasses import dataclass, replace

import numpy as np

from imuloop.core.sensor_calibration import FAR_OFF
from imuloop.model.state import BASE, BIAS, NAMES
from imuloop.sensors import GENERIC, Tolerance

DATA_SHEET = "data sheet"


@dataclass(frozen=True)
class Prior:
    """``x ~ N(mean, covariance)`` of the state without effects, SI as logged.

    Attributes
    ----------
    mean : ndarray, shape (21,)
        Expected parameters.
    covariance : ndarray, shape (21, 21)
        Their covariance.
    sources : dict of str to str
        Of each sensor ``data sheet``, or the file that its prior comes from.
    """

    mean: np.ndarray
    covariance: np.ndarray
    sources: dict

    @property
    def std(self):
        """Standard deviations, shape (21,)."""
        return np.sqrt(np.diag(self.covariance))

    def of(self, sensor):
        """Return mean, (p,), and covariance, (p, p), of the parameters of one sensor."""
        return self.mean[BASE[sensor]], self.covariance[BASE[sensor], BASE[sensor]]

    def with_sensor(self, sensor, source, mean, covariance):
        """Return the same with another source, mean and covariance of one sensor."""
        made = replace(self, mean=self.mean.copy(), covariance=self.covariance.copy())
        made.mean[BASE[sensor]] = mean
        made.covariance[BASE[sensor], BASE[sensor]] = covariance
        return replace(made, sources=self.sources | {sensor: source})

    def with_bias(self, mean, variance):
        """Return the same with another bias of the gyroscope, and its variances, (3,) each."""
        made = replace(self, mean=self.mean.copy(), covariance=self.covariance.copy())
        made.mean[BIAS], made.covariance[BIAS], made.covariance[:, BIAS] = mean, 0.0, 0.0
        made.covariance[BIAS, BIAS] = np.diag(variance)
        return made

    def widened(self, x):
        """Return the same, wider where parameters x, (21,), are beyond `FAR_OFF`: as wide as they.

        Data that contradict the data sheet so clearly are of another unit, range or board.
        """
        far = np.abs(x - self.mean)
        factor = np.where(far > FAR_OFF * self.std, far / self.std, 1.0)
        return replace(self, covariance=self.covariance * np.outer(factor, factor))

    def rows(self):
        """Return R, (21, 21), and z with ``R x - z`` of variance one, ``Rᵀ R`` the precision."""
        size = self.std
        root = np.linalg.cholesky(self.covariance / np.outer(size, size))
        rows = np.linalg.inv(root) / size
        return rows, rows @ self.mean


def data_sheet(tolerances=None):
    """Return the Prior of a data sheet, by default that of a generic device.

    `tolerances` by sensor, the fields of a `Tolerance`, where they are known.
    """
    known = {sensor: Tolerance(**each) for sensor, each in (tolerances or {}).items()}
    mean, std = [], []
    for sensor, names in NAMES.items():
        own = known.get(sensor) or GENERIC[sensor]
        each = {"T": own.misalignment, "K": own.scale_factor, "b": own.bias}
        mean += [float(name[0] == "K") for name in names]
        std += [each[name[0]] for name in names]
    return Prior(np.array(mean), np.diag(np.square(std)), dict.fromkeys(NAMES, DATA_SHEET))
