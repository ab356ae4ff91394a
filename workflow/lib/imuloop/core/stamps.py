"""Scattering time stamps: whether the samples were taken at these times."""

import numpy as np

from imuloop.core.gaps import gap_limit

# standard errors by which samples have to follow their stamps
SURE = 4.0


class Scatter:
    r"""Scatter of the stamps about even steps: whether the angular rate goes with it.

    With the lateness :math:`e_k = t_k - k T` of a stamp and slopes s, s' of the angular rate w,
    each from its own samples so that their noise does not enter,

    .. math:: \beta = \frac{\sum (w_k - (w_{k-1} + w_{k+1})/2)\,d_k s'_k}{\sum d_k^2 s_k s'_k},
        \quad d_k = e_k - (e_{k-1} + e_{k+1})/2

    is 1 where the sensor was sampled at the stamps, 0 where it was sampled evenly and stamped
    late. Steps over lost samples do not count.

    Parameters
    ----------
    step : float
        Usual step, s.
    grid : float, optional
        Width of the grid that the stamps are on, s: steps are longer by so much at most.
    """

    def __init__(self, step, grid=0.0):
        self.step, self.longest = step, gap_limit(step) + grid
        self._shared = self._square = self._chance = 0.0

    def add(self, t, w):
        """Take in a part of a log: time, s, shape (n,), and angular rate, rad/s, shape (3, n)."""
        whole = np.diff(t) <= self.longest
        whole = whole[1:] & whole[:-1]
        late = (bend(t) * whole)[2:-2]
        for x in w:
            slope, other = (x[5:-1] - x[1:-5]) / 4, (x[6:] - x[:-6]) / 6
            each = bend(x)[2:-2] * late * (other / self.step)
            self._shared += each.sum()
            self._chance += each @ each
            self._square += (late**2 * slope) @ other / self.step**2

    @property
    def followed(self):
        """Whether β is above a half by more than chance; not where nothing turned."""
        return self._beyond_half(1)

    @property
    def even(self):
        """Whether β is below a half by more than chance; not where nothing turned."""
        return self._beyond_half(-1)

    def _beyond_half(self, sign):
        beyond = sign * (self._shared - self._square / 2)
        return bool(beyond > SURE * np.sqrt(self._chance) and self._square > 0)


def bend(x):
    """Return each sample less the straight line through its neighbours."""
    return x[1:-1] - (x[:-2] + x[2:]) / 2
