"""Noise with a correlation time."""

from dataclasses import dataclass

from imuloop.core.effect import Effect
from imuloop.effects.axes import per_axis


@dataclass(frozen=True)
class GaussMarkov(Effect):
    """``dx_i/dt = -x_i/Tc + q_i·(white noise of density 1)``: noise of correlation time Tc, s.

    No pattern that could be subtracted: a term of the noise, covariance (q² Tc/2) exp(-|d|/Tc).
    Leaves: a hump of the Allan curve at 1.89 Tc. Imitated by: `sinusoid` where the record holds a
    few periods; flicker.
    """

    tc: float = 1.0

    name = "gauss_markov"
    parameters = per_axis({"q": "output per sqrt(s)"})
    equation = "dx_i/dt = -x_i/Tc + q_i·white, x_i added to the output"
    reference = "IEEE Std 952-1997, annex C, exponentially correlated noise"
    records = ("static_record",)
