"""An effect: what the base model of bias, scale factor and misalignment lacks."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, fields, replace
from itertools import pairwise
from typing import ClassVar

import numpy as np

from imuloop.core.errors import ImuloopError, did_you_mean

# constants that lie between those of the shapes
FINE = ("tau", "half_width")
# SI unit of each sensor's output
_OUTPUT = {"accelerometer": "m/s^2", "gyroscope": "rad/s"}


@dataclass(frozen=True)
class Channels:
    """What an effect may depend on, at n points: samples, or poses.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Time since the start of the log, s.
    output : ndarray, shape (n, 3)
        The sensor's own output ``K (raw - b)``, SI, on its own axes.
    other : ndarray, shape (n, 3)
        The other sensor's output, SI.
    temperature : ndarray, shape (n,), or None
        Temperature, degC; None where it was not logged.
    history : callable, or None
        See `remembered`; None where the points are samples.
    past : dict, or None
        What functions that remember have kept of the log so far, where it comes in pieces one
        after the other; None where the points are the whole log.
    step : float, or None
        Median step of the whole log, s, where it comes in pieces.
    run : ndarray of int, shape (n,), or None
        Which of the runs of the data, 0, 1, ..., each point lies in; None in a run of its own.
    clamped : dict, or None
        Takes, by name of an effect, at which points it was clamped to its range.
    """

    t: np.ndarray
    output: np.ndarray
    other: np.ndarray
    temperature: np.ndarray | None = None
    history: Callable | None = None
    past: dict | None = None
    step: float | None = None
    run: np.ndarray | None = None
    clamped: dict | None = None

    def remembered(self, function, *constants):
        """Return what depends on the past of the log, at these points, shape (n, …).

        Parameters
        ----------
        function : callable
            Takes the Channels of a whole log and the constants; gives an array whose first axis is
            the log's samples; at a pose their mean over it is taken. Of a log in pieces it gets a
            piece after the other if it is marked as `imuloop.core.memory.in_pieces`, with a dict of
            its own as `past`: empty at the first.
        *constants : hashable
            Constants of the function.

        Raises
        ------
        ImuloopError
            If the log comes in pieces, and the function is not marked for them.
        """
        if self.history is not None:
            return self.history(function, *constants)
        if self.past is None:
            return function(self, *constants)
        if not getattr(function, "in_pieces", False):
            name = function.__name__
            raise ImuloopError(f"{name} needs the whole log: read it and give it to apply")
        past = self.past.setdefault((function, constants), {})
        return function(replace(self, past=past), *constants)


@dataclass(frozen=True)
class Effect:
    """Base of all effects; a subclass that has a name joins the library by being written.

    An effect adds ``e = Σ_k p_k D_k`` to the sensor's output, SI, on the sensor's own axes, in the
    model ``x = T (K (raw - b) - e)``. D, its derivative, is what a subclass gives. Constants that D
    does not depend on linearly (a time constant, an order) are fields of the subclass, then a
    frozen dataclass: an instance is one shape of the effect.

    Attributes
    ----------
    name : str
        Name of the effect, as in results.
    sensors : tuple of str
        The sensors that can have it: both if not said.
    parameters : dict of str to str
        Names of the parameters and their SI units; ``output`` in a unit is that of the sensor.
    equation, reference : str
        What the effect adds, and where it is described.
    needs : tuple of str
        Channels without which it cannot be seen: ``temperature``, ``run``.
    records : tuple of str
        The data in which it is looked for: ``poses``, ``static_record``, ``motion``, ``reference``.
    unobservable : str or None
        Why other data than its `records` cannot show it, if so.
    limit : float
        Largest size of a parameter that is physically possible, SI.
    timed : bool
        Whether it depends on the time since the start of the log, or on what was before.
    reach : float
        How far about a point the effect looks, s; what it remembers besides is in `Channels.past`.
    lasting : bool
        Whether a device that had it in one record has it in the next.
    hidden_by : tuple of str
        Effects without which its own can look like none, as theirs without it.
    bounds : dict of str to (float, float)
        Least and largest value of a constant, where not any number will do.
    """

    name: ClassVar[str]
    sensors: ClassVar[tuple[str, ...]] = ("accelerometer", "gyroscope")
    parameters: ClassVar[dict[str, str]]
    equation: ClassVar[str]
    reference: ClassVar[str]
    needs: ClassVar[tuple[str, ...]] = ()
    records: ClassVar[tuple[str, ...]] = ("poses", "static_record")
    unobservable: ClassVar[str | None] = None
    limit: ClassVar[float] = np.inf
    timed: ClassVar[bool] = False
    reach: ClassVar[float] = 0.0
    lasting: ClassVar[bool] = True
    hidden_by: ClassVar[tuple[str, ...]] = ()
    bounds: ClassVar[dict[str, tuple[float, float]]] = {"tau": (1e-3, 1e7)}

    library: ClassVar[dict[str, type]] = {}

    def in_session(self, channels, session, windows):
        """Return the derivative of means over windows, (n, 2) s, of a session, (n, 3, p)."""
        return self.design(channels)

    def clamped(self, design, low, high):
        """Return a derivative, (n, 3, p), clamped to the ranges of its parameters, (p,) each."""
        # a parameter that an axis does not have is zero there
        return np.where(design == 0, 0.0, np.clip(design, low, high))

    def moved(self, factor):
        """Return the effect whose time constant, or width, is some times as large."""
        constants = [n for n in FINE if hasattr(self, n)]
        return replace(self, **{n: float(factor * getattr(self, n)) for n in constants})

    def together(self, name):
        """Return which parameters a detection limit takes to be as large as one, itself too."""
        return (name,)

    def __init_subclass__(cls, **kwargs):
        super().__init_subclass__(**kwargs)
        Effect.library[cls.name] = cls

    @classmethod
    def shapes(cls, channels):
        """Return the shapes to try for data with these channels; none where it has no design."""
        return () if cls.design is Effect.design else (cls(),)

    def units(self, sensor):
        """Return the SI unit of each parameter for a sensor."""
        output = _OUTPUT[sensor]
        return {name: unit.replace("output", output) for name, unit in self.parameters.items()}

    def design(self, channels):
        """Return D, the derivative of `e` to the parameters at n points, SI, shape (n, 3, p)."""
        raise TypeError(f"{self.name}: {self.unobservable or 'it has no design'}")

    def design_at(self, channels, values):
        """Return D of which ``D p`` is `e` where p is `values`; not `design` if e is not linear."""
        return self.design(channels)


def find_effect(name):
    """Return the class of the effect of that name; an ImuloopError if the library has none."""
    if name not in Effect.library:
        known = ", ".join(sorted(Effect.library)) or "none is loaded"
        hint = did_you_mean(name, Effect.library)
        raise ImuloopError(f"'{name}' is not an effect of the library{hint}; known: {known}")
    return Effect.library[name]


def effect_design(effects, channels, values=()):
    """Return D of the sum of effects, (n, 3, p), at the first of their p parameters, else zero."""
    ends = np.cumsum([0, *(len(e.parameters) for e in effects)])
    x, at = np.append(values, np.zeros(ends[-1] - len(values))), pairwise(ends)
    parts = [e.design_at(channels, x[i:j]) for e, (i, j) in zip(effects, at, strict=True)]
    # one alone, of a search hundreds of products, is no copy
    none = np.zeros((len(channels.t), 3, 0))
    return parts[0] if len(parts) == 1 else np.concatenate([none, *parts], axis=2)


@dataclass(frozen=True)
class FittedEffect:
    """An effect with the values of its parameters.

    Attributes
    ----------
    effect : Effect
        The effect, with its constants.
    values, std : dict of str to float
        Parameters and their standard errors, SI.
    ranges : dict of str to (float, float)
        Least and largest value that the derivative of each parameter had in the data that show the
        effect, SI; it is clamped to them. Empty for an effect that acts everywhere.
    """

    effect: Effect
    values: dict
    std: dict
    ranges: dict = field(default_factory=dict)

    @property
    def name(self):
        """Name of the effect in the library."""
        return self.effect.name

    @property
    def vector(self):
        """Parameters in the order of the effect's derivative, shape (p,), SI."""
        return np.array([self.values[name] for name in self.effect.parameters])

    def output(self, channels):
        """Return what the effect adds to the sensor's output, shape (n, 3), SI."""
        design = self.effect.design_at(channels, self.vector)
        if self.ranges:
            anything = (-np.inf, np.inf)
            ends = [self.ranges.get(name, anything) for name in self.effect.parameters]
            clamped = self.effect.clamped(design, *np.transpose(ends))
            if channels.clamped is not None:
                channels.clamped[self.name] = np.any(clamped != design, axis=(1, 2))
            design = clamped
        return design @ self.vector

    def with_ranges(self, channels):
        """Return the same with the ranges of its derivative in data that show it, Channels each."""
        parts = [self.effect.design_at(each, self.vector) for each in channels]
        ranges = dict(self.ranges)
        for k, name in enumerate(self.effect.parameters):
            design = np.concatenate([np.zeros(0), *(part[:, :, k].ravel() for part in parts)])
            if design.any():
                design = design[design != 0]
                ranges[name] = float(design.min()), float(design.max())
        return replace(self, ranges=ranges)

    def to_dict(self):
        """Return what a JSON file holds of the effect."""
        content = {"name": self.name, "constants": asdict(self.effect)}
        content |= {"parameters": self.values, "std": self.std}
        return content | ({"range": self.ranges} if self.ranges else {})

    @classmethod
    def from_dict(cls, content):
        """Return the effect of a JSON file; an ImuloopError if the library has none like it."""
        name = content["name"]
        try:
            effect = find_effect(name)(**content.get("constants", {}))
            _check_constants(effect)
        except (TypeError, ValueError) as error:
            raise ImuloopError(f"effect {name}: its constants do not fit: {error}") from error
        if set(content["parameters"]) != set(effect.parameters):
            raise ImuloopError(f"effect {name}: its parameters are {', '.join(effect.parameters)}")
        values = {key: float(content["parameters"][key]) for key in effect.parameters}
        std = dict(content.get("std", {}))
        ranges = {key: tuple(map(float, ends)) for key, ends in content.get("range", {}).items()}
        if not {*ranges, *std} <= {*values}:
            raise ImuloopError(f"effect {name}: range or std of what is no parameter of it")
        if not np.isfinite([*values.values(), *std.values()]).all():
            raise ImuloopError(f"effect {name}: a parameter or its std is no finite number")
        for ends in ranges.values():
            if not (len(ends) == 2 and -np.inf < ends[0] <= ends[1] < np.inf):
                raise ImuloopError(f"effect {name}: range is no least and largest value")
        return cls(effect, values, std, ranges)


def _check_constants(effect):
    """Raise ValueError for a constant of another type than its default, or out of its bounds."""
    for each in fields(effect):
        value = getattr(effect, each.name)
        kinds = {float: (int, float)}.get(type(each.default), type(each.default))
        if isinstance(value, bool) or not isinstance(value, kinds):
            raise TypeError(f"{each.name} is {value!r}")
        low, high = effect.bounds.get(each.name, (-np.inf, np.inf))
        if isinstance(value, (int, float)) and not (low <= value <= high and abs(value) < np.inf):
            raise ValueError(f"{each.name} is {value:g}, not from {low:g} to {high:g}")
