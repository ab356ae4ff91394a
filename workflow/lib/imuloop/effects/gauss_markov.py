"""Noise with a correlation time."""

from dataclasses import dataclass
from typing import ClassVar

from imuloop.core.effect import Effect
from imuloop.effects.axes import per_axis


@dataclass(frozen=True)
class GaussMarkov(Effect):
    """``dx_i/dt = -x_i/Tc + q_i·(white noise of density 1)``: noise with a correlation time.

    It has no pattern that could be subtracted: it is a term of the noise, ``covariance
    (q² Tc/2) exp(-|d|/Tc)``, beside white noise, flicker and walk. Leaves: a hump of the Allan
    curve at 1.89 Tc. Imitated by: `sinusoid` where the record holds a few periods; flicker.

    Attributes
    ----------
    tc : float
        Correlation time Tc, s.
    """

    tc: float = 1.0

    name = "gauss_markov"
    parameters: ClassVar = per_axis({"q": "output per sqrt(s)"})
    equation = "dx_i/dt = -x_i/Tc + q_i·white, x_i added to the output"
    reference = "IEEE Std 952-1997, annex C, exponentially correlated noise"
    records = ("static_record",)

    @classmethod
    def shapes(cls, channels):
        """Return none: it has no pattern."""
        return ()
