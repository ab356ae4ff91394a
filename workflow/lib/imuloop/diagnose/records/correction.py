"""Samples of static records corrected for the added effects."""

from functools import cache, partial
from operator import itemgetter

import numpy as np

from imuloop.core.effect import Channels
from imuloop.core.samples import CHANNELS, OWN_TIME, SENSORS, TEMPERATURE, TIME, other_sensor
from imuloop.noise.records import RecordedSession

# samples whose derivatives, 27 numbers each or more, a processor's cache holds
ROWS = 1 << 14


def corrected(session, samples, log, calibration, found):
    """Return samples of a session by column, SI as logged, less what effects add.

    `log` is their Log, `found` the FittedEffects of each sensor; the calibration turns SI as logged
    into ``K (raw - b)``.
    """
    t, changed = log.t, {name: np.array(samples[name], dtype=float) for name in CHANNELS}
    # at rest the outputs stand still
    levels = {
        s: getattr(calibration, s).output(np.array([[changed[name].mean() for name in names]]))
        for s, names in SENSORS.items()
    }
    for sensor, effects in found.items():
        if not effects:
            continue
        own = getattr(calibration, sensor)
        whole = Channels(
            t,
            *(np.broadcast_to(levels[s], (len(t), 3)) for s in (sensor, other_sensor(sensor))),
            log.temperature,
            cache(partial(log.evaluate, sensor)),
        )
        for first in range(0, len(t), ROWS):
            part = slice(first, first + ROWS)
            seen, instants = whole.map(itemgetter(part)), np.column_stack([t[part], t[part]])
            total = sum(e.effect.in_session(seen, session, instants) @ e.vector for e in effects)
            total *= own.raw_unit.scale / own.K
            for name, values in zip(SENSORS[sensor], total.T, strict=True):
                changed[name][part] -= values
    warmth = {} if log.temperature is None else {TEMPERATURE: log.temperature}
    held = {name: np.asarray(samples[name]) for name in OWN_TIME.values() if name in samples}
    return {TIME: t, **changed, **warmth, **held}


def corrected_sessions(data, calibration, found):
    """Return a RecordedSession for each session of StaticData, `corrected` for what was found."""
    return [
        RecordedSession(
            name,
            data.kinds[name],
            corrected(name, samples, data.logs[name], calibration, found),
            data.segments[name],
        )
        for name, samples in data.samples.items()
    ]
