"""Samples of static records corrected for the added effects."""

import numpy as np

from imuloop.core.effect import Channels
from imuloop.core.rest_log import other_sensor
from imuloop.core.samples import CHANNELS, OWN_TIME, SENSORS, TEMPERATURE, TIME
from imuloop.noise.records import RecordedSession


def corrected(session, log, calibration, found):
    """Return samples of a session by column, SI as logged, less what effects add.

    `log` is a RestLog, `found` the FittedEffects of each sensor; the calibration turns SI as logged
    into ``K (raw - b)``.
    """
    t, changed = log.t, {name: log.column(name) for name in CHANNELS}
    levels = {s: [np.nanmean(changed[name]) for name in names] for s, names in SENSORS.items()}
    for sensor, effects in found.items():
        if not effects:
            continue
        own, other = getattr(calibration, sensor), other_sensor(sensor)
        # at rest the outputs stand still
        level = own.output(np.array([levels[sensor]]))
        beside = getattr(calibration, other).output(np.array([levels[other]]))
        for part, remembered in log.parts(sensor):
            rows = (part.stop - part.start, 1)
            temperature = None if log.temperature is None else log.temperature[part]
            seen = Channels(
                t[part], np.tile(level, rows), np.tile(beside, rows), temperature, remembered
            )
            instants = np.column_stack([t[part], t[part]])
            total = sum(e.effect.in_session(seen, session, instants) @ e.vector for e in effects)
            total *= own.raw_unit.scale / own.K
            for name, values in zip(SENSORS[sensor], total.T, strict=True):
                changed[name][part] -= values
    warmth = {} if log.temperature is None else {TEMPERATURE: log.temperature}
    held = {name: log.column(name) for name in OWN_TIME.values() if name in log.samples}
    return {TIME: t, **changed, **warmth, **held}


def corrected_sessions(data, calibration, found):
    """Return a RecordedSession for each session of StaticData, `corrected` for what was found."""
    return [
        RecordedSession(
            name,
            data.kinds[name],
            corrected(name, data.log(name), calibration, found),
            data.segments[name],
        )
        for name in data.samples
    ]
