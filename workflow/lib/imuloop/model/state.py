"""The state vector: parameters of the accelerometer, of the gyroscope, then of the effects.

All parameters are in nominal SI: they apply to raw readings less the data sheet's offset, times its
scale. A sensor has the misalignment T, the scale factors K and the biases b. The accelerometer
defines the axes of the body, so its T is upper triangular and has three parameters. The T of the
gyroscope has six.
"""

from dataclasses import dataclass

import numpy as np

from imuloop.model.effect import OUTPUT
from imuloop.model.sensor import Sensor

# rows and columns of the elements of T that are parameters
ENTRIES = {
    "accelerometer": ((0, 0, 1), (1, 2, 2)),
    "gyroscope": ((0, 0, 1, 1, 2, 2), (1, 2, 0, 2, 0, 1)),
}
_SCALE_AND_BIAS = ("K0", "K1", "K2", "b0", "b1", "b2")
# names of the parameters of each sensor without its effects
NAMES = {s: (*(f"T{i}{j}" for i, j in zip(*ij, strict=True)), *_SCALE_AND_BIAS)
         for s, ij in ENTRIES.items()}  # fmt: skip
# indices of these parameters in the state
BASE = {"accelerometer": slice(0, 9), "gyroscope": slice(9, 21)}
# number of the parameters of both sensors, and indices of the gyroscope's bias
COUNT, BIAS = 21, slice(18, 21)


@dataclass(frozen=True)
class State:
    """Values of all parameters of both sensors and of their effects, nominal SI.

    `x`, (21 + q,), has the 21 parameters of the sensors and then the q parameters of `effects`, a
    tuple of SensorEffect.
    """

    x: np.ndarray
    effects: tuple = ()

    @property
    def names(self):
        """Names of all parameters, a tuple, such as ``gyroscope.K0``, a scale factor.

        A parameter of an effect has the name of the effect, too: ``gyroscope.g_sensitivity.G00``.
        """
        return tuple(f"{sensor}.{name}" for sensor, name, _ in parameters(self.effects))

    @property
    def units(self):
        """SI units of all parameters, a tuple; an element of T is in rad."""
        return tuple(unit for *_, unit in parameters(self.effects))

    def places(self, sensor):
        """Return the indices in x of the p parameters of one sensor, (p,) of int.

        `sensor` is the name of the sensor. The parameters T, K and b come first, those of its
        effects last.
        """
        counts = [len(effect.parameters) for effect in self.effects]
        owners = np.repeat([effect.sensor == sensor for effect in self.effects], counts)
        base = np.arange(BASE[sensor].start, BASE[sensor].stop)
        return np.append(base, COUNT + np.flatnonzero(owners))

    def sensor(self, sensor):
        """Return the equation of one sensor with the values in x, a Sensor.

        `sensor` is the name of the sensor.
        """
        values, entries, T = self.x[self.places(sensor)], ENTRIES[sensor], np.eye(3)
        # the n off-diagonal elements of T come first, then K, b, and the parameters of the effects
        n = len(entries[0])
        T[entries] = values[:n]
        return Sensor(entries, T=T, K=values[n : n + 3], b=values[n + 3 : n + 6], p=values[n + 6 :])

    def with_effects(self, effects):
        """Return the State with further effects, whose parameters are zero.

        `effects` is a sequence of SensorEffect.
        """
        count = sum(len(e.parameters) for e in effects)
        return State(np.append(self.x, np.zeros(count)), (*self.effects, *effects))


def parameters(effects=()):
    """Return all parameters that a State has, a list of (sensor, name, SI unit).

    The parameters of both sensors come first, then the parameters of the `effects`, a sequence of
    SensorEffect.
    """
    rows = []
    for sensor, names in NAMES.items():
        units = {"T": "rad", "K": "1", "b": OUTPUT[sensor]}
        rows += [(sensor, name, units[name[0]]) for name in names]
    for effect in effects:
        units = effect.units(effect.sensor).items()
        rows += [(effect.sensor, f"{effect.name}.{name}", unit) for name, unit in units]
    return rows
