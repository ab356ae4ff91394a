"""An effect: what the base model of bias, scale factor and misalignment lacks."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from imuloop.core.errors import ImuloopError


@dataclass(frozen=True)
class Channels:
    """What an effect may depend on.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Time, s.
    output : ndarray, shape (n, 3)
        The sensor's own output ``K (raw - b)``, SI, on its own axes.
    other : ndarray, shape (n, 3)
        The other sensor's output, SI.
    temperature : ndarray, shape (n,), or None
        Temperature, degC; None where it was not logged.
    """

    t: np.ndarray
    output: np.ndarray
    other: np.ndarray
    temperature: np.ndarray | None = None


class Effect:
    """Base of all effects; a subclass that has a name joins the library by being written.

    An effect adds ``e = Σ_k p_k D_k`` to the sensor's output, SI, on the sensor's own axes, in the
    model ``x = T (K (raw - b) - e)``: D, its derivative, is all that a subclass has to give.

    Attributes
    ----------
    name : str
        Name of the effect, as in results.
    sensors : tuple of str
        The sensors that can have it: ``accelerometer``, ``gyroscope``.
    parameters : tuple of str
        Names of the parameters.
    unit : str
        SI unit of the parameters.
    equation, reference : str
        What the effect adds, and where it is described.
    needs : tuple of str
        Channels without which it cannot be told: ``other``, ``temperature``.
    """

    name: ClassVar[str]
    sensors: ClassVar[tuple[str, ...]]
    parameters: ClassVar[tuple[str, ...]]
    unit: ClassVar[str]
    equation: ClassVar[str]
    reference: ClassVar[str]
    needs: ClassVar[tuple[str, ...]] = ()

    library: ClassVar[dict[str, type]] = {}

    def __init_subclass__(cls, **kwargs):
        super().__init_subclass__(**kwargs)
        Effect.library[cls.name] = cls

    @staticmethod
    def design(channels):
        """Return the derivative of `e` with respect to the parameters.

        Parameters
        ----------
        channels : Channels
            What the effect depends on, n samples.

        Returns
        -------
        ndarray, shape (n, 3, p)
            The derivative D, SI.
        """
        raise TypeError(f"{Effect.__name__} itself adds nothing: a subclass gives its design")


def find_effect(name):
    """Return the effect of that name.

    Raises
    ------
    ImuloopError
        If no effect of that name is in the library.
    """
    if name not in Effect.library:
        known = ", ".join(sorted(Effect.library)) or "none is loaded"
        raise ImuloopError(f"'{name}' is not an effect of the library; known: {known}")
    return Effect.library[name]


@dataclass(frozen=True)
class FittedEffect:
    """An effect with the values of its parameters.

    Attributes
    ----------
    name : str
        Name of the effect in the library.
    values : dict of str to float
        Parameters, SI.
    std : dict of str to float
        Their standard errors, SI.
    """

    name: str
    values: dict
    std: dict

    def output(self, channels):
        """Return what the effect adds to the sensor's output, shape (n, 3), SI."""
        effect = find_effect(self.name)
        return effect.design(channels) @ np.array([self.values[p] for p in effect.parameters])
