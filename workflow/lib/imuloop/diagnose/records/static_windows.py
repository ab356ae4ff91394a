"""A static record: means over consecutive windows at rest, and the derivatives of effects."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from imuloop.core.samples import other_sensor, sums_over
from imuloop.core.segments import STATIC
from imuloop.factors.factors import OWN
from imuloop.model.effect import Channels

# least and most windows of a record: the window length is changed to keep their number between.
# The upper limit is there because a covariance of n means has n² entries
LEAST_MEANS, MOST_MEANS = 64, 200
# least number of samples in a window
LEAST_SAMPLES = 10


@dataclass(frozen=True)
class StaticRecord:
    """Means of one sensor over consecutive windows of a session at rest."""

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
        """Return the StaticRecord of some windows; `rows` is a mask, (n,) of bool."""
        windows, stretch, values = (x[rows] for x in (self.windows, self.stretch, self.values))
        channels = self.channels.map(lambda x: x[rows])
        return StaticRecord(
            session=self.session, windows=windows, stretch=stretch, values=values, channels=channels
        )


def static_record(session, log, segments, calibration, sensor, mean_time):
    """Return the StaticRecord of a session for one sensor.

    Every window lies within one undisturbed stretch.

    Parameters
    ----------
    session : str
        Name of the session.
    log : Log
    segments : dict of str to ndarray
        Segments of the session.
    calibration : Calibration
        It computes the output ``K (raw - b)`` of both sensors.
    sensor : str
    mean_time : float
        Wanted length of a window, s.
    """
    windows, stretch = _static_windows(log, segments, mean_time)
    ends = np.searchsorted(log.t, windows)
    keep = ends[:, 0] < ends[:, 1]
    windows, stretch, ends = windows[keep], stretch[keep], ends[keep]
    outputs = {}
    for name, (attribute, _) in OWN.items():
        x = getattr(log, attribute)
        # the output is linear in x, and sums of small differences lose no digits
        outputs[name] = getattr(calibration, name).output(x[0] + _means(x - x[0], ends))
    # the input of effects is the mean of the session: they do not follow the noise of the windows
    values, other = outputs[sensor], outputs[other_sensor(sensor)]
    level = values.mean(axis=0) if len(values) else np.zeros(3)
    channels = Channels(
        t=windows.mean(axis=1),
        output=np.tile(level, (len(windows), 1)),
        other=other,
        temperature=None if log.temperature is None else _means(log.temperature, ends),
        # a function of the whole log and its constants is evaluated, then averaged over the windows
        history=cache(lambda *function: _means(log.evaluate(sensor, *function), ends)),
    )
    return StaticRecord(
        session=session, windows=windows, stretch=stretch, values=values, channels=channels
    )


def _static_windows(log, segments, mean_time):
    """Return the windows in the undisturbed stretches of a session, and the stretch of each.

    The windows are start and end, s, (n, 2), and the stretches an index, (n,). `log` is the Log and
    `segments` the table of segments of the session; `mean_time` is the wanted length of a window,
    s.
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
    """Return the means of samples, (k, …), over n windows, (n, …).

    `ends`, (n, 2), has the indices of the first sample of each window and of the first after it.
    """
    return (sums_over(x, ends).T / (ends[:, 1] - ends[:, 0])).T
