"""A scale factor that follows the temperature."""

from dataclasses import dataclass

from imuloop.core.effect import Effect
from imuloop.effects.axes import on_each_axis, per_axis
from imuloop.effects.thermometer import CELSIUS, ROOM, span, temperature, whole_degrees


@dataclass(frozen=True)
class ScaleTemperature(Effect):
    """``e_i = sT_i (θ - θ0) y_i``: the scale factor is a straight line of the temperature θ.

    θ0 is the reference in degC. Leaves: an error that copies θ(t) on loaded axes alone, so at rest
    on the accelerometer's vertical one, and in a gyroscope's turns.
    Imitated by: `bias_temperature` where the attitude, or the turn, is always the same.
    """

    reference_temperature: float = ROOM

    name = "scale_temperature"
    parameters = per_axis({"sT": "1 per K"})
    equation = "e_i = sT_i (θ - θ0) y_i"
    reference = "Niu et al., Sensors 13 (2013) 12192, thermal calibration"
    bounds = {"reference_temperature": CELSIUS}
    needs = ("temperature",)
    # ten times what data sheets of MEMS sensors state, some 300 ppm/K
    limit = 3e-3

    @classmethod
    def shapes(cls, channels):
        """Return the one shape, about the mean temperature."""
        return (cls(whole_degrees(channels)),) if span(channels) else (cls(),)

    def design(self, channels):
        """Return each axis' own output times the temperature, shape (n, 3, 3)."""
        warmer = temperature(channels) - self.reference_temperature
        return on_each_axis(warmer[:, None] * channels.output)
