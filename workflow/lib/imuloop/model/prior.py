"""The prior of a device: a Gaussian distribution of the parameters of both sensors.

Nominal SI values are raw readings less the data sheet's offset, times its scale.
"""

from dataclasses import dataclass, replace

import numpy as np

from imuloop.model.sensor_calibration import FAR_OFF
from imuloop.model.state import BASE, NAMES
from imuloop.sensors import GENERIC, Tolerance

DATA_SHEET = "data sheet"


@dataclass(frozen=True)
class Prior:
    """``x ~ N(mean, covariance)``, where x are the 21 parameters of both sensors, nominal SI.

    They are the misalignments T, the scale factors K and the biases b of the accelerometer, then
    those of the gyroscope. Parameters of effects have no prior here.

    Attributes
    ----------
    mean : ndarray, shape (21,)
        Expected parameters.
    covariance : ndarray, shape (21, 21)
        Covariance of the parameters.
    sources : dict of str to str
        For each sensor, ``data sheet`` or the file that its prior comes from.
    """

    mean: np.ndarray
    covariance: np.ndarray
    sources: dict

    @property
    def std(self):
        """Standard deviations of the 21 parameters, nominal SI, (21,)."""
        return np.sqrt(np.diag(self.covariance))

    def of(self, sensor):
        """Return the mean, (p,), and the covariance, (p, p), of the p parameters of one sensor.

        These are the misalignment T, scale factors K and biases b of the sensor with the name
        `sensor`.
        """
        return self.mean[BASE[sensor]], self.covariance[BASE[sensor], BASE[sensor]]

    def with_sensor(self, sensor, source, mean, covariance):
        """Return the Prior with another mean and covariance of the p parameters of one sensor.

        `sensor` is the name of the sensor, `source` the file that the values come from, `mean`,
        (p,), the mean and `covariance`, (p, p), the covariance.
        """
        prior = self.with_part(BASE[sensor], mean, covariance)
        return replace(prior, sources=self.sources | {sensor: source})

    def with_part(self, places, mean, covariance):
        """Return the Prior with another `mean`, (p,), and `covariance`, (p, p), of p parameters.

        `places` is the slice of the indices in x of these p parameters. In the result these
        parameters are independent of all other parameters.
        """
        new_mean, new_covariance = self.mean.copy(), self.covariance.copy()
        new_mean[places] = mean
        new_covariance[places] = new_covariance[:, places] = 0.0
        new_covariance[places, places] = covariance
        return replace(self, mean=new_mean, covariance=new_covariance)

    def widened(self, x):
        """Return the Prior with larger standard deviations for parameters that contradict it.

        `x`, (21,), are estimates of the parameters. If an estimate is more than `FAR_OFF` standard
        deviations from the mean, this distance becomes the standard deviation, so that the prior
        does not pull the fit away from the data. Such data must come from another unit, range or
        board than the data sheet describes.
        """
        distance = np.abs(x - self.mean)
        factor = np.where(distance > FAR_OFF * self.std, distance / self.std, 1.0)
        return replace(self, covariance=self.covariance * np.outer(factor, factor))

    def rows(self):
        """Return the matrix R, (21, 21), and z, (21,), with which a fit of x includes the prior.

        The fit adds ``|R x - z|²`` to its sum of squares. If x has the distribution of the prior,
        the components of ``R x - z`` are independent, with mean zero and variance one. So ``Rᵀ R``
        is the inverse of the covariance, and ``R⁻¹ z`` is the mean.
        """
        # the root of the correlations is accurate whatever the units of the parameters
        std = self.std
        root = np.linalg.cholesky(self.covariance / np.outer(std, std))
        rows = np.linalg.inv(root) / std
        return rows, rows @ self.mean


def data_sheet(tolerances=None):
    """Return the Prior that follows from the tolerances of a data sheet.

    `tolerances` is a dict by sensor of dicts with the standard deviations of ``misalignment``,
    ``scale_factor`` and ``bias``, nominal SI. A sensor without an entry gets the tolerances of a
    generic device; so do both sensors if `tolerances` is None. The mean is a sensor without errors,
    and all parameters are independent.
    """
    declared = {sensor: Tolerance(**values) for sensor, values in (tolerances or {}).items()}
    mean, std = [], []
    for sensor, names in NAMES.items():
        sheet = declared.get(sensor) or GENERIC[sensor]
        by_letter = {"T": sheet.misalignment, "K": sheet.scale_factor, "b": sheet.bias}
        mean += [float(name[0] == "K") for name in names]
        std += [by_letter[name[0]] for name in names]
    sources = dict.fromkeys(NAMES, DATA_SHEET)
    return Prior(mean=np.array(mean), covariance=np.diag(np.square(std)), sources=sources)
