"""The effects of the library that can be tried on a sensor, and reasons against the others."""

from imuloop.effects.temperature import LEAST_SPAN, span
from imuloop.model.effect import Effect


def candidates(sensor, record, channels):
    """Return the variants to try on a sensor, and the effects that are not tried.

    A variant is an effect with values of its constants, such as a time constant. Effects that only
    motion shows are in neither result.

    Parameters
    ----------
    sensor : str
    record : {'poses', 'static_record'}
        Kind of record.
    channels : Channels
        Inputs of the effects in this record.

    Returns
    -------
    dict of type to tuple of Effect
        The variants to try, by type of effect.
    dict of type to (str, str)
        Status and reason of the effects that are not tried, by type of effect.
    """
    variants, reasons, cycle = {}, {}, channels.power_cycle
    # power cycles have numbers from 0
    several_cycles = cycle is not None and cycle.any()
    for cls in Effect.library.values():
        if sensor not in cls.sensors or (record not in cls.records and not cls.unobservable):
            continue
        if cls.unobservable:
            reasons[cls] = ("not_observable", cls.unobservable)
        elif "temperature" in cls.needs and channels.temperature is None:
            reasons[cls] = ("not_available", "not every session logs a temperature")
        elif "temperature" in cls.needs and span(channels) <= LEAST_SPAN:
            reasons[cls] = (
                "not_observable",
                f"the temperature changes by {span(channels):.2g} K: a thermometer's own error can "
                f"do so up to {LEAST_SPAN:g} K",
            )
        elif "power_cycle" in cls.needs and not several_cycles:
            reasons[cls] = (
                "not_available",
                "one power cycle shows one bias: record several sessions, switched off and on "
                "between",
            )
        elif "power_cycle" in cls.needs and cycle.max() >= cls.bounds["runs"][1]:
            reasons[cls] = ("not_available", f"more power cycles than {cls.bounds['runs'][1]}")
        else:
            variants[cls] = tuple(cls.variants(channels))
    return variants, reasons
