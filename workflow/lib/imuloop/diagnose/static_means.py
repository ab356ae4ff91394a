"""A static record: means of consecutive windows at rest, and what an effect sees in them."""

from dataclasses import dataclass, replace

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


def static_record(session, samples, segments, calibration, sensor, mean_time):
    """Return the means of windows that lie whole in the undisturbed stretches of a session.

    Parameters
    ----------
    session : str
        Its name.
    samples, segments : DataFrame
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
    static = segments[segments["kind"] == STATIC]
    seconds = static[["start_s", "end_s"]].to_numpy(dtype=float)
    t = samples[TIME].to_numpy()
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
    whole_rows = np.isfinite(samples[[*ACCELERATION, *ANGULAR_RATE]]).all(axis=1)
    known = np.concatenate([[0], np.cumsum(whole_rows)])[at]
    count = np.diff(at, axis=1)[:, 0]
    # a mean over missing values is none
    keep = (count > 0) & (np.diff(known, axis=1)[:, 0] == count)
    windows, stretch, at = windows[keep], stretch[keep], at[keep]

    def mean(values):
        total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
        count = np.diff(at, axis=1).reshape(-1, *[1] * (values.ndim - 1))
        return (total[at[:, 1]] - total[at[:, 0]]) / count

    # missing values would reach every later sum
    logged = {
        name: np.column_stack([filled(t, samples[column].to_numpy()) for column in columns])
        for name, columns in COLUMNS.items()
    }
    output = {name: getattr(calibration, name).output(values) for name, values in logged.items()}
    (other,) = set(COLUMNS) - {sensor}
    # a mean near zero keeps the digits of cumulative sums
    centre = output[sensor].mean(axis=0) if len(t) else 0.0
    values = mean(output[sensor] - centre) + centre
    temperature = None
    if TEMPERATURE in samples and np.isfinite(samples[TEMPERATURE]).any():
        temperature = filled(t, samples[TEMPERATURE].to_numpy())
    whole = Channels(t, logged[sensor], logged[other], temperature)
    remembered = {}

    def history(function, *constants):
        key = function, constants
        if key not in remembered:
            remembered[key] = mean(function(whole, *constants))
        return remembered[key]

    level = values.mean(axis=0) if len(values) else np.zeros(3)
    channels = Channels(
        windows.mean(axis=1),
        np.tile(level, (len(windows), 1)),
        mean(output[other]),
        None if temperature is None else mean(temperature),
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
    segments : dict of str to DataFrame
        Segments of each session.

    Returns
    -------
    dict of str to DataFrame
        Static segments of the sessions to use.
    """
    rests = {name: s[s["kind"] == STATIC] for name, s in segments.items()}
    static = {name: r for name, r in rests.items() if kinds[name] == "static" and len(r)}
    if static:
        return static
    longest = {}
    for name, r in rests.items():
        seconds = (r["end_s"] - r["start_s"]).to_numpy()
        if len(r) and seconds.max() >= INITIAL_REST:
            longest[name] = (seconds.max(), r.iloc[[int(seconds.argmax())]])
    if not longest:
        return {}
    name = max(longest, key=lambda n: longest[n][0])
    return {name: longest[name][1]}
