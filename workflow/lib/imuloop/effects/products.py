"""Products of powers of outputs, which are tested if all other effects leave more than noise."""

import re
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np

from imuloop.effects.axes import AXES
from imuloop.effects.temperature import CELSIUS, ROOM, temperature
from imuloop.model.effect import Effect

# largest total degree
DEGREE = 3
POWERS = ("", "", "²", "³")
# SI unit of each factor by its letter: specific force, angular rate, temperature less a reference
UNITS = {"f": "m/s^2", "w": "rad/s", "θ": "K"}
# letter of the output of each sensor
OUTPUTS = {"accelerometer": "f", "gyroscope": "w"}
_FACTOR = re.compile(r"(θ|[fw]_[xyz])([²³]?)")


@dataclass(frozen=True)
class Product(Effect):
    """``e_i = c_i Π_k x_k^p_k``: one product of powers, such as ``f_y² f_z``, on one axis i.

    c_i is the parameter. A factor x_k is the specific force f or the angular rate w along x, y or
    z, to the power p_k, or the temperature θ less the reference, to the power one. The sum of the
    powers is at most three.
    Leaves a trace that no effect with a known cause leaves. Imitated by: other products. At rest an
    accelerometer shows only the component of e along gravity: f_y² f_z on axis x leaves the same
    trace as f_x f_y f_z on axis y and as f_x f_y² on axis z.
    """

    formula: str = "f_x² f_y"
    axis: str = "x"
    sensor: str = "accelerometer"
    reference_temperature: float = ROOM

    name = "product"
    reference = "a search of this device's residual; no cause is known"
    # the class names no records: the function `products` gives its variants, which are tried after
    # all other effects
    records = ()
    is_formula = True
    bounds = {"reference_temperature": CELSIUS}

    def __post_init__(self):
        """Set `sensors`, `records` and `needs`, which depend on the factors.

        Raises a ValueError if the axis, the sensor or the formula is impossible.
        """
        if self.axis not in tuple(AXES) or self.sensor not in OUTPUTS:
            raise ValueError("it needs an axis and a sensor")
        # at rest the angular rate is zero: only motion shows its products to an accelerometer
        needs_motion = self.sensor == "accelerometer" and "w" in self.formula
        object.__setattr__(self, "sensors", (self.sensor,))
        object.__setattr__(self, "records", ("motion",) if needs_motion else ("poses",))
        # this evaluates `factors`, which raises a ValueError if the formula is not a product
        object.__setattr__(self, "needs", ("temperature",) if "θ" in self.factors else ())

    @cached_property
    def factors(self):
        """Factors of the product, a tuple of texts such as ``f_y``.

        Each is repeated according to its power.
        """
        matches = [_FACTOR.fullmatch(text) for text in self.formula.split(" ")]
        if not all(matches):
            raise ValueError(f"'{self.formula[:60]}' is not a product, as f_y² f_z is")
        # the index of a sign in `POWERS` gives the power; a factor without a sign has the power one
        factors = [m[1] for m in matches for _ in range(POWERS.index(m[2], 1))]
        if len(factors) > DEGREE or factors.count("θ") > 1:
            raise ValueError(f"'{self.formula[:60]}' is of too high a degree")
        return tuple(factors)

    @cached_property
    def parameters(self):
        """Unit of the one parameter, the coefficient c of the product, a dict with its name.

        ``output`` stands for the SI unit of the sensor.
        """
        powers = Counter(UNITS[factor[0]] for factor in self.factors)
        units = [f"({unit})^{p}" if p > 1 else unit for unit, p in powers.items()]
        product = f"({' '.join(units)})" if len(units) > 1 else units[0]
        return {f"c{self.axis}": f"output per {product}"}

    def design(self, channels):
        """Return the derivative of e with respect to c, SI, (n, 3, 1).

        e is the error of the class' equation, and c its single parameter. The derivative is the
        product on the axis of the effect, and zero on both others. The axes of the result are: n
        points of `channels`, axis of the sensor, parameter.
        """
        design = np.zeros((len(channels.t), 3, 1))
        values = np.ones(len(channels.t))
        for factor in self.factors:
            if factor == "θ":
                values = values * (temperature(channels) - self.reference_temperature)
            else:
                is_own = factor[0] == OUTPUTS[self.sensor]
                output = channels.output if is_own else channels.other
                values = values * output[:, AXES.index(factor[2])]
        design[:, AXES.index(self.axis), 0] = values
        return design


def products(sensor, letters, reference_temperature=None):
    """Return all products on each axis of a sensor, a tuple of Product, the lowest degree first.

    Products that are part of bias, scale factor or misalignment are left out.

    Parameters
    ----------
    sensor : str
        Name of the sensor.
    letters : str
        Letters of the outputs that are factors, the sensor's own first: f for specific force, w for
        angular rate.
    reference_temperature : float, optional
        Reference, degC, if the temperature is a factor, too.
    """
    outputs, formulas = [f"{letter}_{axis}" for letter in letters for axis in AXES], []
    # the sensor's own outputs of degree one are scale factor and misalignment
    in_base = [(name,) for name in outputs[:3] if name[0] == OUTPUTS[sensor]]
    for degree in range(1, DEGREE + 1):
        combinations = combinations_with_replacement(outputs, degree)
        formulas += [factors for factors in combinations if factors not in in_base]
        # the temperature alone is an effect with a known cause, `bias_temperature`
        if reference_temperature is not None and degree > 1:
            combinations = combinations_with_replacement(outputs, degree - 1)
            formulas += [("θ", *factors) for factors in combinations]
    effects = []
    for factors in formulas:
        reference = {"reference_temperature": reference_temperature} if "θ" in factors else {}
        effects += [
            Product(formula=formula(factors), axis=axis, sensor=sensor, **reference)
            for axis in AXES
        ]
    return tuple(effects)


def formula(factors):
    """Return the formula of a product: ``f_y² f_z`` for the `factors` f_y, f_y and f_z."""
    return " ".join(f + POWERS[factors.count(f)] for f in dict.fromkeys(factors))
