"""The log of a session at rest, whose outputs are read in parts."""

from functools import cache, partial

import numpy as np

from imuloop.core.effect import Effect, LoggedChannels
from imuloop.core.memory import filled
from imuloop.core.samples import CHANNELS, SENSORS, TEMPERATURE, TIME, Samples, sums_over

# samples that a filter reaches beyond `Effect.reach` at least
FEWEST = 16
# samples that are worked on at a time
PART = 1 << 18


class RestLog:
    """The log of a session at rest, SI as logged; its outputs are read in parts.

    Time and, where logged, temperature with missing values filled are of the whole log.
    """

    def __init__(self, samples):
        self.samples = Samples(samples)
        self.t, self.temperature = self.samples[TIME], None
        if TEMPERATURE in self.samples:
            logged = self.samples[TEMPERATURE]
            self.temperature = filled(self.t, logged) if np.isfinite(logged).any() else None
        self._filled = cache(lambda name: filled(self.t, self.samples[name]))
        self._means = {}

    @property
    def interval(self):
        """Median step of time, s; not a number without one."""
        return self.samples.interval or np.nan

    def column(self, name):
        """Return a column of the whole log, as logged, shape (n,)."""
        return np.array(self.samples[name], dtype=float)

    def logged(self, sensor, part):
        """Return the output of a sensor in a part, SI, as logged, missing values filled, (m, 3)."""
        values = self.samples.read(SENSORS[sensor], part.start, part.stop)
        for row, name in zip(values, SENSORS[sensor], strict=True):
            if np.isnan(row).any():
                row[:] = self._filled(name)[part]
        return values.T

    def means(self, at):
        """Return the mean outputs over rows `at`, (m, 2), as logged, by sensor, (m, 3).

        And whether no sample of the rows lacks a value, (m,).
        """
        key = at.tobytes()
        if key not in self._means:
            total, missing, centre = np.zeros((len(at), 6)), np.zeros(len(at)), 0.0
            for first, x in self.samples.pieces(CHANNELS, PART):
                known = np.isfinite(x)
                if not first:
                    # sums near zero keep their digits
                    ones = zip(x, known, strict=True)
                    centre = np.array([next(iter(row[k]), 0.0) for row, k in ones])
                if not known.all():
                    missing += sums_over(~known.all(axis=0), at - first)
                    x = np.where(known, x, centre[:, None])
                total += sums_over(x.T - centre, at - first)
            means = np.split(total / np.diff(at) + centre, 2, axis=1)
            self._means[key] = dict(zip(SENSORS, means, strict=True)), missing == 0
        return self._means[key]

    def parts(self, sensor):
        """Yield each part of the log, with a callable that evaluates functions at its samples.

        The function takes the Channels of a log, outputs as logged, and constants. One that is not
        marked as `imuloop.core.memory.in_pieces` gets the whole log.
        """
        n = len(self.t)
        reach = max((effect.reach for effect in Effect.library.values()), default=0.0)
        more = FEWEST + int(2 * reach / self.interval) if n > 1 else 0
        pasts = {}

        @cache
        def whole(function, *constants):
            return function(self._channels(sensor, slice(0, n)), *constants)

        for first in range(0, n, PART):
            part = slice(first, min(first + PART, n))
            around = slice(max(first - more, 0), min(part.stop + more, n))
            inner = slice(first - around.start, part.stop - around.start)

            @cache
            def remembered(function, *constants, part=part, around=around, inner=inner):
                if not getattr(function, "in_pieces", False):
                    return whole(function, *constants)[part]
                past = pasts.setdefault((function, constants), {})
                channels = self._channels(sensor, around, past, self.interval)
                return function(channels, *constants)[inner]

            yield part, remembered

    def _channels(self, sensor, part, *memory):
        """Return the LoggedChannels of a sensor in a part of the log."""
        temperature = None if self.temperature is None else self.temperature[part]
        outputs = (partial(self.logged, s, part) for s in (sensor, other_sensor(sensor)))
        return LoggedChannels(self.t[part], temperature, *outputs, *memory)


def other_sensor(sensor):
    """Return the name of the other sensor."""
    (other,) = set(SENSORS) - {sensor}
    return other
