"""An effect together with the sensor that has it, since both sensors are fitted together."""

from dataclasses import dataclass, replace
from operator import attrgetter

from imuloop.model.effect import Effect


@dataclass(frozen=True)
class EffectKind:
    """A class of the library of effects, together with the sensor that has the effect.

    It has the name, the limit and the `is_formula` of the class.
    """

    cls: type
    sensor: str

    name = property(attrgetter("cls.name"))
    limit = property(attrgetter("cls.limit"))
    is_formula = property(attrgetter("cls.is_formula"))


@dataclass(frozen=True)
class SensorEffect:
    """A variant of an effect, together with the name of the sensor that has it.

    It also has the attributes of the effect that are listed below.
    """

    effect: Effect
    sensor: str

    name = property(attrgetter("effect.name"))
    parameters = property(attrgetter("effect.parameters"))
    constants = property(attrgetter("effect.constants"))
    needs = property(attrgetter("effect.needs"))
    timed = property(attrgetter("effect.timed"))
    after_temperature = property(attrgetter("effect.after_temperature"))
    price = property(attrgetter("effect.price"))
    units = property(attrgetter("effect.units"))

    @property
    def kind(self):
        """The class of the effect and its sensor, an EffectKind."""
        return EffectKind(type(self.effect), self.sensor)

    def moved(self, factor):
        """Return the SensorEffect with its time constant, or width, multiplied by `factor`."""
        return replace(self, effect=self.effect.moved(factor))
