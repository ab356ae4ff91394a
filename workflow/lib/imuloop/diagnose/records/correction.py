"""Correction of the samples of static records for the added effects."""

from functools import cache, partial
from operator import itemgetter

import numpy as np

from imuloop.core.samples import CHANNELS, OWN_TIME, SENSORS, TEMPERATURE, TIME, other_sensor
from imuloop.model.effect import Channels
from imuloop.noise.records import RecordedSession

# samples that are corrected at once: their derivatives, 27 numbers each, fit into a CPU cache
ROWS = 1 << 14


def corrected_sessions(data, calibration, effects):
    """Return the sessions of static records with the output of some effects subtracted.

    Parameters
    ----------
    data : StaticData
    calibration : Calibration
        It computes the output ``K (raw - b)``. Effects are errors of this output.
    effects : dict of str to sequence of FittedEffect
        The effects of each sensor.

    Returns
    -------
    list of RecordedSession
    """
    sessions = []
    for name, samples in data.samples.items():
        columns = correct_samples(name, samples, data.logs[name], calibration, effects)
        sessions.append(RecordedSession(name, data.kinds[name], columns, data.segments[name]))
    return sessions


def correct_samples(session, samples, log, calibration, effects):
    """Return the samples of a session, by column, with the output of some effects subtracted.

    `session` is its name. `samples` and the result are in nominal SI, readings by the nominal
    scale, before any calibration; `log` is the Log of the same samples. `calibration` computes the
    output ``K (raw - b)`` of each sensor, and `effects` has the FittedEffects, errors of this
    output, by sensor.
    """
    t, columns = log.t, {name: np.array(samples[name], dtype=float) for name in CHANNELS}
    # at rest the effects see the mean output of each sensor
    levels = {
        s: getattr(calibration, s).output(np.array([[columns[name].mean() for name in names]]))
        for s, names in SENSORS.items()
    }
    for sensor, fitted_effects in effects.items():
        if not fitted_effects:
            continue
        model = getattr(calibration, sensor)
        output, other = (
            np.broadcast_to(levels[s], (len(t), 3)) for s in (sensor, other_sensor(sensor))
        )
        # evaluates the functions of effects with a memory once, on the whole log
        history = cache(partial(log.evaluate, sensor))
        channels = Channels(
            t=t, output=output, other=other, temperature=log.temperature, history=history
        )
        for first in range(0, len(t), ROWS):
            rows = slice(first, first + ROWS)
            # a sample is a window of length zero
            part, windows = channels.map(itemgetter(rows)), np.column_stack([t[rows], t[rows]])
            error = sum(
                fitted.effect.in_session(part, session, windows) @ fitted.vector
                for fitted in fitted_effects
            )
            # from an error of the output K (raw - b) to one of nominal SI
            error *= model.raw_unit.scale / model.K
            for name, values in zip(SENSORS[sensor], error.T, strict=True):
                columns[name][rows] -= values
    temperature = {} if log.temperature is None else {TEMPERATURE: log.temperature}
    times = {name: np.asarray(samples[name]) for name in OWN_TIME.values() if name in samples}
    return {TIME: t, **columns, **temperature, **times}
