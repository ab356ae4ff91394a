"""The samples at rest of a device, read once for both sensors."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from imuloop.calibrate.recording import Log
from imuloop.core.samples import Samples, read_columns
from imuloop.core.segments import MOTION, STATIC, power_cycles
from imuloop.diagnose.records.static_windows import static_record

# s; least length of a rest in another session that replaces a static session: the poses show all
# effects better than a shorter one
LONG_REST = 600.0

# columns of the segments that static records and noise need
COLUMNS = "start_s", "end_s", "kind", "tilt_rad"


@dataclass(frozen=True)
class StaticData:
    """Samples of a device at rest."""

    kinds: dict  # kind of each session that is used, by name
    samples: dict  # Samples of each session, nominal SI
    segments: dict  # table of the segments of each session that are used

    @cached_property
    def logs(self):
        """The Log of each session, by name."""
        return {name: Log.of(samples) for name, samples in self.samples.items()}

    def records(self, sensor, calibration, mean_time):
        """Return a list with a StaticRecord of one sensor for each power cycle of all sessions.

        `calibration` computes the output ``K (raw - b)``. `mean_time`, s, is the wanted length of a
        window; 0 gives the shortest windows that are allowed.
        """
        records = []
        for name, table in self.segments.items():
            record = static_record(name, self.logs[name], table, calibration, sensor, mean_time)
            # the stretches of a record are the static segments
            cycle = power_cycles(table)[np.asarray(table["kind"]) == STATIC][record.stretch]
            records += [record.part(cycle == k) for k in np.unique(cycle)]
        return [r for r in records if len(r.windows)]


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
    """Return the segments that are the static records of a device, by session.

    They are all segments of the static sessions in which the device did not move. Without such a
    session, they are the longest rest of all other sessions, if it lasts `LONG_REST`. `kinds` has
    the kind and `segments` the table of segments of each session; the result has the `COLUMNS` of
    the segments of each session that is used.
    """
    tables = {n: {c: np.asarray(t[c]) for c in COLUMNS} for n, t in segments.items()}
    rests = [
        (table["end_s"][row] - table["start_s"][row], name, row)
        for name, table in tables.items()
        for row in np.flatnonzero(table["kind"] == STATIC)
    ]
    names = [name for _, name, _ in rests if kinds[name] == "static"]
    static = {name: tables[name] for name in names if MOTION not in tables[name]["kind"]}
    seconds, name, row = max(rests, key=lambda rest: rest[0], default=(0.0, "", 0))
    if static or seconds < LONG_REST:
        return static
    return {name: {column: values[[row]] for column, values in tables[name].items()}}
