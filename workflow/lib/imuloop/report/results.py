"""What the stages found out about a device, read from its folder."""

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from imuloop.core.failure import Failure, read_failures
from imuloop.core.files import read_json
from imuloop.core.model import Calibration
from imuloop.core.samples import (
    ACCELERATION,
    ANGULAR_RATE,
    Samples,
    read_columns,
    read_metadata,
)
from imuloop.core.tables import read_session
from imuloop.report.columns import groups

SENSORS = {"accelerometer": ACCELERATION, "gyroscope": ANGULAR_RATE}
XYZ = ("x", "y", "z")
# unit of what each sensor gives, as printed and as in files
UNITS = {"accelerometer": "m/s²", "gyroscope": "rad/s"}
FILE_UNITS = {"accelerometer": "m/s^2", "gyroscope": "rad/s"}


@dataclass(frozen=True)
class Session:
    """One session of a device.

    Attributes
    ----------
    name, kind : str
        As in the config.
    quality : dict
        Content of quality.json.
    source : dict
        Metadata of the samples: source, hashes, units.
    samples_path : Path
        The samples.
    segments : dict of str to ndarray
        Segments, a column each; without rows for a rejected session.
    segmentation : dict
        What the segmentation chose.
    allan : dict of str to ndarray, or None
        Allan deviation, where it was computed.
    views : dict of str to ndarray, or None
        Power spectral density, autocorrelation and other deviations, where they were computed.
    """

    name: str
    kind: str
    quality: dict
    source: dict
    samples_path: Path
    segments: dict
    segmentation: dict
    allan: dict | None
    views: dict | None = None

    @property
    def rejected(self):
        """Whether the session could not be used."""
        return self.quality.get("status") != "ok" or bool(self.segmentation.get("failed"))

    @property
    def reasons(self):
        """Why the session could not be used."""
        failed = self.segmentation.get("failed")
        return (self.quality.get("reasons") or []) + ([str(Failure(**failed))] if failed else [])

    @property
    def rests(self):
        """Which segments are rests of each pose, by its number."""
        return {pose: at for pose, at in groups(self.segments["pose"]).items() if pose >= 0}

    @property
    def has_allan(self):
        """Whether there is an Allan deviation."""
        return self.allan is not None and len(self.allan["axis"]) > 0

    def seconds(self, kind):
        """Return how long all segments of a kind are, s."""
        s = self.segments
        return float((s["end_s"] - s["start_s"])[s["kind"] == kind].sum())

    @cached_property
    def samples(self):
        """The samples, a column at a time."""
        return Samples(self.samples_path)


@dataclass(frozen=True)
class Device:
    """All results of one device.

    Attributes
    ----------
    name, label : str
        As in the config.
    folder : Path
        Its results.
    sessions : tuple of Session
        In the config's order.
    calibrations : dict of str to Calibration
        By method: ``six_position``, ``multi_position``, ``final``; only those that exist.
    noise, diagnosis : dict
        Content of noise.json and diagnosis.json; empty where there is none.
    failures : tuple of (str or None, Failure)
        What went wrong in its stages, and in which session.
    poses, moves : dict of str to ndarray
        Columns of poses.parquet and moves.parquet; empty where there is none.
    """

    name: str
    label: str
    folder: Path
    sessions: tuple[Session, ...]
    calibrations: dict[str, Calibration]
    noise: dict
    diagnosis: dict
    failures: tuple = ()
    poses: dict = field(default_factory=dict)
    moves: dict = field(default_factory=dict)

    @property
    def simulated(self):
        """Whether any of its logs was made by a computer."""
        return any(s.quality.get("simulated") or s.source.get("simulated") for s in self.sessions)

    @property
    def title(self):
        """The label, which says of a simulated device that it is one."""
        told = not self.simulated or "simulated" in self.label.lower()
        return self.label if told else f"{self.label} (simulated)"

    @property
    def used(self):
        """The sessions that were not rejected."""
        return tuple(s for s in self.sessions if not s.rejected)


def _session(folder, name, kind):
    path = folder / name
    samples, segments, allan = (
        path / f"{stem}.parquet" for stem in ("samples", "segments", "allan")
    )
    views = folder / "views.parquet"
    return Session(
        name,
        kind,
        read_json(path / "quality.json"),
        read_metadata(samples),
        samples,
        read_columns(segments),
        read_metadata(segments),
        read_columns(allan) if allan.exists() else None,
        read_session(views, name) if views.exists() else None,
    )


def read_device(name, label, folder, sessions):
    """Return the results of a device.

    Parameters
    ----------
    name, label : str
        As in the config.
    folder : path-like
        ``results/<device>``.
    sessions : dict of str to str
        Kind of each session by its name.
    """
    folder = Path(folder)
    files = {
        "six_position": "six_position.json",
        "multi_position": "multi_position.json",
        "final": "calibration.json",
    }
    content = {
        stem: read_json(folder / f"{stem}.json") if (folder / f"{stem}.json").exists() else {}
        for stem in ("noise", "diagnosis")
    }
    return Device(
        name,
        label,
        folder,
        tuple(_session(folder, session, kind) for session, kind in sessions.items()),
        {
            method: Calibration.from_json(folder / file)
            for method, file in files.items()
            if (folder / file).exists()
        },
        content["noise"],
        content["diagnosis"],
        tuple(read_failures(folder, sessions)),
        *(read_columns(folder / f"{name}.parquet") for name in ("poses", "moves")),
    )


def base_parameters(sensor):
    """Return a sensor's bias, scale factor error and misalignment with their σ.

    Parameters
    ----------
    sensor : SensorCalibration
        A calibration.

    Returns
    -------
    dict
        ``bias`` (SI), ``scale`` (relative), each a pair of value and σ, shape (3,), and
        ``misalignment`` {(i, j): (value, σ)}, rad; σ is not-a-number where it was not estimated.
    """
    std, unit = sensor.std, sensor.raw_unit
    sigma = {p: np.array([std.get(f"{p}{i}", np.nan) for i in range(3)]) for p in "Kb"}
    return {
        "bias": (unit.to_si(sensor.b), sigma["b"] * unit.scale),
        "scale": (sensor.K / unit.scale - 1, sigma["K"] / unit.scale),
        "misalignment": {
            (i, j): (sensor.T[i, j], std.get(f"T{i}{j}", np.nan))
            for i in range(3)
            for j in range(3)
            if i != j
        },
    }
