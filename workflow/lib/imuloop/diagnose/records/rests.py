"""The static records of a device, read once for both sensors."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from imuloop.calibrate.recording import Log
from imuloop.core.samples import Samples, read_columns
from imuloop.core.segments import MOTION, STATIC, power_cycles
from imuloop.diagnose.records.static_windows import static_record

# s; a rest of another session stands in for a static one from this length on: a shorter one shows
# no effect that the poses do not show better
LONG_REST = 600.0

# of the segments, what the static record and the noise take
COLUMNS = "start_s", "end_s", "kind", "tilt_rad"


@dataclass(frozen=True)
class StaticData:
    """Samples at rest."""

    kinds: dict  # of each session used
    samples: dict  # its Samples, SI, as logged
    segments: dict  # its segments, as `rests_to_use` gives them

    @cached_property
    def logs(self):
        """The Log of each session."""
        return {name: Log.of(samples) for name, samples in self.samples.items()}

    def records(self, sensor, calibration, mean_time):
        """Return the StaticRecord of each power cycle of all sessions that has a mean.

        Arguments as in `static_record`; for 0 s windows are the shortest worth a spectrum.
        """
        found = []
        for name, table in self.segments.items():
            record = static_record(name, self.logs[name], table, calibration, sensor, mean_time)
            cycle = power_cycles(table)[np.asarray(table["kind"]) == STATIC][record.stretch]
            found += [record.part(cycle == k) for k in np.unique(cycle)]
        return [r for r in found if len(r.windows)]


def read_static(sessions):
    """Return the StaticData of a device from ``kind``, ``samples`` and ``segments`` by session."""
    kinds = {name: s["kind"] for name, s in sessions.items()}
    segments = {n: read_columns(s["segments"], COLUMNS) for n, s in sessions.items()}
    used = rests_to_use(kinds, segments)
    return StaticData(
        {name: kinds[name] for name in used},
        {name: Samples(sessions[name]["samples"]) for name in used},
        used,
    )


def rests_to_use(kinds, segments):
    """Return which stretches of which sessions are the static record of a device.

    All static sessions, what lies between their rests included, but none in which the device
    moved; where there is none, the longest rest of all others if it lasts. Kind and segments are by
    session; returned are ``start_s``, ``end_s``, ``kind`` and ``tilt_rad`` of the segments to use.
    """
    tables = {n: {c: np.asarray(t[c]) for c in COLUMNS} for n, t in segments.items()}
    rests = [
        (table["end_s"][at] - table["start_s"][at], name, at)
        for name, table in tables.items()
        for at in np.flatnonzero(table["kind"] == STATIC)
    ]
    static = {
        name: tables[name]
        for _, name, _ in rests
        if kinds[name] == "static" and MOTION not in tables[name]["kind"]
    }
    seconds, name, at = max(rests, key=lambda rest: rest[0], default=(0.0, "", 0))
    if static or seconds < LONG_REST:
        return static
    return {name: {column: values[[at]] for column, values in tables[name].items()}}
