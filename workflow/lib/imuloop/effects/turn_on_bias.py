"""A bias that differs each time the device is switched on."""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from imuloop.core.units import DEGREE, STANDARD_GRAVITY
from imuloop.effects.axes import on_each_axis, per_axis
from imuloop.model.effect import Effect

# standard deviation of the bias of a MEMS sensor between power cycles, m/s^2 and rad/s: 20 mg and
# 0.5 deg/s. This is the bias repeatability in the data sheets that state one (ADIS16448,
# ADIS16460), and the initial offset of current phone-grade parts (ICM-42688-P, BMI270)
TURN_ON = {"accelerometer": 20e-3 * STANDARD_GRAVITY, "gyroscope": 0.5 * DEGREE}


@dataclass(frozen=True)
class TurnOnBias(Effect):
    """``e_i = s_ki in power cycle k, Σ_k s_ki = 0``: each power cycle has its own bias.

    A power cycle is a session; a gap that is longer than all recorded time of the session divides
    it into two. The bias of the calibration is the mean over the power cycles, and s_ki is the
    deviation from it on axis i. In a log of another power cycle the effect is zero.
    Leaves this trace: the means over poses change between power cycles only. Imitated by: other
    differences between the power cycles, above all of the temperature.
    """

    runs: int = 2  # number of power cycles, with its name in calibration.json

    name = "turn_on_bias"
    reference = "IEEE Std 1554-2005, bias repeatability"
    needs = ("power_cycle",)
    bounds = {"runs": (2, 50)}

    @property
    def parameters(self):
        """Units of the parameters by name: all axes of the second power cycle, then of the next.

        The deviation in the first power cycle is minus the sum of all others. ``output`` stands for
        the SI unit of the sensor.
        """
        return per_axis({f"s{k}": "output" for k in range(2, self.runs + 1)})

    @classmethod
    def variants(cls, channels):
        """Return the one variant of the effect to try, a tuple.

        It has as many power cycles as the Channels `channels` of the data.
        """
        return (cls(int(channels.power_cycle.max()) + 1),)

    def design(self, channels):
        """Return the derivative of e with respect to s at n points, (n, 3, 3 (runs - 1)).

        e is the error of the class' equation, s are its parameters, and `runs` is the number of
        power cycles. The derivative is 1 in the power cycle of the parameter, -1 in the first power
        cycle, and 0 in all others. It is 0 everywhere if the power cycle is not known. The axes of
        the result are: n points of `channels`, axis of the sensor, parameter.
        """
        if channels.power_cycle is None:
            return np.zeros((len(channels.t), 3, 3 * (self.runs - 1)))
        first = (channels.power_cycle == 0).astype(float)
        return on_each_axis(*((channels.power_cycle == k) - first for k in range(1, self.runs)))

    def repeatability(self, values):
        """Return the standard deviation of the bias over power cycles, (3,), and its 95 % interval.

        Both are in SI and for each axis of the sensor. The interval, (2, 3), has the lower end in
        its first row and the upper end in its second. It follows from the χ² distribution; the
        degrees of freedom are the number of power cycles less one. `values` are the parameters of
        the effect by name, SI.
        """
        # the parameters of all power cycles but the first, which has minus their sum
        others = np.array([values[name] for name in self.parameters]).reshape(-1, 3)
        biases = np.vstack([-others.sum(axis=0), others])
        std, dof = biases.std(axis=0, ddof=1), self.runs - 1
        # ratios of both ends of the interval to the estimate
        ratios = np.sqrt(dof / chdtri(dof, [0.025, 0.975]))
        return std, np.outer(ratios, std)


def turn_on_std(calibration, sensor):
    """Return the standard deviation of each axis' bias between power cycles, SI, a tuple of three.

    It is estimated from the effect `turn_on_bias` if `calibration`, a SensorCalibration, has this
    effect. If not, the value is the usual one in data sheets, `TURN_ON`. `sensor` is the name of
    the sensor.
    """
    for fitted in calibration.effects:
        if isinstance(fitted.effect, TurnOnBias):
            return tuple(fitted.effect.repeatability(fitted.values)[0].tolist())
    return (TURN_ON[sensor],) * 3
