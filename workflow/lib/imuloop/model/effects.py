"""An effect together with the sensor that has it, since both sensors are fitted together."""

from dataclasses import dataclass, replace
from operator import attrgetter

from imuloop.model.effect import Effect


@dataclass(frozen=True)
class EffectKind:
    """A class of the library of effects, together with the name of the sensor that has the effect.

    It repeats three attributes of the class: the `name`, the `limit` (largest possible size of a
    parameter) and `is_formula` (whether the effect is a product of outputs without a known cause).
    """

    cls: type
    sensor: str

    name = property(attrgetter("cls.name"))
    limit = property(attrgetter("cls.limit"))
    is_formula = property(attrgetter("cls.is_formula"))


@dataclass(frozen=True)
class SensorEffect:
    """A variant of an effect, together with the name of the sensor that has it.

    A variant is an effect with values of its constants. The attributes that are listed below are
    those of the effect.
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
        """Return the SensorEffect with its time constant, or half-width, multiplied by `factor`.

        An effect without such a constant is unchanged.
        """
        return replace(self, effect=self.effect.moved(factor))
