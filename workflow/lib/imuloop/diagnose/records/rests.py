"""The static records of a device, read once for both sensors."""

from dataclasses import dataclass, field

import numpy as np

from imuloop.core.rest_log import RestLog
from imuloop.core.samples import Samples, read_columns
from imuloop.core.segments import STATIC, runs
from imuloop.diagnose.records.means import part_of, rests_to_use, static_record


@dataclass(frozen=True)
class StaticData:
    """Samples at rest.

    Attributes
    ----------
    kinds : dict of str to str
        Kind of each session used.
    samples : dict of str to (Samples, DataFrame or dict)
        Its samples by column, SI, as logged.
    segments : dict of str to (dict or DataFrame)
        Its segments, as `rests_to_use` gives them.
    """

    kinds: dict
    samples: dict
    segments: dict
    _logs: dict = field(default_factory=dict, repr=False)

    def log(self, name):
        """Return the RestLog of a session."""
        if name not in self._logs:
            self._logs[name] = RestLog.of(self.samples[name])
        return self._logs[name]

    def records(self, sensor, calibration, mean_time):
        """Return the StaticRecord of each run of each session, those without a mean left out.

        Parameters
        ----------
        sensor : str
            The sensor.
        calibration : Calibration
            Gives ``K (raw - b)``.
        mean_time : float
            Length of a window, s; the shortest that are worth a spectrum for 0.
        """
        found = []
        for name, table in self.segments.items():
            record = static_record(name, self.log(name), table, calibration, sensor, mean_time)
            run = runs(table)[np.asarray(table["kind"]) == STATIC][record.stretch]
            found += [part_of(record, run == k) for k in np.unique(run)]
        return [r for r in found if len(r.windows)]


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
        {name: Samples(sessions[name]["samples"]) for name in used},
        used,
    )
