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
# held-out error over its floor by which an interval of few parts may be wrong
MARGIN = 1.25


@dataclass(frozen=True)
class Judged:
    """What a fit leaves, against the noise, which is known to alternatives only.

    Attributes
    ----------
    p_value : float
        Probability that the noise leaves as much.
    estimated : float
        The same by the noise as estimated, the first alternative.
    reduced_chi2 : float
        By the noise as estimated.
    """

    p_value: float
    estimated: float
    reduced_chi2: float

    @classmethod
    def of(cls, weights, found):
        """Return it of probabilities, and of χ² and degrees of freedom by each alternative."""
        chances = [float(chdtrc(dof, square)) for square, dof in found]
        square, dof = found[0]
        return cls(float(np.dot(weights, chances)), chances[0], square / dof)


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


def above_floor(in_sample, heldout, floor, ratio=None):
    """Return whether a residual is larger than the noise explains.

    It is where the fit leaves more than noise and the error of held-out data is above its floor
    too; and, with effects, where that error is above it for certain and by more than a quarter,
    however well the fit went: a model with a wrong effect fits what it was chosen by.

    Parameters
    ----------
    in_sample : bool
        Whether χ² of the fit is above its floor.
    heldout, floor : float
        Held-out error, and what the noise alone predicts for it.
    ratio : (float, float), optional
        Interval of the one over the other; None of a model without effects.
    """
    beyond = ratio is not None and ratio[0] > 1 and heldout > MARGIN * floor
    return (in_sample and heldout > floor) or beyond


def unseen(cls, limits):
    """Return why these data cannot show an effect at all, or None.

    Parameters
    ----------
    cls : type
        The effect.
    limits : dict of str to float
        Detection limit of each parameter, SI.
    """
    least = min((v for v in limits.values() if v is not None), default=None)
    if least is None:
        return "whatever its size, parts that are held out do not confirm it for certain"
    if not least > cls.limit:
        return None
    return f"these data would show it from {least:.2g} on, and {cls.limit:g} is the most possible"
