"""Which effects of the library can be tried on a sensor, and why not the others."""

from imuloop.core.effect import Effect
from imuloop.effects.thermometer import LEAST_SPAN, span


def candidates(sensor, record, channels):
    """Return the effects to try on a sensor, each with its shapes, and why others are not.

    Parameters
    ----------
    sensor : {'accelerometer', 'gyroscope'}
        Sensor.
    record : {'poses', 'static_record'}
        Kind of data.
    channels : Channels
        What the effects see in them.

    Returns
    -------
    dict of type to tuple of Effect
        The shapes of each effect that can be tried.
    dict of type to (str, str)
        Status and reason of those that cannot.
    """
    available, others = {}, {}
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
        elif "run" in cls.needs and (channels.run is None or not channels.run.any()):
            others[cls] = (
                "not_available",
                "one run shows one bias: record several sessions, switched off and on between",
            )
        elif "run" in cls.needs and channels.run.max() >= cls.bounds["runs"][1]:
            others[cls] = ("not_available", f"more runs than {cls.bounds['runs'][1]}")
        else:
            available[cls] = tuple(cls.shapes(channels))
    return available, others
