"""A static record: means of consecutive windows at rest, and what an effect sees in them."""

from dataclasses import dataclass, field, replace

import numpy as np

from imuloop.core.effect import Channels
from imuloop.core.memory import filled
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, TEMPERATURE, TIME
from imuloop.core.segments import STATIC

# fewer means leave a shorter window; more a longer one, for a covariance of n means has n² entries
LEAST_MEANS, MOST_MEANS = 64, 2000
# samples that a mean needs at least
LEAST_SAMPLES = 10
# s; a rest of another session stands in for a static one from this length on
INITIAL_REST = 30.0
COLUMNS = {"accelerometer": ACCELERATION, "gyroscope": ANGULAR_RATE}


@dataclass(frozen=True)
class StaticRecord:
    """Means of one sensor over consecutive windows of a session at rest.

    Attributes
    ----------
    session : str
        Name of the session.
    windows : ndarray, shape (n, 2)
        Start and end of each window, s.
    stretch : ndarray of int, shape (n,)
        Which undisturbed stretch each window lies in.
    values : ndarray, shape (n, 3)
        Mean output ``K (raw - b)`` of each axis, SI.
    channels : Channels
        What an effect sees in the windows. The sensor's own output is its mean over the session:
        at rest it stands still, and its noise is no cause of anything.
    """

    session: str
    windows: np.ndarray
    stretch: np.ndarray
    values: np.ndarray
    channels: Channels

    @property
    def length(self):
        """Return the length of each window, s."""
        return np.diff(self.windows, axis=1)[:, 0]

    def merged(self, most):
        """Return the record with so many neighbours in one window that at most `most` remain.

        A few more may remain where stretches do not divide evenly.
        """
        count = -(-len(self.windows) // most)
        place = np.arange(len(self.windows)) - np.searchsorted(self.stretch, self.stretch)
        first = np.flatnonzero(place % count == 0)
        if count == 1 or not len(first):
            return self
        last = np.append(first[1:], len(self.windows)) - 1
        counts = last - first + 1

        def mean(values):
            shape = (-1, *[1] * (values.ndim - 1))
            return np.add.reduceat(values, first, axis=0) / counts.reshape(shape)

        c = self.channels
        channels = Channels(
            mean(c.t),
            mean(c.output),
            mean(c.other),
            None if c.temperature is None else mean(c.temperature),
            lambda function, *constants: mean(c.history(function, *constants)),
        )
        return replace(
            self,
            windows=np.column_stack([self.windows[first, 0], self.windows[last, 1]]),
            stretch=self.stretch[first],
            values=mean(self.values),
            channels=channels,
        )


def part_of(record, rows):
    """Return some windows of a record, rows of them as a mask."""
    c = record.channels
    channels = Channels(
        c.t[rows],
        c.output[rows],
        c.other[rows],
        None if c.temperature is None else c.temperature[rows],
        lambda function, *constants: c.history(function, *constants)[rows],
    )
    return replace(
        record,
        windows=record.windows[rows],
        stretch=record.stretch[rows],
        values=record.values[rows],
        channels=channels,
    )


def window_length(seconds, interval, mean_time):
    """Return the length of the windows of a record, s.

    Parameters
    ----------
    seconds : float
        Time at rest.
    interval : float
        Sampling interval, s.
    mean_time : float
        Length if the record is neither too short nor too long for it, s.
    """
    length = min(mean_time, seconds / LEAST_MEANS)
    return max(length, LEAST_SAMPLES * interval, seconds / MOST_MEANS)


@dataclass(frozen=True)
class RestLog:
    """The log of a session at rest, missing values filled.

    Attributes
    ----------
    t : ndarray, shape (n,)
        Time, s.
    logged : dict of str to ndarray, shape (n, 3)
        Each sensor's output, SI, as logged.
    temperature : ndarray, shape (n,), or None
        degC.
    whole : ndarray of int, shape (n + 1,)
        How many samples before each lack nothing.
    """

    t: np.ndarray
    logged: dict
    temperature: np.ndarray | None
    whole: np.ndarray
    _means: dict = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, samples):
        """Return the RestLog of samples, columns by name."""
        t, columns = np.asarray(samples[TIME]), [*ACCELERATION, *ANGULAR_RATE]
        whole = np.isfinite([np.asarray(samples[name]) for name in columns]).all(axis=0)
        # missing values would reach every later sum
        logged = {
            sensor: np.column_stack([filled(t, np.asarray(samples[name])) for name in names])
            for sensor, names in COLUMNS.items()
        }
        temperature = None
        if TEMPERATURE in samples and np.isfinite(np.asarray(samples[TEMPERATURE])).any():
            temperature = filled(t, np.asarray(samples[TEMPERATURE]))
        return cls(t, logged, temperature, np.concatenate([[0], np.cumsum(whole)]))

    def means(self, at):
        """Return the mean output of each sensor over rows `at`, shape (m, 2), as logged."""
        key = at.tobytes()
        if key not in self._means:
            self._means[key] = {}
            for sensor, values in self.logged.items():
                # a mean near zero keeps the digits of cumulative sums
                centre = values.mean(axis=0) if len(values) else 0.0
                self._means[key][sensor] = mean_over(values - centre, at) + centre
        return self._means[key]


def mean_over(values, at):
    """Return means of values over rows `at`, shape (m, 2): from the first to before the last."""
    total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    count = np.diff(at, axis=1).reshape(-1, *[1] * (values.ndim - 1))
    return (total[at[:, 1]] - total[at[:, 0]]) / count


def static_record(session, samples, segments, calibration, sensor, mean_time):
    """Return the means of windows that lie whole in the undisturbed stretches of a session.

    Parameters
    ----------
    session : str
        Its name.
    samples : RestLog, DataFrame or dict
        Of the session.
    segments : DataFrame or dict
        Of the session.
    calibration : Calibration
        Gives ``K (raw - b)`` of both sensors.
    sensor : {'accelerometer', 'gyroscope'}
        The sensor.
    mean_time : float
        Length of a window, s, as in `window_length`.

    Returns
    -------
    StaticRecord
        In order of time.
    """
    log = samples if isinstance(samples, RestLog) else RestLog.of(samples)
    static = np.asarray(segments["kind"]) == STATIC
    seconds = np.array([np.asarray(segments[c], float)[static] for c in ("start_s", "end_s")]).T
    t = log.t
    interval = np.median(np.diff(t)) if len(t) > 1 else mean_time
    length = window_length(np.diff(seconds).sum(), interval, mean_time)
    windows, stretch = [np.zeros((0, 2))], []
    for number, (start, end) in enumerate(seconds):
        # the end of a stretch of whole windows is not lost to rounding
        count = int((end - start) / length + 1e-6)
        starts = start + length * np.arange(count)
        windows.append(np.column_stack([starts, starts + length]))
        stretch += [number] * count
    windows, stretch = np.concatenate(windows), np.array(stretch, dtype=int)
    at = np.searchsorted(t, windows)
    count = np.diff(at, axis=1)[:, 0]
    # a mean over missing values is none
    keep = (count > 0) & (np.diff(log.whole[at], axis=1)[:, 0] == count)
    windows, stretch, at = windows[keep], stretch[keep], at[keep]

    (other,) = set(COLUMNS) - {sensor}
    # the output is a straight line in what was logged: so are its means
    output = {
        name: getattr(calibration, name).output(values) for name, values in log.means(at).items()
    }
    values = output[sensor]
    whole = Channels(t, log.logged[sensor], log.logged[other], log.temperature)
    remembered = {}

    def history(function, *constants):
        key = function, constants
        if key not in remembered:
            remembered[key] = mean_over(function(whole, *constants), at)
        return remembered[key]

    level = values.mean(axis=0) if len(values) else np.zeros(3)
    channels = Channels(
        windows.mean(axis=1),
        np.tile(level, (len(windows), 1)),
        output[other],
        None if log.temperature is None else mean_over(log.temperature, at),
        history,
    )
    return StaticRecord(session, windows, stretch, values, channels)


def rests_to_use(kinds, segments):
    """Return which stretches of which sessions are the static record of a device.

    All static sessions; where there is none, the longest rest of all others if it lasts.

    Parameters
    ----------
    kinds : dict of str to str
        Kind of each session.
    segments : dict of str to (DataFrame or dict)
        Segments of each session.

    Returns
    -------
    dict of str to dict
        ``start_s``, ``end_s`` and ``kind`` of the static segments of the sessions to use.
    """
    rests = {
        name: rows(table, np.flatnonzero(np.asarray(table["kind"]) == STATIC))
        for name, table in segments.items()
    }
    static = {n: r for n, r in rests.items() if kinds[n] == "static" and len(r["kind"])}
    if static:
        return static
    longest = {}
    for name, r in rests.items():
        seconds = r["end_s"] - r["start_s"]
        if len(seconds) and seconds.max() >= INITIAL_REST:
            longest[name] = (seconds.max(), rows(r, [int(seconds.argmax())]))
    if not longest:
        return {}
    name = max(longest, key=lambda n: longest[n][0])
    return {name: longest[name][1]}


def rows(segments, index):
    """Return some segments, their columns as arrays."""
    return {name: np.asarray(segments[name])[index] for name in ("start_s", "end_s", "kind")}
