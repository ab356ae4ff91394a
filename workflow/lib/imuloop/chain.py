"""The stages as functions of a Device: each reads files and writes files.

A stage reads and writes in the device's folder, ``results/<device>``, files with fixed names. A log
that cannot be used is a result; an exception is a bug or a fault of the machine. Each stage imports
its package when it is called, so that the code digest of a job covers its own stage alone.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from imuloop.core.errors import ImuloopError, MachineFault

# tables of a session, each a Parquet file
_TABLES = ("samples", "segments", "allan")


@dataclass(frozen=True)
class Device:
    """A device with its sessions and settings: the input of every stage.

    A session is one log. The kind of a session, such as ``static``, is what was done with the
    device while it was logged.
    """

    name: str
    folder: Path  # folder of the device's results
    kinds: Mapping  # kind of each session by its name
    label: str = ""  # name in the report
    gravity: float = 9.80665  # local gravity, m/s^2
    # for each quantity: scale and offset of counts, and full scale, SI
    nominal: Mapping = field(default_factory=dict)
    full_scale: Mapping = field(default_factory=dict)
    # for each sensor: standard deviations of its parameters about their nominal values
    tolerances: Mapping = field(default_factory=dict)
    # ``sensor``, the name of the sensor, and ``noise``, its typical white noise by sensor, SI
    data_sheet: Mapping = field(default_factory=dict)
    # settings of the stages that are not their defaults
    segment: Mapping = field(default_factory=dict)
    noise: Mapping = field(default_factory=dict)
    calibrate: Mapping = field(default_factory=dict)
    diagnose: Mapping = field(default_factory=dict)
    # ``file``, an earlier calibration.json of the device or a family.json, and ``type``, the name
    # of the device's type in the family; empty without a prior
    prior: Mapping = field(default_factory=dict)

    def file(self, name):
        """Return the path of the result file or folder `name` in the device's folder."""
        return Path(self.folder) / name

    @property
    def sessions(self):
        """Kind and result files of each session, a dict of dicts by the name of the session.

        An inner dict has the kind under ``kind``, and the paths of files under ``quality``,
        ``samples``, ``segments`` and ``allan``.
        """
        return {
            name: {"kind": kind, "quality": self.file(f"{name}/quality.json")}
            | {table: self.file(f"{name}/{table}.parquet") for table in _TABLES}
            for name, kind in self.kinds.items()
        }


def ingest(device, session, declared, paths, reject=False):
    """Write samples.parquet and quality.json of one session, from the files of its log.

    If the declarations do not fit the log, the function raises an ImuloopError. With `reject` it
    rejects the session instead: samples.parquet then has no rows, and quality.json has the reason.
    A full disk raises a MachineFault in any case.

    Parameters
    ----------
    device : Device
        Device whose folder gets the files.
    session : str
        Name of the session.
    declared : dict
        ``format``, ``sources``, ``columns``, ``units``, ``rate``, ``time_range`` and ``pps`` of the
        config. A key that is not declared is None or absent.
    paths : list of path-like
        The files of the log.
    reject : bool
        Whether a log that does not fit is rejected instead of raising an error.
    """
    from imuloop.ingest.ingest import Declared, ingest, write_rejected

    files = device.sessions[session]
    written = {"device": device.name, "session": session, "kind": files["kind"]}
    written |= {"samples_path": files["samples"], "quality_path": files["quality"]}
    of_device = {key: getattr(device, key) for key in ("nominal", "full_scale", "gravity")}
    of_session = {key: value for key, value in declared.items() if value is not None}
    try:
        ingest(**written, paths=paths, declared=Declared(**of_session, **of_device))
    except ImuloopError as error:
        if not reject or isinstance(error, MachineFault):
            raise
        write_rejected(**written, reason=str(error))


def segment(device):
    """Write the segments of each session of a Device, segments.parquet.

    A segment is a rest, a move or a gap in the log.
    """
    from imuloop.core.samples import Samples, read_metadata
    from imuloop.core.tables import write_table
    from imuloop.segment.segment import segment_session
    from imuloop.segment.settings import SegmentSettings

    settings = SegmentSettings(**device.segment)
    for files in device.sessions.values():
        samples = Samples(files["samples"])
        # ingest detected the ends of the ranges, and spans in which a channel is stuck
        metadata = read_metadata(files["samples"])
        faults = {name: metadata[name] for name in ("rails", "stuck") if name in metadata}
        table, counts = segment_session(samples, files["kind"], settings, **faults)
        write_table(files["segments"], table, counts)


def noise(device):
    """Write the noise model of a Device, noise.json, and the spectra of its sessions.

    The spectra, power spectral densities at rest, are in spectra.parquet.
    """
    from imuloop.core.tables import write_sessions
    from imuloop.noise.noise import estimate_noise
    from imuloop.noise.records import read_recorded
    from imuloop.noise.settings import NoiseSettings

    sessions = [read_recorded(name, files) for name, files in device.sessions.items()]
    result = estimate_noise(device.name, sessions, NoiseSettings(**device.noise))
    result.to_json(device.file("noise.json"))
    write_sessions(device.file("spectra.parquet"), result.spectra)


def calibrate(device):
    """Write the calibrations of a Device, each with its own method.

    The files are six_position.json, from poses on the six faces, and multi_position.json, from
    poses in any attitude.
    """
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
    """Return the Prior of a Device: mean and covariance of its parameters before its logs are used.

    The prior is from an earlier calibration or a family if the config names its file, or else from
    the data sheet.
    """
    from imuloop.family.prior import read_prior
    from imuloop.model.prior import data_sheet

    sheet = data_sheet(device.tolerances)
    if device.prior:
        return read_prior(sheet, device=device.name, sessions=device.sessions, **device.prior)
    return sheet


def diagnose(device):
    """Write the diagnosis of a Device, its final calibration, and the validation by attitude.

    The files are diagnosis.json, calibration.json, attitude.json and tables in Parquet files. The
    tables have the residuals of the poses, of the moves and of windows with a reference, the errors
    of attitude, and the Allan curves after the effects are subtracted.
    """
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
    diagnosed = diagnose_device(
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
    step = next_step(diagnosed.calibration, diagnosed.noise, diagnosed.recording)
    diagnosis = diagnosed.content | {"next_step": step}
    attitude, attitude_table = validate_attitude(device.name, diagnosed, settings)
    write_json(device.file("diagnosis.json"), diagnosis)
    diagnosed.calibration.to_json(device.file("calibration.json"))
    # an empty table keeps the columns if no session has curves
    write_sessions(device.file("allan_corrected.parquet"), {"": no_curves(), **diagnosed.allan})
    write_json(device.file("attitude.json"), attitude)
    for name, table in {"attitude": attitude_table, **diagnosed.tables}.items():
        write_table(device.file(f"{name}.parquet"), table)


def allan(device):
    """Write the Allan curves of each session of a Device, allan.parquet.

    They are the curves of the samples as logged, and of the samples without the effects that the
    diagnosis found.
    """
    from imuloop.core.tables import joined, read_session, write_table
    from imuloop.noise.allan import session_curves
    from imuloop.noise.records import read_recorded
    from imuloop.noise.settings import NoiseSettings

    settings, corrected = NoiseSettings(**device.noise), device.file("allan_corrected.parquet")
    for name, files in device.sessions.items():
        as_logged = session_curves(read_recorded(name, files), settings)
        write_table(files["allan"], joined([as_logged, read_session(corrected, name)]))


def export(device):
    """Write the calibration of a Device for other tools, and a list of the files.

    The files are in the folder exports, and the list is exports.json.
    """
    from imuloop.export.export import export_files, read_exported, write_exports

    write_exports(device.file("exports"), export_files(read_exported(device)))


def report_device(device):
    """Write the exports of a Device for other tools, and its part of the report.

    The part is section.html for the report of all devices, a page by itself, the figures, and
    summary.json for the comparison with other devices.
    """
    from imuloop.report.section import write_section

    export(device)
    write_section(device)


def report(devices, command, family=None, failures=()):
    """Write results/report.html and results/comparison.csv; return the verdicts, lines of text.

    The lines are a list, with one for each device that did not fail, or for each group of many
    devices with equal verdicts.

    Parameters
    ----------
    devices : dict
        Devices by name, as the config declares them, with all defaults.
    command : str
        Command that makes the report, to be shown in it.
    family : path-like, optional
        Path of family.json, if devices of the config declare a type.
    failures : list of imuloop.failures.Failure
        Failures of the run, at least one for each device without complete results.
    """
    import imuloop
    from imuloop.report.provenance import provenance
    from imuloop.report.report import verdict_lines, write_report

    failed = {failure.device for failure in failures}
    folders = [Path("results", name) for name in devices if name not in failed]
    repository = Path(imuloop.__file__).parents[3]
    made_by = provenance(imuloop.__version__, repository, command, devices)
    Path("results").mkdir(exist_ok=True)
    write_report(
        folders, made_by, "results/report.html", "results/comparison.csv", family, failures
    )
    return verdict_lines(folders)


def stages():
    """Return the functions of the stages from `segment` to `allan`, in the order of a run, a tuple.

    Each takes a Device. Two stages are not included: `ingest`, which is called before them, and
    `report_device`, which is called after them.
    """
    return segment, noise, calibrate, diagnose, allan


def run(device):
    """Call all stages after `ingest` for a Device, from `segment` to `report_device`."""
    for stage in (*stages(), report_device):
        stage(device)
