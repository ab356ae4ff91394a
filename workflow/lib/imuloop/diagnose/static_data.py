"""The static records of a device, read once for both sensors."""

from dataclasses import dataclass

import pandas as pd

from imuloop.core.samples import read_samples
from imuloop.core.segments import read_segments
from imuloop.diagnose.static_means import rests_to_use, static_record


@dataclass(frozen=True)
class StaticData:
    """Samples at rest.

    Attributes
    ----------
    kinds : dict of str to str
        Kind of each session used.
    samples : dict of str to DataFrame
        Its samples, SI, as logged.
    segments : dict of str to DataFrame
        The static segments used.
    """

    kinds: dict[str, str]
    samples: dict[str, pd.DataFrame]
    segments: dict[str, pd.DataFrame]

    def records(self, sensor, calibration, mean_time):
        """Return the StaticRecord of each session of a sensor, those without a mean left out."""
        found = [
            static_record(name, samples, self.segments[name], calibration, sensor, mean_time)
            for name, samples in self.samples.items()
        ]
        return [record for record in found if len(record.windows)]


def read_static(sessions):
    """Return the StaticData of a device.

    Parameters
    ----------
    sessions : dict of str to dict
        ``kind``, ``samples`` and ``segments`` (paths) of each session.
    """
    kinds = {name: s["kind"] for name, s in sessions.items()}
    used = rests_to_use(kinds, {n: read_segments(s["segments"]) for n, s in sessions.items()})
    return StaticData(
        {name: kinds[name] for name in used},
        {name: read_samples(sessions[name]["samples"]) for name in used},
        used,
    )
