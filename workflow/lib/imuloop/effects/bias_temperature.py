"""A bias that follows the temperature."""

from dataclasses import dataclass

import numpy as np

from imuloop.core.effect import Effect
from imuloop.effects.axes import on_each_axis, per_axis
from imuloop.effects.thermometer import CELSIUS, ROOM, span, temperature, whole_degrees

# K; over less a curved line is straight: it leaves its chord by c2 span²/8, 1 % of c1 span with
# c2/c1 = 1/50 per K, the median of twelve axes in two recordings (docs/effects.md)
SPAN_OF_AN_ORDER = 5.0


@dataclass(frozen=True)
class BiasTemperature(Effect):
    """``e_i = Σ_k c_ki (θ - θ0)^k``, k = 1 … order: the bias is a polynomial of the temperature θ.

    Order 3 at most, what thermal calibration of MEMS sensors uses; θ0 is the reference in degC.
    Leaves: a bias that copies θ(t), the same way up as down, on every axis whatever its load.
    Imitated by: a drift and a warm-up where θ only rises or only falls; a thermometer that lags
    and a hysteresis where it turns (these differ on the two branches).
    """

    order: int = 1
    reference_temperature: float = ROOM

    name = "bias_temperature"
    equation = "e_i = Σ_k c_ki (θ - θ0)^k"
    reference = "Niu et al., Sensors 13 (2013) 12192, thermal calibration"
    bounds = {"order": (1, 3), "reference_temperature": CELSIUS}
    needs = ("temperature",)

    @property
    def parameters(self):
        """Names and units, first all axes of order 1."""
        powers = {f"c{k}": f"output per K^{k}" for k in range(2, self.order + 1)}
        return per_axis({"c1": "output per K"} | powers)

    @classmethod
    def shapes(cls, channels):
        """Return orders 1 to 3, as many as the span of temperature can carry."""
        if not span(channels):
            return (cls(),)
        orders = 1 + min(2, int(span(channels) / SPAN_OF_AN_ORDER))
        return tuple(cls(k, whole_degrees(channels)) for k in range(1, orders + 1))

    def design(self, channels):
        """Return the powers of the temperature on each axis, shape (n, 3, 3 order)."""
        warmer = temperature(channels) - self.reference_temperature
        return on_each_axis(*(warmer**k for k in range(1, self.order + 1)))

    def held(self, design, low, high):
        """Return the powers of a temperature that is held: an even one has but one end."""
        first = super().held(design[:, :, :3], low[:3], high[:3])
        return np.concatenate([first**k for k in range(1, self.order + 1)], axis=2)
