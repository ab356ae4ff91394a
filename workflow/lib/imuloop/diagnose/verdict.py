"""The verdict on a residual, in the words of the contract."""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

# what a diagnosis holds where nothing could be tested
NOTHING = {
    "residuals": {},
    "effects": [],
    "candidates": [],
    "confounded": [],
    "correlates": [],
}
# held-out error over its floor up to which the floor itself may be wrong
MARGIN = 1.25


@dataclass(frozen=True)
class Judged:
    """What a fit leaves, against the noise, which is known to alternatives only.

    Attributes
    ----------
    p_value : float
        Probability that the noise leaves as much.
    heldout : float
        Probability that the noise gives as large errors of what is held out.
    estimated : float
        The same by the noise as estimated, the first alternative.
    reduced_chi2 : float
        By the noise as estimated.
    """

    p_value: float
    heldout: float
    estimated: float
    reduced_chi2: float

    @classmethod
    def of(cls, weights, found, heldout):
        """Return it of probabilities, χ² and degrees of freedom, and chances, by alternative."""
        chances = [float(chdtrc(dof, square)) for square, dof in found]
        square, dof = found[0]
        averaged = (float(np.dot(weights, each)) for each in (chances, heldout))
        return cls(*averaged, chances[0], square / dof)


def verdict(above_before, above_after, effects):
    """Return the verdict in the contract's words.

    Parameters
    ----------
    above_before, above_after : bool
        Whether a residual is `above_floor`, without the effects and with them.
    effects : sequence
        Those that were added.
    """
    if not effects:
        return "unexplained" if above_before else "consistent"
    return "partly_explained" if above_after else "explained"


def above_floor(judged, share, heldout, floor, chosen):
    """Return whether a residual is larger than the noise explains.

    It is where the fit leaves more than noise and the error of held-out data is above its floor
    too; and where that error is above it by more than a quarter and by more than noise makes it,
    however well the fit went: a model with a wrong effect fits what it was chosen by. Without
    effects, the fit itself has had its test, and a tenth of the significance is left for this one.

    Parameters
    ----------
    judged : Judged
        Of the fit and of held-out data.
    share : float
        Significance.
    heldout, floor : float
        Held-out error, and what the noise alone predicts for it.
    chosen : bool
        Whether there are effects, which the data chose.
    """
    own = share if chosen else share / 10
    beyond = judged.heldout < own and heldout > MARGIN * floor
    return (judged.p_value < share and heldout > floor) or beyond


def unseen(cls, limits, units):
    """Return why these data cannot show an effect at all, or None.

    Parameters
    ----------
    cls : type
        The effect.
    limits : dict of str to float
        Detection limit of each parameter, SI.
    units : dict of str to str
        Unit of each.
    """
    if not limits:
        return "whatever its size, parts that are held out do not confirm it for certain"
    name = min(limits, key=limits.get)
    if not limits[name] > cls.limit:
        return None
    return (
        f"these data would show it from {limits[name]:.2g} {units[name]} on, and {cls.limit:g} is "
        "the most possible"
    )
