"""An effect: an error of a sensor other than bias, scale factor and misalignment.

Nominal SI values are raw readings less the data sheet's offset, times its scale.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property
from itertools import pairwise
from typing import ClassVar

import numpy as np

from imuloop.core.errors import ImuloopError, did_you_mean

# names of constants that a fit refines between the values of the variants that are tried
FINE = ("tau", "half_width", "lag")
# SI unit of each sensor's output
OUTPUT = {"accelerometer": "m/s^2", "gyroscope": "rad/s"}


@dataclass(frozen=True)
class Channels:
    """The inputs of an effect at n points, which are samples of a log or poses (means of rests)."""

    t: np.ndarray  # (n,): time since the start of the log, s
    output: np.ndarray  # (n, 3): the sensor's own output ``K (raw - b)``, SI, on its own axes
    other: np.ndarray  # (n, 3): the other sensor's output, SI
    temperature: np.ndarray | None = None  # (n,): degC; None where it was not logged
    # takes a function of the Channels of the whole log, and its constants; returns the values of
    # this function at the points, (n, …). None if the points are all samples of the log
    history: Callable | None = None
    # (n,): number of the power cycle of each point, 0, 1, …; None if it is one unknown power cycle
    power_cycle: np.ndarray | None = None
    # gets, by name of the effect, a mask of the points at which the effect was clamped to the range
    # of the data that it was fitted to
    clamped: dict | None = None

    def map(self, change):
        """Return Channels at m points that follow from these n points.

        `change` is a function that converts an array (n, …) to (m, …), for instance by choosing or
        averaging points. In the result the fields `power_cycle` and `clamped` are None.
        """

        def history(function, *constants):
            """Return the values of `function` of the whole log at the m points, (m, …).

            `constants` are the arguments of `function` after the Channels.
            """
            return change(self.evaluate(function, *constants))

        return Channels(
            t=change(self.t),
            output=change(self.output),
            other=change(self.other),
            temperature=None if self.temperature is None else change(self.temperature),
            history=history,
        )

    def evaluate(self, function, *constants):
        """Return the values of a function of the whole log at the n points, (n, …).

        `function` takes the Channels of the whole log and the `constants`. It returns an array with
        a row for each sample. If the points are poses, the value at a pose is the mean over the
        samples of its rest.
        """
        if self.history is not None:
            return self.history(function, *constants)
        return function(self, *constants)

    def evaluate_memory(self, function, *constants):
        """Return the values at the n points, (n, …), of a function that needs more than one sample.

        Such a function depends on earlier or neighbouring samples, as a filter does. `function` and
        `constants` are those of `evaluate`, which computes the values. Raises an ImuloopError for a
        single sample without its log.
        """
        if self.history is None and len(self.t) == 1:
            raise ImuloopError(
                "the calibration holds an effect that depends on the samples before and after: "
                "a single sample is not enough, give the whole log"
            )
        return self.evaluate(function, *constants)


class LoggedChannels:
    """The inputs of an effect at all N samples of a log, computed when they are first used.

    `t`, (N,), is the time, s, and `temperature`, (N,), is in degC. `output` and `other` are
    functions without arguments. They return the outputs of the sensor and of the other sensor, (N,
    3), SI. The attributes `output` and `other` of an instance are these arrays.
    """

    def __init__(self, t, temperature, output, other):
        self.t, self.temperature, self._output, self._other = t, temperature, output, other

    output = cached_property(lambda self: self._output())
    other = cached_property(lambda self: self._other())


@dataclass(frozen=True)
class Effect:
    """Base class of all effects; a subclass with a name registers itself in the library.

    In the model ``x = T (K (raw - b) - e)`` of a sensor, an effect adds ``e = Σ_k p_k D_k`` to the
    output of the sensor, SI, on the sensor's own axes. T is the misalignment, K are the scale
    factors and b the biases. p_k are the parameters of the effect. D is the derivative of e with
    respect to them; a subclass computes it. Constants that enter D nonlinearly, such as a time
    constant or an order, are fields of the subclass, which is then a frozen dataclass. An instance
    has values of the constants and is called a variant of the effect.
    """

    name: ClassVar[str]  # name in the results
    # the sensors that can have it
    sensors: ClassVar[tuple[str, ...]] = ("accelerometer", "gyroscope")
    # names of the parameters and their SI units; ``output`` in a unit stands for the sensor's unit
    parameters: ClassVar[dict[str, str]]
    equation: ClassVar[str]  # equation of e, with which the docstring of the class begins
    reference: ClassVar[str]  # publication that describes it
    # channels that it needs: ``temperature``, ``power_cycle`` (data of more than one power cycle)
    needs: ClassVar[tuple[str, ...]] = ()
    # data in which the diagnosis tests it: ``poses``, ``static_record``, ``motion``
    records: ClassVar[tuple[str, ...]] = ("poses",)
    # why poses and static records cannot show it; None if they can
    unobservable: ClassVar[str | None] = None
    limit: ClassVar[float] = np.inf  # largest size of a parameter that is physically possible, SI
    # whether it depends on the time since the start of the log, or on earlier samples; true of all
    # with `after_temperature`
    timed: ClassVar[bool] = False
    # whether it depends on time or on earlier temperatures: it is tested after the effects of the
    # temperature itself
    after_temperature: ClassVar[bool] = False
    # whether it depends on the rate of change of an output, and so on neighbouring samples
    rate_of_change: ClassVar[bool] = False
    lasting: ClassVar[bool] = True  # whether a device that had it in one record has it in the next
    # whether it is one of many formulas without a known cause: it is tested after all others
    is_formula: ClassVar[bool] = False
    # amount by which the logarithm of its p-value has to be lower than for a variant without a
    # price, because its constants are rarely needed
    price: ClassVar[float] = 0.0
    # least and largest value of constants that have limits
    bounds: ClassVar[dict[str, tuple[float, float]]] = {"tau": (1e-3, 1e7)}

    # all subclasses with a name, by name
    library: ClassVar[dict[str, type]] = {}

    @property
    def kind(self):
        """Class of the effect: variants with different constants are of one kind."""
        return type(self)

    @property
    def constants(self):
        """Values of the constants, such as a time constant, a dict by name."""
        return asdict(self)

    def in_session(self, channels, session, windows):
        """Return the mean derivative D of e over each of n windows of a session, SI, (n, 3, p).

        e is the error that the effect adds to the sensor's output. The axes of D are: window, axis
        of the sensor, parameter of the effect.

        Parameters
        ----------
        channels : Channels
            Means over the windows, a point for each.
        session : str
            Name of the session, for an effect that differs between sessions.
        windows : ndarray, shape (n, 2)
            Start and end of each window, s, for an effect that changes within a window.
        """
        return self.design(channels)

    def clamped(self, design, low, high):
        """Return the derivative D with its values clamped to a range for each parameter, (n, 3, p).

        `design`, (n, 3, p), is D at n points for the 3 axes of the sensor and p parameters. `low`
        and `high`, (p,), are the ends of the ranges that D has in the data that the effect was
        fitted to; beyond them the effect is not known.
        """
        # zeros are kept: they are axes that do not depend on a parameter
        return np.where(design == 0, 0.0, np.clip(design, low, high))

    def moved(self, factor):
        """Return the effect with its time constant multiplied by `factor`, to refine this constant.

        The same holds for another constant whose name is in `FINE`, such as a half-width. An effect
        without such a constant is returned unchanged.
        """
        constants = [n for n in FINE if hasattr(self, n)]
        return replace(self, **{n: float(factor * getattr(self, n)) for n in constants})

    def __init_subclass__(cls, **kwargs):
        """Set the properties of a subclass that follow from others, and add it to the library."""
        super().__init_subclass__(**kwargs)
        # the docstring begins with the equation in double backticks
        cls.equation = (cls.__doc__ or "").removeprefix("``").partition("``")[0]
        cls.timed = cls.timed or cls.after_temperature
        if cls.records == ("motion",):
            cls.unobservable = (
                "it acts while the device turns: the motion between the rests shows it"
            )
        Effect.library[cls.name] = cls

    @classmethod
    def variants(cls, channels):
        """Return the variants of the effect to test in some data, a tuple.

        `channels` are the Channels of these data. The variants differ in the values of the
        constants. A time constant, for instance, must be so short that its effect shows within the
        length of the data. The tuple is empty for an effect without an implemented derivative.
        """
        return () if cls.design is Effect.design else (cls(),)

    def units(self, sensor):
        """Return the SI unit of each parameter, a dict by name.

        `sensor` is the name of the sensor that has the effect.
        """
        output = OUTPUT[sensor]
        return {name: unit.replace("output", output) for name, unit in self.parameters.items()}

    def design(self, channels):
        """Return D, the derivative of e with respect to p parameters at n points, SI, (n, 3, p).

        e is the error that the effect adds to the sensor's output. `channels` are the Channels at
        the points. The second axis of D is the axis of the sensor. If e is not linear in the
        parameters, D is the derivative where they are zero.
        """
        raise TypeError(f"{self.name}: {self.unobservable or 'it has no design'}")

    def design_at(self, channels, values):
        """Return the matrix D with ``e = D x`` at given parameters x, SI, (n, 3, p).

        e is the error that the effect adds to the sensor's output on 3 axes, at the n points of the
        Channels `channels`. `values`, (p,), are the parameters x. If e is linear in x, D is its
        derivative and does not depend on x.
        """
        return self.design(channels)


def find_effect(name):
    """Return the class of the effect with the name `name`.

    Raises an ImuloopError if the library has no effect of this name.
    """
    if name not in Effect.library:
        names = ", ".join(sorted(Effect.library)) or "none is loaded"
        hint = did_you_mean(name, Effect.library)
        raise ImuloopError(f"'{name}' is not an effect of the library{hint}; known: {names}")
    return Effect.library[name]


def effect_design(effects, channels, values=()):
    """Return the derivative of the summed errors e of effects by their p parameters, (n, 3, p).

    `effects` is a sequence of Effect; e is the error that each adds to the sensor's output on 3
    axes. The derivative is taken at the n points of the Channels `channels` and at the parameters
    `values`. There may be fewer than p values; the other parameters are then zero.
    """
    ends = np.cumsum([0, *(len(e.parameters) for e in effects)])
    x = np.pad(np.asarray(values, dtype=float), (0, ends[-1] - len(values)))
    ranges = zip(effects, pairwise(ends), strict=True)
    designs = [effect.design_at(channels, x[i:j]) for effect, (i, j) in ranges]
    # one derivative alone is not copied: a search asks for those of hundreds of effects, one by one
    if len(designs) == 1:
        return designs[0]
    return np.concatenate([np.zeros((len(channels.t), 3, 0)), *designs], axis=2)


@dataclass(frozen=True)
class FittedEffect:
    """An effect with fitted values of its parameters."""

    effect: Effect  # the effect with its constants
    values: dict  # parameters by name, SI
    std: dict  # standard errors of the parameters by name, SI
    # least and largest value of the derivative with respect to each parameter, by name, SI, in the
    # data that show the effect; it is clamped to them. Empty if the effect is not clamped
    ranges: dict = field(default_factory=dict)

    @property
    def name(self):
        """Name of the effect in the library."""
        return self.effect.name

    @property
    def vector(self):
        """Values of the p parameters, SI, (p,), in the order of the columns of the derivative."""
        return np.array([self.values[name] for name in self.effect.parameters])

    def output(self, channels):
        """Return e, which the effect adds to the sensor's output at n points, SI, (n, 3).

        It is the derivative D of e with respect to the p parameters, (n, 3, p), times the
        parameters. For each parameter D is clamped to its range in the data that the effect was
        fitted to. `channels` are the Channels at the points. If their field `clamped` is a dict, it
        gets the mask, (n,), of the points at which D was clamped, under the name of the effect.
        """
        design = self.effect.design_at(channels, self.vector)
        if self.ranges:
            unlimited = (-np.inf, np.inf)
            ends = [self.ranges.get(name, unlimited) for name in self.effect.parameters]
            low, high = np.transpose(ends)
            clamped = self.effect.clamped(design, low, high)
            if channels.clamped is not None:
                channels.clamped[self.name] = np.any(clamped != design, axis=(1, 2))
            design = clamped
        return design @ self.vector

    def with_ranges(self, channels):
        """Return a copy that stores the range of each column of D in the data of a fit.

        D is the derivative of the error e with respect to the parameters, a column for each.
        `output` clamps D to these ranges, as the effect is not known beyond them. `channels` is a
        list of Channels, the data. A parameter whose column is zero everywhere keeps its earlier
        range.
        """
        designs = [self.effect.design_at(data, self.vector) for data in channels]
        ranges = dict(self.ranges)
        for k, name in enumerate(self.effect.parameters):
            design = np.concatenate([np.zeros(0), *(d[:, :, k].ravel() for d in designs)])
            # zeros are of axes that do not depend on the parameter
            if (design := design[design != 0]).size:
                ranges[name] = float(design.min()), float(design.max())
        return replace(self, ranges=ranges)

    def to_dict(self):
        """Return the entry of the effect in a calibration's JSON file, a dict."""
        content = {"name": self.name, "constants": self.effect.constants}
        content |= {"parameters": self.values, "std": self.std}
        return content | ({"range": self.ranges} if self.ranges else {})

    @classmethod
    def from_dict(cls, content):
        """Return the FittedEffect of `content`, the dict of its entry in a calibration's JSON file.

        Raises an ImuloopError if the library has no such effect, or if the entry does not fit it.
        """
        name, values = content["name"], content["parameters"]
        std, ranges = content.get("std", {}), content.get("range", {})
        # lists of the file become tuples, as an effect is hashed
        constants = content.get("constants", {}).items()
        constants = {k: tuple(v) if isinstance(v, list) else v for k, v in constants}
        try:
            effect = find_effect(name)(**constants)
            _check_constants(effect)
        except (TypeError, ValueError) as error:
            raise ImuloopError(f"effect {name}: its constants do not fit: {error}") from error
        if set(values) != set(effect.parameters) or not {*std, *ranges} <= set(values):
            raise ImuloopError(f"effect {name}: its parameters are {', '.join(effect.parameters)}")
        values = {key: float(values[key]) for key in effect.parameters}
        ranges = {key: (float(low), float(high)) for key, (low, high) in ranges.items()}
        if not all(low <= high for low, high in ranges.values()):
            raise ImuloopError(f"effect {name}: range is not a least and a largest value")
        return cls(effect, values=values, std=dict(std), ranges=ranges)


def _check_constants(effect):
    """Raise a TypeError or a ValueError if a constant of the Effect `effect` is impossible.

    The TypeError is for a value of another type than the default value of the constant, the
    ValueError for a value that is infinite or beyond its bounds.
    """
    for constant in fields(effect):
        value = getattr(effect, constant.name)
        # a float may be an int in the file, but a bool, which is an int in Python, is neither
        kinds = {float: (int, float)}.get(type(constant.default), type(constant.default))
        if isinstance(value, bool) or not isinstance(value, kinds):
            raise TypeError(f"{constant.name} is {value!r}")
        low, high = effect.bounds.get(constant.name, (-np.inf, np.inf))
        if isinstance(value, (int, float)) and not (low <= value <= high and abs(value) < np.inf):
            raise ValueError(f"{constant.name} is {value:g}, not from {low:g} to {high:g}")
