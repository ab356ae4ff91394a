"""The results of all stages for a device, read from its folder."""

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import pandas as pd

from imuloop.core.files import read_json
from imuloop.core.noise_model import AxisNoise
from imuloop.core.samples import CHANNELS, SENSORS, Samples, read_metadata
from imuloop.model.calibration import Calibration

XYZ = ("x", "y", "z")
# unit of the output of each sensor, as printed and as in files
UNITS = {"accelerometer": "m/s²", "gyroscope": "rad/s"}
FILE_UNITS = {"accelerometer": "m/s^2", "gyroscope": "rad/s"}
CALIBRATIONS = {
    "six_position": "six_position.json",
    "multi_position": "multi_position.json",
    "final": "calibration.json",
}


@dataclass(frozen=True)
class SessionResults:
    """The content of the result files of one session of a device.

    `quality` is the content of quality.json, `source` the metadata of samples.parquet, `segments`
    the table of rests, moves and gaps, and `segmentation` the metadata of this table. `allan` and
    `spectra` are the tables of Allan deviations and of power spectral densities.
    """

    name: str
    kind: str
    quality: dict
    source: dict
    samples_path: Path
    segments: pd.DataFrame
    segmentation: dict
    allan: pd.DataFrame = field(default_factory=pd.DataFrame)
    spectra: pd.DataFrame = field(default_factory=pd.DataFrame)

    @property
    def rejected(self):
        """Whether ingest rejected the log of the session, so that it was not used."""
        return self.quality["status"] != "ok"

    @property
    def reasons(self):
        """The reasons, texts, for which ingest rejected the log; empty for a session in use."""
        return self.quality["reasons"]

    @property
    def poses(self):
        """Number of poses, different attitudes in which the device rested."""
        return self.segments["pose"][self.segments["pose"] >= 0].nunique()

    def seconds(self, kind):
        """Return the total length of the segments of one `kind`, s; `STATIC` are the rests."""
        s = self.segments[self.segments["kind"] == kind]
        return float((s["end_s"] - s["start_s"]).sum())

    @cached_property
    def samples(self):
        """The Samples of the session, a table whose columns are read when they are first used."""
        return Samples(self.samples_path)


@dataclass(frozen=True)
class DeviceResults:
    """The content of all result files of one device.

    `calibrations` are by method, as in `CALIBRATIONS`. `noise` and `diagnosis` are the contents of
    noise.json and diagnosis.json. `poses`, `moves` and `reference` are the tables of the residuals
    of poses, of moves, and of windows that are compared with a reference.
    """

    name: str
    label: str
    folder: Path
    sessions: tuple[SessionResults, ...] = ()
    calibrations: dict[str, Calibration] = field(default_factory=dict)
    noise: dict = field(default_factory=dict)
    diagnosis: dict = field(default_factory=dict)
    poses: pd.DataFrame = field(default_factory=pd.DataFrame)
    moves: pd.DataFrame = field(default_factory=pd.DataFrame)
    reference: pd.DataFrame = field(default_factory=pd.DataFrame)
    data_sheet: dict = field(default_factory=dict)  # as in `imuloop.sensors.device_figures`

    @property
    def simulated(self):
        """Whether any log of the device was simulated."""
        return any(s.quality["simulated"] for s in self.sessions)

    @property
    def title(self):
        """The label of the device; a simulated device has "(simulated)" or such a label."""
        plain = not self.simulated or "simulated" in self.label.lower()
        return self.label if plain else f"{self.label} (simulated)"

    @property
    def used(self):
        """The SessionResults of the sessions whose logs were not rejected, a tuple."""
        return tuple(s for s in self.sessions if not s.rejected)

    @cached_property
    def axes(self):
        """The noise of each channel, a dict of `AxisNoise` by channel, ``ax`` to ``gz``."""
        return axes_of(self.noise.get("axes", {}))

    @property
    def figures(self):
        """Folder of the drawings and of the CSV files with their numbers."""
        return self.folder / "figures"


def axes_of(content):
    """Return the noise of each channel, a dict of AxisNoise by channel, ``ax`` to ``gz``.

    `content` is the entry ``axes`` of noise.json. A channel that it lacks gets an AxisNoise in
    which no coefficient is known.
    """
    return {c: AxisNoise.from_dict(content[c]) if c in content else AxisNoise() for c in CHANNELS}


def of_axes(values, sensor):
    """Return (axis, value) for each axis of a sensor, a list; a missing channel has the value None.

    `values` is a dict by channel, ``ax`` to ``gz``, and `sensor` the name of the sensor.
    """
    return [(axis, values.get(c)) for axis, c in zip(XYZ, SENSORS[sensor], strict=True)]


def read_device(device):
    """Return the `DeviceResults` of a device: the content of all its result files.

    `device` is the `chain.Device`, whose folder has the files.
    """
    folder = Path(device.folder)
    spectra = pd.read_parquet(folder / "spectra.parquet")
    return DeviceResults(
        device.name,
        device.label or device.name,
        folder,
        tuple(_session(folder / name, kind, spectra) for name, kind in device.kinds.items()),
        {method: Calibration.from_json(folder / file) for method, file in CALIBRATIONS.items()},
        *(read_json(folder / f"{stem}.json") for stem in ("noise", "diagnosis")),
        *(
            pd.read_parquet(folder / f"{table}.parquet")
            for table in ("poses", "moves", "reference")
        ),
        device.data_sheet,
    )


def _session(folder, kind, spectra):
    """Return the SessionResults of one session: the content of its result files.

    `folder` is the folder of the session, a Path, `kind` the kind of the session, such as
    ``static``, and `spectra` the table of spectra.parquet, which has the rows of all sessions.
    """
    samples, segments = folder / "samples.parquet", folder / "segments.parquet"
    return SessionResults(
        folder.name,
        kind,
        read_json(folder / "quality.json"),
        read_metadata(samples),
        samples,
        pd.read_parquet(segments),
        read_metadata(segments),
        pd.read_parquet(folder / "allan.parquet"),
        spectra[spectra["session"] == folder.name].reset_index(drop=True),
    )
