"""Noise coefficients for other tools, each a number, for logged or for calibrated samples."""

from dataclasses import dataclass, replace

import numpy as np

from imuloop.effects.axes import AXES
from imuloop.export.bound import RANGE, bounding

# SI units of the noise coefficients
UNITS = {
    "accelerometer": {"N": "m/s^2/sqrt(Hz)", "B": "m/s^2", "K": "m/s^3/sqrt(Hz)"},
    "gyroscope": {"N": "rad/s/sqrt(Hz)", "B": "rad/s", "K": "rad/s^2/sqrt(Hz)"},
}


@dataclass(frozen=True)
class Density:
    """A noise coefficient, SI, with its axis or channel.

    `value` is the estimate. If the term was not seen, `value` is the one-sided 95 % upper limit and
    `limit` is true. If `value` was raised so that N and K bound the Allan curve, `raised_from` is
    the estimate or limit before.
    """

    value: float
    axis: str
    limit: bool
    raised_from: float | None = None

    @property
    def words(self):
        """The text of a comment on the value: its axis, and whether it is a limit or was raised."""
        words = f"{self.axis}, not seen: its 95 % upper limit" if self.limit else self.axis
        if self.raised_from is not None:
            words += f"; raised from {self.raised_from:.3g} so that N and K bound its Allan curve"
            words += f" from {RANGE}"
        return words

    def times(self, factor):
        """Return the density with value and `raised_from` multiplied by a factor."""
        raised_from = None if self.raised_from is None else self.raised_from * factor
        return replace(self, value=self.value * factor, raised_from=raised_from)


def estimated(noise, axis, term):
    """Return the Density of the coefficient `term`, N, B or K, of an AxisNoise.

    The coefficient has to have an estimate or a limit. `axis` is the name of the axis.
    """
    coefficient = getattr(noise, term)
    return Density(float(coefficient.size), axis, coefficient.value is None)


def for_filter(noise, axis, term):
    """Return the Density of N or K of an AxisNoise, raised so that both bound its Allan curve."""
    raw = estimated(noise, axis, term)
    value = dict(zip("NK", bounding(noise), strict=True))[term]
    return raw if value == raw.value else replace(raw, value=value, raised_from=raw.value)


def of_calibrated(sensor, densities):
    """Return the densities of calibrated samples, a list of Density, one for each axis.

    `sensor` is the SensorCalibration, and `densities` has the Density of each axis as logged.

    Axis i of the calibrated samples has ``N_i^2 = Σ_j M_ij^2 N_j^2``, as the noise of the axes is
    independent. M, (3, 3), is T K over the nominal scale. Values that bound the Allan curves as
    logged become values that bound the curves of calibrated samples.
    """
    at = [AXES.index(density.axis[-1]) for density in densities]
    M = (sensor.T * sensor.K / sensor.raw_unit.scale)[np.ix_(at, at)]

    def through(values):
        """Return the values of the calibrated axes that follow from values as logged, a list."""
        return np.sqrt(M**2 @ np.square(values)).tolist()

    values = through([d.value for d in densities])
    filtered = through([d.value if d.raised_from is None else d.raised_from for d in densities])
    return [
        replace(d, value=value, raised_from=d.raised_from and bare)
        for d, value, bare in zip(densities, values, filtered, strict=True)
    ]
