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
    """A noise coefficient of one axis, SI, such as the density of its white noise.

    `value` is the estimate. If the data do not show the coefficient, `value` is its one-sided 95 %
    upper limit and `limit` is true. If `value` was raised so that N and K bound the Allan variance,
    `raised_from` is the estimate or limit before.
    """

    value: float
    axis: str
    limit: bool
    raised_from: float | None = None

    @property
    def words(self):
        """Text of a comment on the value: its axis, and whether it is a limit or was raised."""
        words = f"{self.axis}, not seen: its 95 % upper limit" if self.limit else self.axis
        if self.raised_from is not None:
            words += f"; raised from {self.raised_from:.3g} so that N and K bound its Allan curve"
            words += f" from {RANGE}"
        return words

    def times(self, factor):
        """Return a copy whose `value` and `raised_from` are multiplied by the number `factor`.

        By it a template scales a Density to what another tool expects.
        """
        raised_from = None if self.raised_from is None else self.raised_from * factor
        return replace(self, value=self.value * factor, raised_from=raised_from)


def estimated(noise, axis, term):
    """Return the Density of a noise coefficient of one axis.

    `noise` is the AxisNoise, `axis` the name of the axis, and `term` the coefficient: N (white
    noise), B (flicker) or K (random walk). It has to have an estimate or a limit.
    """
    coefficient = getattr(noise, term)
    return Density(float(coefficient.size), axis, coefficient.value is None)


def for_filter(noise, axis, term):
    """Return the Density of N or K of one axis, raised so that both bound its Allan variance.

    `noise` is the AxisNoise, `axis` the name of the axis, and `term` is N (white noise) or K
    (random walk). The function `bounding` says how they are raised.
    """
    raw = estimated(noise, axis, term)
    value = dict(zip("NK", bounding(noise), strict=True))[term]
    return raw if value == raw.value else replace(raw, value=value, raised_from=raw.value)


def of_calibrated(sensor, densities):
    """Return the Density of each axis of calibrated samples, a list.

    `sensor` is the SensorCalibration, and `densities` has the Density of each axis of the samples
    as logged. Axis i of the calibrated samples has ``N_i² = Σ_j M_ij² N_j²``, because the noise of
    the axes is independent; the same holds for the other coefficients. M, (3, 3), is the
    misalignment T times the scale factors K over the nominal scale. Densities that bound the Allan
    variance of the samples as logged give densities that bound it for calibrated samples.
    """
    at = [AXES.index(density.axis[-1]) for density in densities]
    M = (sensor.T * sensor.K / sensor.raw_unit.scale)[np.ix_(at, at)]

    def through(values):
        """Return the coefficients of calibrated samples, a list.

        `values` are the coefficients of the samples as logged.
        """
        return np.sqrt(M**2 @ np.square(values)).tolist()

    values = through([d.value for d in densities])
    filtered = through([d.value if d.raised_from is None else d.raised_from for d in densities])
    return [
        replace(d, value=value, raised_from=d.raised_from and bare)
        for d, value, bare in zip(densities, values, filtered, strict=True)
    ]
