"""A static record: means of consecutive windows at rest, and the derivatives of effects."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from imuloop.core.effect import Channels
from imuloop.core.samples import other_sensor, sums_over
from imuloop.core.segments import STATIC
from imuloop.factors.factors import OWN

# fewer means leave a shorter window; more a longer one, for a covariance of n means has n² entries
LEAST_MEANS, MOST_MEANS = 64, 200
# samples that a mean needs at least
LEAST_SAMPLES = 10


@dataclass(frozen=True)
class StaticRecord:
    """Means of one sensor over consecutive windows of a session at rest."""

    session: str  # name of the session
    windows: np.ndarray  # (n, 2): start and end of each window, s
    stretch: np.ndarray  # (n,): which undisturbed stretch each window lies in
    values: np.ndarray  # (n, 3): mean output ``K (raw - b)`` of each axis, SI
    # what an effect sees in the windows. The sensor's own output is its mean over the session: at
    # rest it stands still, and its noise is no cause of anything
    channels: Channels

    @property
    def length(self):
        """Length of each window, s."""
        return np.diff(self.windows, axis=1)[:, 0]

    def derivative(self, effect):
        """Return the derivative of an effect, shape (n, 3, p)."""
        return effect.in_session(self.channels, self.session, self.windows)

    def part(self, rows):
        """Return some windows of the record, rows of them as a mask."""
        windows, stretch, values = (x[rows] for x in (self.windows, self.stretch, self.values))
        channels = self.channels.map(lambda x: x[rows])
        return StaticRecord(self.session, windows, stretch, values, channels)


def window_length(seconds, interval, mean_time):
    """Return the length of the windows of a record of so many seconds at rest, s.

    `mean_time` where the record is neither too short nor too long for it; `interval` is that of
    the samples, s.
    """
    length = min(mean_time, seconds / LEAST_MEANS)
    return max(length, LEAST_SAMPLES * interval, seconds / MOST_MEANS)


def static_record(session, log, segments, calibration, sensor, mean_time):
    """Return the StaticRecord of windows that lie whole in undisturbed stretches of a session.

    Takes the session's name, its Log and segments, and the calibration, which gives ``K (raw - b)``
    of both sensors; `mean_time`, s, as in `window_length`.
    """
    static = np.asarray(segments["kind"]) == STATIC
    seconds = np.array([np.asarray(segments[c], float)[static] for c in ("start_s", "end_s")]).T
    interval = np.median(np.diff(log.t)) if len(log.t) > 1 else mean_time
    length = window_length(np.diff(seconds).sum(), interval, mean_time)
    # the end of a stretch of whole windows is not lost to rounding
    counts = (np.diff(seconds)[:, 0] / length + 1e-6).astype(int)
    stretch = np.repeat(np.arange(len(counts)), counts)
    place = np.arange(len(stretch)) - np.repeat(np.cumsum(counts) - counts, counts)
    starts = seconds[stretch, 0] + length * place
    windows = np.column_stack([starts, starts + length])
    at = np.searchsorted(log.t, windows)
    keep = at[:, 0] < at[:, 1]
    windows, stretch, at = windows[keep], stretch[keep], at[keep]

    def means(x):
        return (sums_over(x, at).T / (at[:, 1] - at[:, 0])).T

    @cache
    def history(function, *constants):
        return means(log.evaluate(sensor, function, *constants))

    def mean_output(name):
        x = getattr(log, OWN[name][0])
        # the output is a straight line in what was logged; sums near zero keep their digits
        return getattr(calibration, name).output(x[0] + means(x - x[0]))

    values, other = mean_output(sensor), mean_output(other_sensor(sensor))
    level = values.mean(axis=0) if len(values) else np.zeros(3)
    channels = Channels(
        windows.mean(axis=1),
        np.tile(level, (len(windows), 1)),
        other,
        None if log.temperature is None else means(log.temperature),
        history,
    )
    return StaticRecord(session, windows, stretch, values, channels)
