"""The stages as calls, paths in and files out.

A stage reads and writes below the device's folder, ``results/<device>``, by the names of the
contract. A log that cannot be used is a result; an exception is a bug or a machine that fails. Each
stage imports its own library, so that the code digest of a job covers its stage alone.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from imuloop.core.errors import ImuloopError, MachineFault

# the files of a session
_TABLES = ("samples", "segments", "allan")


@dataclass(frozen=True)
class Device:
    """A device as the stages take it."""

    name: str
    folder: Path  # its results
    kinds: Mapping  # kind of each session by its name
    label: str = ""  # name in the report
    gravity: float = 9.80665  # local, m/s^2
    # as `imuloop.sensors.device_figures` returns them
    nominal: Mapping = field(default_factory=dict)
    full_scale: Mapping = field(default_factory=dict)
    tolerances: Mapping = field(default_factory=dict)
    data_sheet: Mapping = field(default_factory=dict)
    # settings of the stages that are not their defaults
    segment: Mapping = field(default_factory=dict)
    noise: Mapping = field(default_factory=dict)
    calibrate: Mapping = field(default_factory=dict)
    diagnose: Mapping = field(default_factory=dict)
    prior: Mapping = field(default_factory=dict)  # file, and type, of `read_prior`

    def file(self, name):
        """Return the path of one of the device's results."""
        return Path(self.folder) / name

    @property
    def sessions(self):
        """Kind and files of each session by its name."""
        return {
            name: {"kind": kind, "quality": self.file(f"{name}/quality.json")}
            | {table: self.file(f"{name}/{table}.parquet") for table in _TABLES}
            for name, kind in self.kinds.items()
        }


def ingest(device, session, declared, paths):
    """Write samples and quality of one session, the log of which lies in files at the paths.

    ``format``, ``sources``, ``columns``, ``units``, ``rate``, ``time_range`` and ``pps`` may be
    declared. An ImuloopError if they do not fit the log.
    """
    from imuloop.ingest.ingest import Declared, ingest

    given = {key: getattr(device, key) for key in ("nominal", "full_scale", "gravity")}
    stated = {key: value for key, value in declared.items() if value is not None}
    ingest(
        **_written_by_ingest(device, session),
        paths=paths,
        declared=Declared(**stated, **given),
    )


def ingest_or_reject(device, session, declared, paths):
    """Do as `ingest`, but reject a session whose log does not fit what is declared."""
    from imuloop.ingest.ingest import write_rejected

    try:
        ingest(device, session, declared, paths)
    except MachineFault:
        raise
    except ImuloopError as error:
        write_rejected(**_written_by_ingest(device, session), reason=str(error))


def _written_by_ingest(device, session):
    files = device.sessions[session]
    return {
        "device": device.name,
        "session": session,
        "kind": files["kind"],
        "samples_path": files["samples"],
        "quality_path": files["quality"],
    }


def segment(device):
    """Write the segments of each session."""
    from imuloop.core.samples import Samples, read_metadata
    from imuloop.core.tables import write_table
    from imuloop.segment.segment import segment_session
    from imuloop.segment.settings import SegmentSettings

    settings = SegmentSettings(**device.segment)
    for files in device.sessions.values():
        samples = Samples(files["samples"])
        known = read_metadata(files["samples"])
        unknown = {name: known[name] for name in ("rails", "stuck") if name in known}
        found = segment_session(samples, files["kind"], settings, **unknown)
        write_table(files["segments"], *found)


def noise(device):
    """Write noise.json, and spectra of all sessions in a table."""
    from imuloop.core.tables import write_sessions
    from imuloop.noise.noise import estimate_noise
    from imuloop.noise.records import read_recorded
    from imuloop.noise.settings import NoiseSettings

    sessions = [read_recorded(name, files) for name, files in device.sessions.items()]
    result = estimate_noise(device.name, sessions, NoiseSettings(**device.noise))
    result.to_json(device.file("noise.json"))
    write_sessions(device.file("spectra.parquet"), result.spectra)


def calibrate(device):
    """Write six_position.json and multi_position.json."""
    from imuloop.calibrate.calibrate import calibrate_device
    from imuloop.calibrate.settings import CalibrateSettings

    calibrate_device(
        device=device.name,
        gravity=device.gravity,
        sessions=device.sessions,
        noise=device.file("noise.json"),
        settings=CalibrateSettings(**device.calibrate),
        prior=_prior(device),
        six_path=device.file("six_position.json"),
        multi_path=device.file("multi_position.json"),
    )


def _prior(device):
    """Return the Prior of a device, by its file if it names one."""
    from imuloop.family.prior import read_prior
    from imuloop.model.prior import data_sheet

    sheet = data_sheet(device.tolerances)
    if device.prior:
        return read_prior(sheet, device=device.name, sessions=device.sessions, **device.prior)
    return sheet


def diagnose(device):
    """Write diagnosis, calibration, attitude, poses, moves, windows, corrected Allan curves."""
    from imuloop.calibrate.settings import CalibrateSettings
    from imuloop.core.files import write_json
    from imuloop.core.tables import write_sessions, write_table
    from imuloop.diagnose.diagnose import diagnose_device
    from imuloop.diagnose.settings import DiagnoseSettings
    from imuloop.noise.allan import no_curves
    from imuloop.noise.settings import NoiseSettings
    from imuloop.plan.advice import next_step
    from imuloop.validate.attitude import validate_attitude

    settings = DiagnoseSettings(**device.diagnose)
    found = diagnose_device(
        device=device.name,
        gravity=device.gravity,
        sessions=device.sessions,
        noise=device.file("noise.json"),
        six_position=device.file("six_position.json"),
        multi_position=device.file("multi_position.json"),
        calibrate_settings=CalibrateSettings(**device.calibrate),
        settings=settings,
        noise_settings=NoiseSettings(**device.noise),
        prior=_prior(device),
    )
    step = next_step(found.calibration, found.noise, found.recording)
    diagnosis = found.content | {"next_step": step}
    attitude, series = validate_attitude(device.name, found, settings)
    write_json(device.file("diagnosis.json"), diagnosis)
    found.calibration.to_json(device.file("calibration.json"))
    write_sessions(device.file("allan_corrected.parquet"), {"": no_curves(), **found.allan})
    write_json(device.file("attitude.json"), attitude)
    for name, table in {"attitude": series, **found.tables}.items():
        write_table(device.file(f"{name}.parquet"), table)


def allan(device):
    """Write the Allan curves of each session, those as logged first, then the corrected."""
    from imuloop.core.tables import joined, read_session, write_table
    from imuloop.noise.allan import session_curves
    from imuloop.noise.records import read_recorded
    from imuloop.noise.settings import NoiseSettings

    settings, corrected = NoiseSettings(**device.noise), device.file("allan_corrected.parquet")
    for name, files in device.sessions.items():
        raw = session_curves(read_recorded(name, files), settings)
        write_table(files["allan"], joined([raw, read_session(corrected, name)]))


def export(device):
    """Write the folder of other tools' files and exports.json, the list of them."""
    from imuloop.export.export import export_files, read_exported, write_exports

    qualities = [files["quality"] for files in device.sessions.values()]
    exported = read_exported(
        *(device.name, device.label or device.name),
        *(device.file("calibration.json"), device.file("noise.json"), qualities),
        device.file("diagnosis.json"),
    )
    write_exports(device.file("exports"), export_files(exported))


def report_device(device):
    """Write a device's exports, part of the report, page, figures and row of the comparison."""
    from imuloop.report.section import write_section

    export(device)
    write_section(
        *(device.name, device.label or device.name, device.folder, device.kinds),
        data_sheet=device.data_sheet,
    )


def report(devices, command, family=None, failures=()):
    """Write results/report.html and results/comparison.csv; return a line for each device.

    Parameters
    ----------
    devices : dict
        Devices by name, as `imuloop.config.resolve` returns them.
    command : str
        Command that makes the report, to be shown in it.
    family : path-like, optional
        family.json, where devices name their type.
    failures : list of imuloop.failures.Failure
        At least one for each device without complete results.
    """
    import imuloop
    from imuloop.report.provenance import provenance
    from imuloop.report.report import verdict_lines, write_report

    failed = {failure.device for failure in failures}
    folders = [Path("results", name) for name in devices if name not in failed]
    repository = Path(imuloop.__file__).parents[3]
    made_by = provenance(imuloop.__version__, repository, command, devices)
    Path("results").mkdir(exist_ok=True)
    pages = "results/report.html", "results/comparison.csv"
    write_report(folders, made_by, *pages, family, failures)
    return verdict_lines(folders)


def stages():
    """Return the stages that make results of what was ingested, in order."""
    return segment, noise, calibrate, diagnose, allan


def run(device):
    """Do all stages of a device that follow ingest."""
    for stage in (*stages(), report_device):
        stage(device)
