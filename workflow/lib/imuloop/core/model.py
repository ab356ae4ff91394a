"""The calibration of a device: the model ``x = T (K (raw - b) - e)`` with its parameters."""

from dataclasses import dataclass

import numpy as np

from imuloop.core.effect import Channels, FittedEffect
from imuloop.core.errors import ImuloopError
from imuloop.core.files import read_json, write_json
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, TEMPERATURE, TIME
from imuloop.core.units import RawUnit

# version of the JSON files
FORMAT = 1


@dataclass(frozen=True)
class SensorCalibration:
    """The calibration of one sensor, ``x = T (K (raw - b) - e)``.

    Attributes
    ----------
    raw_unit : RawUnit
        Unit of `raw` and b.
    T : ndarray, shape (3, 3)
        Misalignment, unit diagonal; upper triangular for an accelerometer.
    K : ndarray, shape (3,)
        Scale factor, SI per raw unit.
    b : ndarray, shape (3,)
        Bias, raw units.
    names : tuple of str
        The parameters that were estimated: ``T01``, …, ``K0``, …, ``b0``, … and an effect's.
    covariance : ndarray, shape (p, p)
        Their covariance, in the parameters' own units.
    effects : tuple of FittedEffect
        What adds up to e, SI, on the sensor's own axes.
    method : {'multi_position', 'six_position', 'static', 'nominal'}
        What the parameters come from.
    not_testable : str or None
        Why the data do not determine the full model.
    reduced_chi2 : float or None
        Of the fit, against the noise model.
    """

    raw_unit: RawUnit
    T: np.ndarray
    K: np.ndarray
    b: np.ndarray
    names: tuple[str, ...] = ()
    covariance: np.ndarray | None = None
    effects: tuple[FittedEffect, ...] = ()
    method: str = "nominal"
    not_testable: str | None = None
    reduced_chi2: float | None = None

    @classmethod
    def nominal(cls, raw_unit, not_testable):
        """Return the calibration that the data sheet promises, with the reason for it."""
        scale, offset = np.full(3, raw_unit.scale), np.full(3, raw_unit.offset)
        return cls(raw_unit, np.eye(3), scale, offset, not_testable=not_testable)

    def output(self, values):
        """Return ``K (raw - b)`` of values in SI units as logged, shape (n, 3)."""
        return (self.raw_unit.from_si(values) - self.b) * self.K

    def apply(self, values, channels=None):
        """Return calibrated values.

        Parameters
        ----------
        values : array_like, shape (n, 3)
            SI units, as logged.
        channels : Channels, optional
            What the effects depend on; needed only where there are effects.

        Returns
        -------
        ndarray, shape (n, 3)
            Calibrated, SI.
        """
        output = self.output(values)
        for effect in self.effects:
            output = output - effect.output(channels)
        return output @ self.T.T

    @property
    def std(self):
        """Standard errors of the estimated parameters by name."""
        if not self.names:
            return {}
        return dict(zip(self.names, np.sqrt(np.diag(self.covariance)), strict=True))

    def to_dict(self):
        """Return what the JSON file holds."""
        covariance = np.zeros((0, 0)) if self.covariance is None else self.covariance
        return {
            "raw_unit": self.raw_unit.name,
            "raw_scale": self.raw_unit.scale,
            "raw_offset": self.raw_unit.offset,
            "method": self.method,
            "not_testable": self.not_testable,
            "reduced_chi2": self.reduced_chi2,
            "T": self.T,
            "K": self.K,
            "b": self.b,
            "covariance": {"names": list(self.names), "matrix": covariance},
            "effects": [effect.to_dict() for effect in self.effects],
        }

    @classmethod
    def from_dict(cls, content):
        """Return the calibration that a JSON file holds."""
        return cls(
            raw_unit=RawUnit(content["raw_unit"], content["raw_scale"], content["raw_offset"]),
            T=np.array(content["T"], dtype=float),
            K=np.array(content["K"], dtype=float),
            b=np.array(content["b"], dtype=float),
            names=tuple(content["covariance"]["names"]),
            covariance=np.array(content["covariance"]["matrix"], dtype=float),
            effects=tuple(FittedEffect.from_dict(effect) for effect in content["effects"]),
            method=content["method"],
            not_testable=content["not_testable"],
            reduced_chi2=content["reduced_chi2"],
        )


@dataclass(frozen=True)
class Calibration:
    """The calibration of a device.

    Attributes
    ----------
    device : str
        Name of the device.
    gravity : float
        Local gravity that the accelerometer was calibrated to, m/s^2.
    accelerometer, gyroscope : SensorCalibration
        One for each sensor.
    """

    device: str
    gravity: float
    accelerometer: SensorCalibration
    gyroscope: SensorCalibration

    def apply(self, samples):
        """Return calibrated samples.

        The accelerometer's effects see the gyroscope's output before its own effects; the
        gyroscope's see the calibrated specific force.

        Parameters
        ----------
        samples : DataFrame
            Samples, SI, as ingest writes them.

        Returns
        -------
        DataFrame
            A copy with calibrated specific force (m/s^2) and angular rate (rad/s).
        """
        f, w = samples[list(ACCELERATION)].to_numpy(), samples[list(ANGULAR_RATE)].to_numpy()
        t = samples[TIME].to_numpy()
        temperature = samples[TEMPERATURE].to_numpy() if TEMPERATURE in samples else None
        own, other = self.accelerometer.output(f), self.gyroscope.output(w)
        calibrated = samples.copy()
        f = self.accelerometer.apply(f, Channels(t, own, other, temperature))
        calibrated[list(ACCELERATION)] = f
        calibrated[list(ANGULAR_RATE)] = self.gyroscope.apply(w, Channels(t, other, f, temperature))
        return calibrated

    def to_json(self, path):
        """Write the calibration as JSON."""
        content = {
            "format": FORMAT,
            "device": self.device,
            "gravity": self.gravity,
            "accelerometer": self.accelerometer.to_dict(),
            "gyroscope": self.gyroscope.to_dict(),
        }
        write_json(path, content)

    @classmethod
    def from_json(cls, path):
        """Return the calibration of a JSON file.

        Raises
        ------
        ImuloopError
            If the file is of another format version.
        """
        content = read_json(path)
        if content.get("format") != FORMAT:
            found = content.get("format")
            raise ImuloopError(f"{path}: format {found}, this version reads format {FORMAT}")
        return cls(
            content["device"],
            content["gravity"],
            SensorCalibration.from_dict(content["accelerometer"]),
            SensorCalibration.from_dict(content["gyroscope"]),
        )
