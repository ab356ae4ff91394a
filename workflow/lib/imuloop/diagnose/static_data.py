"""The static records of a device, read once for both sensors."""

from dataclasses import dataclass, field

import numpy as np

from imuloop.core.samples import Columns, read_columns
from imuloop.core.segments import STATIC, runs
from imuloop.diagnose.static_means import RestLog, part_of, rests_to_use, static_record


@dataclass(frozen=True)
class StaticData:
    """Samples at rest.

    Attributes
    ----------
    kinds : dict of str to str
        Kind of each session used.
    samples : dict of str to (Columns, DataFrame or dict)
        Its samples by column, SI, as logged.
    segments : dict of str to (dict or DataFrame)
        Its segments, as `rests_to_use` gives them.
    """

    kinds: dict
    samples: dict
    segments: dict
    _logs: dict = field(default_factory=dict, repr=False)
    _records: dict = field(default_factory=dict, repr=False)

    def log(self, name):
        """Return the RestLog of a session."""
        if name not in self._logs:
            self._logs[name] = RestLog.of(self.samples[name])
        return self._logs[name]

    def records(self, sensor, calibration, mean_time):
        """Return the StaticRecord of each run of each session, those without a mean left out."""
        # the calibration is kept with its records: no other has its number meanwhile
        key = sensor, mean_time, id(calibration)
        if key not in self._records:
            found = []
            for name, table in self.segments.items():
                record = static_record(name, self.log(name), table, calibration, sensor, mean_time)
                run = runs(table)[np.asarray(table["kind"]) == STATIC][record.stretch]
                found += [part_of(record, run == k) for k in np.unique(run)]
            self._records[key] = calibration, [r for r in found if len(r.windows)]
        return self._records[key][1]


def read_static(sessions):
    """Return the StaticData of a device.

    Parameters
    ----------
    sessions : dict of str to dict
        ``kind``, ``samples`` and ``segments`` (paths) of each session.
    """
    kinds = {name: s["kind"] for name, s in sessions.items()}
    columns = "start_s", "end_s", "kind"
    segments = {n: read_columns(s["segments"], columns) for n, s in sessions.items()}
    used = rests_to_use(kinds, segments)
    return StaticData(
        {name: kinds[name] for name in used},
        {name: Columns(sessions[name]["samples"]) for name in used},
        used,
    )
