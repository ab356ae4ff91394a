"""The effects of the library that can be tried on a sensor, and reasons against the others."""

from imuloop.effects.temperature import LEAST_SPAN, span
from imuloop.model.effect import Effect


def candidates(sensor, record, channels):
    """Return the shapes to try on a sensor, and the effects that are not tried.

    Both are dicts by type of effect: a tuple of shapes, and a status with its reason. `record` is
    'poses' or 'static_record', and `channels` are the Channels that effects take there. Effects
    of 'motion' are in neither: `records.motion.candidates_in_motion` returns them.
    """
    available, others, cycle = {}, {}, channels.power_cycle
    several = cycle is not None and cycle.any()
    for cls in Effect.library.values():
        if sensor not in cls.sensors or (record not in cls.records and not cls.unobservable):
            continue
        if cls.unobservable:
            others[cls] = ("not_observable", cls.unobservable)
        elif "temperature" in cls.needs and channels.temperature is None:
            others[cls] = ("not_available", "not every session logs a temperature")
        elif "temperature" in cls.needs and span(channels) <= LEAST_SPAN:
            others[cls] = (
                "not_observable",
                f"the temperature changes by {span(channels):.2g} K: a thermometer's own error can "
                f"do so up to {LEAST_SPAN:g} K",
            )
        elif "power_cycle" in cls.needs and not several:
            others[cls] = (
                "not_available",
                "one power cycle shows one bias: record several sessions, switched off and on "
                "between",
            )
        elif "power_cycle" in cls.needs and cycle.max() >= cls.bounds["runs"][1]:
            others[cls] = ("not_available", f"more power cycles than {cls.bounds['runs'][1]}")
        else:
            available[cls] = tuple(cls.shapes(channels))
    return available, others
