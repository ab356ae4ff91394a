"""The log of a session at rest, of whose outputs a part is read at a time."""

from dataclasses import dataclass, field
from functools import cache

import numpy as np

from imuloop.core.effect import Effect
from imuloop.core.memory import filled
from imuloop.core.pieces import FEWEST
from imuloop.core.samples import CHANNELS, SENSORS, TEMPERATURE, TIME, Samples, sums_over

# samples that are worked on at a time
PART = 1 << 18


@dataclass(frozen=True)
class RestLog:
    """The log of a session at rest, SI as logged; of the outputs only a part is read at a time.

    Time and, where logged, temperature with missing values filled are of the whole log.
    """

    samples: Samples
    t: np.ndarray
    temperature: np.ndarray | None
    _cache: dict = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, samples):
        """Return the RestLog of samples, columns by name."""
        samples, temperature = Samples(samples), None
        t = samples[TIME]
        if TEMPERATURE in samples:
            logged = samples[TEMPERATURE]
            temperature = filled(t, logged) if np.isfinite(logged).any() else None
        return cls(samples, t, temperature)

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
                if name not in self._cache:
                    self._cache[name] = filled(self.t, self.samples[name])
                row[:] = self._cache[name][part]
        return values.T

    def means(self, at):
        """Return the mean outputs over rows `at`, (m, 2), as logged, by sensor, (m, 3).

        And whether no sample of the rows lacks a value, (m,).
        """
        key = at.tobytes()
        if key not in self._cache:
            total, lacking = np.zeros((len(at), len(CHANNELS))), np.zeros(len(at))
            for first, x in self.samples.pieces(CHANNELS, PART):
                known = np.isfinite(x)
                if not first:
                    # sums near zero keep their digits
                    ones = zip(x, known, strict=True)
                    centre = np.array([next(iter(row[k]), 0.0) for row, k in ones])
                if not known.all():
                    lacking += sums_over(~known.all(axis=0), at - first)
                    x = np.where(known, x, centre[:, None])
                total += sums_over(x.T - centre, at - first)
            found = total / np.diff(at) + (centre if len(self.t) else 0.0)
            axes = {sensor: list(map(CHANNELS.index, names)) for sensor, names in SENSORS.items()}
            self._cache[key] = {s: found[:, axes[s]] for s in SENSORS}, lacking == 0
        return self._cache[key]

    def parts(self, sensor):
        """Yield part after part of the log and what gives a function's values at its samples.

        The function takes the Channels of a log, outputs as logged, and constants. One that is not
        marked as `imuloop.core.memory.in_pieces` gets the whole log.
        """
        n = len(self.t)
        reach = max((effect.reach for effect in Effect.library.values()), default=0.0)
        more = FEWEST + int(2 * reach / self.interval) if n > 1 else 0
        pasts = {}

        @cache
        def whole(function, *constants):
            return function(LoggedChannels(self, sensor, slice(0, n)), *constants)

        for first in range(0, n, PART):
            part = slice(first, min(first + PART, n))
            about = slice(max(first - more, 0), min(part.stop + more, n))
            own = slice(first - about.start, part.stop - about.start)

            @cache
            def remembered(function, *constants, part=part, about=about, own=own):
                if not getattr(function, "in_pieces", False):
                    return whole(function, *constants)[part]
                past = pasts.setdefault((function, constants), {})
                channels = LoggedChannels(self, sensor, about, past, self.interval)
                return function(channels, *constants)[own]

            yield part, remembered


@dataclass(frozen=True)
class LoggedChannels:
    """The `Channels` of a sensor in a part of a log at rest; an output is read when it is used."""

    log: RestLog
    sensor: str
    part: slice
    past: dict | None = None
    step: float | None = None

    @property
    def t(self):
        """Time, s."""
        return self.log.t[self.part]

    @property
    def temperature(self):
        """Temperature, degC, or None."""
        return None if self.log.temperature is None else self.log.temperature[self.part]

    @property
    def output(self):
        """The sensor's output, SI, shape (n, 3)."""
        return self.log.logged(self.sensor, self.part)

    @property
    def other(self):
        """The other sensor's output, SI, shape (n, 3)."""
        return self.log.logged(other_sensor(self.sensor), self.part)


def other_sensor(sensor):
    """Return the name of the other sensor."""
    (other,) = set(SENSORS) - {sensor}
    return other
