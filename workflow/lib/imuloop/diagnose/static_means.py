"""Static records: the samples of a device at rest, and their means over windows.

Nominal SI values are raw readings minus the offset, times the scale of the data sheet. The output
of a sensor is ``K (raw - b)``, SI, by the calibration without effects.
"""

from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from operator import itemgetter

import numpy as np

from imuloop.calibrate.recording import Log
from imuloop.core.samples import (
    CHANNELS,
    OWN_TIME,
    SENSORS,
    TEMPERATURE,
    TIME,
    Samples,
    other_sensor,
    read_columns,
    sums_over,
)
from imuloop.core.segments import MOTION, STATIC, power_cycles
from imuloop.factors.factors import OWN
from imuloop.model.effect import Channels
from imuloop.noise.records import RecordedSession

# s; least length of a rest that serves as a static record if there is no static session: poses show
# all effects better than a shorter rest
LONG_REST = 600.0
# least and most windows of a record: the window length is changed to keep their number in between.
# The upper limit is there because a covariance of n means has n² entries
LEAST_MEANS, MOST_MEANS = 64, 200
# least number of samples in a window
LEAST_SAMPLES = 10
# columns of the segments that static records and noise need
COLUMNS = "start_s", "end_s", "kind", "tilt_rad"
# samples that are corrected at once: their derivatives, 27 numbers each, fit into a CPU cache
ROWS = 1 << 14


@dataclass(frozen=True)
class StaticRecord:
    """Means of the output of one sensor over n consecutive windows of a session at rest."""

    session: str  # name of the session
    windows: np.ndarray  # (n, 2): start and end of each window, s
    stretch: np.ndarray  # (n,): index of the undisturbed stretch that each window lies in
    values: np.ndarray  # (n, 3): mean output ``K (raw - b)`` of each axis, SI
    # inputs of effects in each window. The sensor's own output is its mean over the session, since
    # at rest the true input is constant and effects do not follow the noise
    channels: Channels

    @property
    def length(self):
        """Length of each window, s, (n,)."""
        return np.diff(self.windows, axis=1)[:, 0]

    def part(self, rows):
        """Return the StaticRecord of some windows; `rows` is their mask, (n,) of bool."""
        return replace(
            self,
            windows=self.windows[rows],
            stretch=self.stretch[rows],
            values=self.values[rows],
            channels=self.channels.map(itemgetter(rows)),
        )


@dataclass(frozen=True)
class StaticData:
    """Samples of the sessions of a device that are used as static records: long rests."""

    kinds: dict  # kind of each session that is used, by name
    samples: dict  # Samples of each session, nominal SI
    segments: dict  # table of the segments of each session that are used

    @cached_property
    def logs(self):
        """Log of each session, with all of its samples as arrays, a dict by name of the session."""
        return {name: Log.of(samples) for name, samples in self.samples.items()}

    def records(self, calibration, mean_time):
        """Return the StaticRecords of each sensor, a list by sensor.

        A record has the means over windows at rest, in one power cycle of one session.
        `calibration` computes the output ``K (raw - b)``. `mean_time`, s, is the wanted length of a
        window; 0 gives the shortest windows that are allowed.
        """
        by_sensor = {sensor: [] for sensor in SENSORS}
        for name, table in self.segments.items():
            records = static_records(name, self.logs[name], table, calibration, mean_time)
            # the stretches of a record are the static segments
            cycles = power_cycles(table)[np.asarray(table["kind"]) == STATIC]
            for sensor, record in records.items():
                cycle = cycles[record.stretch]
                by_sensor[sensor] += [record.part(cycle == k) for k in np.unique(cycle)]
        return by_sensor

    def subtract(self, effects, calibration):
        """Return the sessions after the output of effects is subtracted, a list of RecordedSession.

        From these sessions the noise without effects is estimated. `effects` has the FittedEffects
        of each sensor: errors of its output ``K (raw - b)``. `calibration` computes this output.
        """
        sessions = []
        for name, samples in self.samples.items():
            columns = correct_samples(name, samples, self.logs[name], calibration, effects)
            sessions.append(RecordedSession(name, self.kinds[name], columns, self.segments[name]))
        return sessions


def read_static(sessions):
    """Return the StaticData of a device.

    `sessions` has the ``kind``, and paths of ``samples`` and ``segments``, of each session by name.
    """
    kinds = {name: s["kind"] for name, s in sessions.items()}
    segments = {n: read_columns(s["segments"], COLUMNS) for n, s in sessions.items()}
    segments = rests_to_use(kinds, segments)
    samples = {name: Samples(sessions[name]["samples"]) for name in segments}
    return StaticData({name: kinds[name] for name in segments}, samples, segments)


def rests_to_use(kinds, segments):
    """Return the segments that serve as static records of a device, a dict by session.

    1. A session of the kind ``static`` counts if it has a rest and no segment of motion. If there
       are such sessions, the result has all of their segments.
    2. Otherwise the result has the longest rest of any session, if that rest lasts at least
       `LONG_REST`.
    3. Otherwise the result is empty.

    `kinds` has the kind of each session, and `segments` its table of segments. The result has the
    `COLUMNS` of this table.
    """
    tables = {n: {c: np.asarray(t[c]) for c in COLUMNS} for n, t in segments.items()}
    rests = [
        (table["end_s"][row] - table["start_s"][row], name, row)
        for name, table in tables.items()
        for row in np.flatnonzero(table["kind"] == STATIC)
    ]
    names = [name for _, name, _ in rests if kinds[name] == "static"]
    static = {name: tables[name] for name in names if MOTION not in tables[name]["kind"]}
    seconds, name, row = max(rests, key=itemgetter(0), default=(0.0, "", 0))
    if static or seconds < LONG_REST:
        return static
    return {name: {column: values[[row]] for column, values in tables[name].items()}}


def static_records(session, log, segments, calibration, mean_time):
    """Return the StaticRecord of a session for each sensor, a dict by sensor.

    A record has the means over windows; every window lies within one undisturbed stretch.

    Parameters
    ----------
    session : str
        Name of the session.
    log : Log
        Samples of the session.
    segments : dict of str to ndarray
        Segments of the session.
    calibration : Calibration
        It computes the output ``K (raw - b)`` of both sensors.
    mean_time : float
        Wanted length of a window, s.
    """
    windows, stretch = _static_windows(log, segments, mean_time)
    ends = np.searchsorted(log.t, windows)
    keep = ends[:, 0] < ends[:, 1]
    windows, stretch, ends = windows[keep], stretch[keep], ends[keep]
    outputs, records = {}, {}
    for sensor, (attribute, _) in OWN.items():
        x = getattr(log, attribute)
        # the output is linear in x, and sums of small differences lose no digits
        outputs[sensor] = getattr(calibration, sensor).output(x[0] + _means(x - x[0], ends))
    temperature = None if log.temperature is None else _means(log.temperature, ends)
    for sensor, values in outputs.items():
        # the input of effects is the mean of the session, as effects do not follow the noise of
        # windows
        level = values.mean(axis=0) if len(values) else np.zeros(3)
        channels = Channels(
            t=windows.mean(axis=1),
            output=np.tile(level, (len(windows), 1)),
            other=outputs[other_sensor(sensor)],
            temperature=temperature,
            history=cache(partial(_mean_history, log, ends, sensor)),
        )
        records[sensor] = StaticRecord(
            session=session, windows=windows, stretch=stretch, values=values, channels=channels
        )
    return records


def _mean_history(log, ends, sensor, function, *constants):
    """Return the means of a function of the whole `log` over each of n windows, (n, …).

    Effects with a memory, such as a lag, need these means, since they depend on the history before
    the present sample. `function` takes the channels of the log that the effects of `sensor` depend
    on, and `constants`, such as a time constant. `ends`, (n, 2), has the index of the first sample
    of each window, and the index of the first sample after it.
    """
    return _means(function(log.channels(sensor), *constants), ends)


def _static_windows(log, segments, mean_time):
    """Return n windows at rest in a session, and for each the undisturbed stretch that it lies in.

    The windows, (n, 2), are start and end, s. The stretches, (n,), are indices of the static
    segments of the session. `log` is the Log and `segments` the table of segments of the session;
    `mean_time` is the wanted length of a window, s.
    """
    static = np.asarray(segments["kind"]) == STATIC
    seconds = np.array([np.asarray(segments[c], float)[static] for c in ("start_s", "end_s")]).T
    interval = np.median(np.diff(log.t)) if len(log.t) > 1 else mean_time
    # the wanted length, if that gives neither too few nor too many windows
    duration = np.diff(seconds).sum()
    length = min(mean_time, duration / LEAST_MEANS)
    length = max(length, LEAST_SAMPLES * interval, duration / MOST_MEANS)
    # number of windows in each stretch; the small term keeps rounding errors from removing the last
    counts = (np.diff(seconds)[:, 0] / length + 1e-6).astype(int)
    stretch = np.repeat(np.arange(len(counts)), counts)
    number = np.arange(len(stretch)) - np.repeat(np.cumsum(counts) - counts, counts)
    starts = seconds[stretch, 0] + length * number
    return np.column_stack([starts, starts + length]), stretch


def _means(x, ends):
    """Return the means of the samples in each of n windows, (n, …).

    `x` are the samples, (k, …). `ends`, (n, 2), has the index of the first sample of each window,
    and the index of the first sample after it.
    """
    return (sums_over(x, ends).T / (ends[:, 1] - ends[:, 0])).T


def _evaluate(channels, function, *constants):
    """Return the `function` of the `channels` of a log and of some `constants`, (N, …).

    `channels` are the LoggedChannels, with N samples. Effects with a memory, such as a lag, need
    the function on the whole log, since they depend on more than the present sample.
    """
    return function(channels, *constants)


def correct_samples(session, samples, log, calibration, effects):
    """Return the samples of a session without the output of some effects, a dict by column.

    The output of an effect is the error that it causes. `session` is the name of the session, and
    `log` the Log of its `samples`. Samples and result are in nominal SI. `effects` has the
    FittedEffects of each sensor: errors of its output ``K (raw - b)``. `calibration` computes this
    output.
    """
    t, columns = log.t, {name: np.array(samples[name], dtype=float) for name in CHANNELS}
    # at rest the effects see the mean output of each sensor
    levels = {}
    for sensor, names in SENSORS.items():
        mean = np.array([[columns[name].mean() for name in names]])
        levels[sensor] = np.broadcast_to(getattr(calibration, sensor).output(mean), (len(t), 3))
    for sensor, fitted_effects in effects.items():
        if not fitted_effects:
            continue
        model = getattr(calibration, sensor)
        channels = Channels(
            t=t,
            output=levels[sensor],
            other=levels[other_sensor(sensor)],
            temperature=log.temperature,
            # functions of effects with a memory are evaluated once, on the whole log
            history=cache(partial(_evaluate, log.channels(sensor))),
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
