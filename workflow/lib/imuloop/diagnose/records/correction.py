"""Correction of the samples of static records for the added effects."""

from functools import cache, partial
from operator import itemgetter

import numpy as np

from imuloop.core.samples import CHANNELS, OWN_TIME, SENSORS, TEMPERATURE, TIME, other_sensor
from imuloop.model.effect import Channels
from imuloop.noise.records import RecordedSession

# samples that are corrected at once: their derivatives, 27 numbers each, fit into a CPU cache
ROWS = 1 << 14


def correct_samples(session, samples, log, calibration, found):
    """Return the samples of a session, by column, with the output of some effects subtracted.

    `samples` and the result are in nominal SI; `log` is the Log of the same samples. `found` has
    the FittedEffects of each sensor. They are errors of the output ``K (raw - b)``, which
    `calibration` computes.
    """
    t, columns = log.t, {name: np.array(samples[name], dtype=float) for name in CHANNELS}
    # at rest the effects see the mean output of each sensor
    levels = {
        s: getattr(calibration, s).output(np.array([[columns[name].mean() for name in names]]))
        for s, names in SENSORS.items()
    }
    for sensor, effects in found.items():
        if not effects:
            continue
        model = getattr(calibration, sensor)
        channels = Channels(
            t,
            *(np.broadcast_to(levels[s], (len(t), 3)) for s in (sensor, other_sensor(sensor))),
            log.temperature,
            cache(partial(log.evaluate, sensor)),
        )
        for first in range(0, len(t), ROWS):
            rows = slice(first, first + ROWS)
            inputs, instants = channels.map(itemgetter(rows)), np.column_stack([t[rows], t[rows]])
            total = sum(e.effect.in_session(inputs, session, instants) @ e.vector for e in effects)
            total *= model.raw_unit.scale / model.K
            for name, values in zip(SENSORS[sensor], total.T, strict=True):
                columns[name][rows] -= values
    warmth = {} if log.temperature is None else {TEMPERATURE: log.temperature}
    times = {name: np.asarray(samples[name]) for name in OWN_TIME.values() if name in samples}
    return {TIME: t, **columns, **warmth, **times}


def corrected_sessions(data, calibration, found):
    """Return a RecordedSession with corrected samples for each session of StaticData.

    `calibration` and `found` are as in `correct_samples`.
    """
    return [
        RecordedSession(
            name,
            data.kinds[name],
            correct_samples(name, samples, data.logs[name], calibration, found),
            data.segments[name],
        )
        for name, samples in data.samples.items()
    ]
