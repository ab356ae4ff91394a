"""An effect: what the base model of bias, scale factor and misalignment lacks."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property
from itertools import pairwise
from typing import ClassVar

import numpy as np

from imuloop.core.errors import ImuloopError, did_you_mean

# constants that lie between those of the shapes
FINE = ("tau", "half_width", "lag")
# SI unit of each sensor's output
OUTPUT = {"accelerometer": "m/s^2", "gyroscope": "rad/s"}


@dataclass(frozen=True)
class Channels:
    """What an effect may depend on, at n points: samples, or poses."""

    t: np.ndarray  # (n,): time since the start of the log, s
    output: np.ndarray  # (n, 3): the sensor's own output ``K (raw - b)``, SI, on its own axes
    other: np.ndarray  # (n, 3): the other sensor's output, SI
    temperature: np.ndarray | None = None  # (n,): degC; None where it was not logged
    history: Callable | None = None  # see `evaluate`; None where the points are samples
    # (n,): which power cycle of the data, 0, 1, ..., each point lies in; None in one of its own
    power_cycle: np.ndarray | None = None
    # takes, by name of an effect, at which points it was clamped to its range
    clamped: dict | None = None

    def map(self, change):
        """Return the channels with each array of n points as `change` makes it, (m, …)."""
        temperature = None if self.temperature is None else change(self.temperature)
        return Channels(
            *(change(values) for values in (self.t, self.output, self.other)),
            temperature,
            lambda function, *constants: change(self.evaluate(function, *constants)),
        )

    def evaluate(self, function, *constants):
        """Return a function of the log's samples at these points, shape (n, …).

        The function takes the Channels of a whole log and constants, and gives an array whose first
        axis is the log's samples; at a pose their mean over it is taken.
        """
        if self.history is not None:
            return self.history(function, *constants)
        return function(self, *constants)

    def evaluate_memory(self, function, *constants):
        """Return the same of a function in which a sample depends on those before and after it.

        An ImuloopError for a single sample.
        """
        if self.history is None and len(self.t) == 1:
            raise ImuloopError(
                "the calibration holds an effect that depends on the samples before and after: "
                "a single sample is not enough, give the whole log"
            )
        return self.evaluate(function, *constants)


class LoggedChannels:
    """The `Channels` of a whole log; an output is computed when it is first used."""

    def __init__(self, t, temperature, output, other):
        self.t, self.temperature, self._output, self._other = t, temperature, output, other

    output = cached_property(lambda self: self._output())
    other = cached_property(lambda self: self._other())


@dataclass(frozen=True)
class Effect:
    """Base class of all effects; a subclass with a name registers itself in the library.

    An effect adds ``e = Σ_k p_k D_k`` to the sensor's output, SI, on the sensor's own axes, in the
    model ``x = T (K (raw - b) - e)``. D, its derivative, is what a subclass gives. Constants that D
    does not depend on linearly (a time constant, an order) are fields of the subclass, then a
    frozen dataclass: an instance is one shape of the effect.
    """

    name: ClassVar[str]  # as in results
    # the sensors that can have it
    sensors: ClassVar[tuple[str, ...]] = ("accelerometer", "gyroscope")
    # names of the parameters and their SI units; ``output`` in a unit is that of the sensor
    parameters: ClassVar[dict[str, str]]
    equation: ClassVar[str]  # what it adds
    reference: ClassVar[str]  # where it is described
    # channels without which it cannot be seen: ``temperature``, ``power_cycle`` (more than one)
    needs: ClassVar[tuple[str, ...]] = ()
    # data in which it is looked for: ``poses``, ``static_record``, ``motion``
    records: ClassVar[tuple[str, ...]] = ("poses", "static_record")
    # why poses and static records cannot show it, if so; then it is tried in its `records` only
    unobservable: ClassVar[str | None] = None
    limit: ClassVar[float] = np.inf  # largest size of a parameter that is physically possible, SI
    # whether it depends on the time since the start of the log, or on what was before
    timed: ClassVar[bool] = False
    # whether it is of time or of what the temperature was before: what the temperature itself
    # explains comes before it
    after_temperature: ClassVar[bool] = False
    # whether it depends on how fast an output changes, and so on the samples beside each
    rate_of_change: ClassVar[bool] = False
    lasting: ClassVar[bool] = True  # whether a device that had it in one record has it in the next
    # whether it is one of many formulas without a cause: all others come before it
    is_formula: ClassVar[bool] = False
    # by how much the logarithm of its p-value has to be below that of shapes which do without
    # a constant that this one has
    price: ClassVar[float] = 0.0
    # least and largest value of a constant, where not any number will do
    bounds: ClassVar[dict[str, tuple[float, float]]] = {"tau": (1e-3, 1e7)}

    library: ClassVar[dict[str, type]] = {}

    @property
    def kind(self):
        """The class, which effects with other constants share."""
        return type(self)

    @property
    def constants(self):
        """Constants of this shape by name."""
        return asdict(self)

    def in_session(self, channels, session, windows):
        """Return the derivative of means over windows, (n, 2) s, of a session, (n, 3, p)."""
        return self.design(channels)

    def clamped(self, design, low, high):
        """Return a derivative, (n, 3, p), clamped to the ranges of its parameters, (p,) each."""
        # a parameter that an axis does not have is zero there
        return np.where(design == 0, 0.0, np.clip(design, low, high))

    def moved(self, factor):
        """Return the effect with its time constant, or width, multiplied by a factor."""
        constants = [n for n in FINE if hasattr(self, n)]
        return replace(self, **{n: float(factor * getattr(self, n)) for n in constants})

    def __init_subclass__(cls, **kwargs):
        super().__init_subclass__(**kwargs)
        Effect.library[cls.name] = cls

    @classmethod
    def shapes(cls, channels):
        """Return the shapes to try for data with these channels; none where it has no design."""
        return () if cls.design is Effect.design else (cls(),)

    def units(self, sensor):
        """Return the SI unit of each parameter for a sensor."""
        output = OUTPUT[sensor]
        return {name: unit.replace("output", output) for name, unit in self.parameters.items()}

    def design(self, channels):
        """Return D, the derivative of `e` to the parameters at n points, SI, shape (n, 3, p)."""
        raise TypeError(f"{self.name}: {self.unobservable or 'it has no design'}")

    def design_at(self, channels, values):
        """Return D with ``D p = e`` at p = `values`; unlike `design` where e is not linear."""
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
    """An effect with the values of its parameters."""

    effect: Effect  # with its constants
    values: dict  # parameters by name, SI
    std: dict  # their standard errors, SI
    # least and largest value that the derivative of each parameter had in the data that show the
    # effect, SI; it is clamped to them. Empty for an effect that acts everywhere
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
        """Return the effect with the ranges of its derivative in the data, a list of Channels."""
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
        content = {"name": self.name, "constants": self.effect.constants}
        content |= {"parameters": self.values, "std": self.std}
        return content | ({"range": self.ranges} if self.ranges else {})

    @classmethod
    def from_dict(cls, content):
        """Return the effect of a JSON file; an ImuloopError if the library has none like it."""
        name = content["name"]
        try:
            constants = content.get("constants", {}).items()
            # a list of a file is a tuple: an effect is hashed
            constants = {k: tuple(v) if isinstance(v, list) else v for k, v in constants}
            effect = find_effect(name)(**constants)
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
