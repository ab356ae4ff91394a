"""A bias that depends on the path of the temperature."""

from dataclasses import dataclass

from imuloop.core.effect import Effect
from imuloop.core.memory import in_pieces, play
from imuloop.effects.axes import on_each_axis, per_axis
from imuloop.effects.thermometer import span, temperature

# half-widths as shares of the span: a loop with steep ends, a rounder one, and one that only just
# closes (at 1/2 no turn of the temperature is long enough to cross it)
SHARES = (0.05, 0.15, 0.4)


@in_pieces
def branch(channels, half_width):
    """Return ``(θ - play θ)/w`` of a whole log, shape (n,): 1 while heating on, -1 cooling on."""
    warm = temperature(channels)
    return (warm - play(warm, half_width, channels.t, channels.past)) / half_width


@dataclass(frozen=True)
class ThermalHysteresis(Effect):
    """``e_i = h_i (θ - play_w θ)/w``: the bias depends on where the temperature θ came from.

    play_w is dragged along between two walls w (the half-width, K) on either side of θ: the bracket
    is 1 while heating goes on, -1 while cooling does, 0 at the log's start, and crosses over within
    2 w of a turning point. At rest it stays. 2 h_i is the opening of the loop.
    Leaves: two branches of bias over temperature. Imitated by: `bias_temperature_rate` where the
    temperature always moves at one speed; `bias_temperature` and `bias_drift` where it never turns.
    """

    half_width: float = 5.0

    name = "thermal_hysteresis"
    parameters = per_axis({"h": "output"})
    equation = "e_i = h_i (θ - play_w θ)/w"
    reference = "Brokate and Sprekels, Hysteresis and Phase Transitions, 1996, play operator"
    bounds = {"half_width": (1e-3, 1e3)}
    needs = ("temperature",)

    @classmethod
    def shapes(cls, channels):
        """Return half-widths that are shares of the span of the temperature, in 10 mK."""
        widths = {max(round(share * span(channels), 2), 0.01) for share in SHARES}
        return tuple(cls(w) for w in sorted(widths)) if span(channels) else (cls(),)

    def design(self, channels):
        """Return the branch on each axis, shape (n, 3, 3)."""
        return on_each_axis(channels.remembered(branch, self.half_width))
