"""Both sensors of a device at a calibration: the parameters of their joint fit."""

from dataclasses import dataclass, replace

import numpy as np

from imuloop.calibrate.pair_covariance import PairCovariance
from imuloop.calibrate.raw_units import as_logged, si_factor
from imuloop.calibrate.sensor_pair import BASES, OfSensor, SensorPair, parameters
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.core.samples import SENSORS


@dataclass(frozen=True)
class CalibratedPair:
    """The p parameters of a Calibration, SI as logged, the first of which residuals depend on.

    Attributes
    ----------
    pair : SensorPair
        Of both sensors, all residuals.
    effects : tuple of OfSensor
        What residuals depend on beside misalignment, scale factor and bias.
    names, units : tuple of str
        ``accelerometer.K0``, ``gyroscope.g_sensitivity.G00``: both base models, then the effects,
        then what else the calibration holds; the SI unit of a change, 1 for a scale factor.
    x : ndarray
        Values of the parameters of the base models and the effects.
    covariance : ndarray, shape (p, p)
        That of the calibration, no parameter of one sensor with one of the other; zero of what was
        not estimated.
    """

    pair: SensorPair
    effects: tuple
    names: tuple
    units: tuple
    x: np.ndarray
    covariance: np.ndarray

    @classmethod
    def of(cls, calibration, noise, gravity, effects=None):
        """Return those of a Calibration, with its effects or some OfSensor that it may not hold.

        Takes the NoiseModel and gravity, m/s^2.
        """
        sensors = {name: getattr(calibration, name) for name in SENSORS}
        held = {OfSensor(e.effect, s): e for s, own in sensors.items() for e in own.effects}
        effects = tuple(held if effects is None else effects)
        every = (*effects, *(e for e in held if e not in effects))
        units = {f"{sensor}.{name}": unit for sensor, name, unit in parameters(every)}
        names, covariance = tuple(units), np.zeros((len(units),) * 2)
        for sensor, own in sensors.items():
            # effects that come from another record than the parameters have standard errors alone
            std = {f"{e.name}.{p}": s for e in own.effects for p, s in e.std.items()}
            for name, size in std.items():
                covariance[(names.index(f"{sensor}.{name}"),) * 2] = size**2
            if own.names:
                factor = si_factor(own.names, own.raw_unit)
                at = [names.index(f"{sensor}.{n}") for n in own.names]
                covariance[np.ix_(at, at)] = own.covariance * np.outer(factor, factor)
        base = np.concatenate([as_logged(own, BASES[s]) for s, own in sensors.items()])
        values = [held[e].vector if e in held else np.zeros(len(e.parameters)) for e in effects]
        raw = {sensor: own.raw_unit for sensor, own in sensors.items()}
        pair = SensorPair(noise, gravity, raw, CalibrateSettings(), tuple(SENSORS), base)
        x = np.concatenate([base, *values])
        return cls(pair, effects, names, tuple(units.values()), x, covariance)

    def of_moves(self, quiet):
        """Return the same with the velocities of some moves among the residuals."""
        return replace(self, pair=replace(self.pair, quiet=quiet))

    def model(self, recording, x=None, counted=None):
        """Return the PairModel of a recording.

        At other parameters, and of some residuals alone, where they are given.
        """
        model = self.pair.model_at(self.x if x is None else x, recording, self.effects)
        return model if counted is None else replace(model, counted=counted)

    def noise(self, recording, counted=None):
        """Return the covariance that the noise predicts of residuals, or those that count."""
        model = self.model(recording, counted=counted)
        return PairCovariance(self.x, model, recording).by(self.pair.noise)
