"""Noise with a correlation time."""

from imuloop.core.effect import Effect
from imuloop.effects.axes import per_axis


class GaussMarkov(Effect):
    """``dx_i/dt = -x_i/Tc + q_i·(white noise of density 1)``: noise of correlation time Tc, s.

    No pattern that could be subtracted: a term of the noise, covariance (q² Tc/2) exp(-|d|/Tc),
    which the noise stage finds. It is an effect where it lowers the error by which the next mean is
    foretold. Of several on one axis it is the largest.
    Leaves: a hump of the Allan curve at 1.89 Tc. Imitated by: `sinusoid` where the record holds a
    few periods; flicker.
    """

    name = "gauss_markov"
    parameters = per_axis({"q": "output per sqrt(s)", "tc": "s"})
    equation = "dx_i/dt = -x_i/Tc + q_i·white, x_i added to the output"
    reference = "IEEE Std 952-1997, annex C, exponentially correlated noise"
    records = ("static_record",)
