"""The stages as calls, paths in and files out; what fails in one is a result of its device alone.

A stage reads and writes below the device's folder, ``results/<device>``, by the names of the
contract, and returns a list of what went wrong. That is written in the place of its results, with
the reason; later stages then write that they have nothing to work on, with the same reason. Only
what the machine lacks stops a run. Each stage loads its own library, so that a job's digest of code
is that of its stage.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from imuloop.core.failure import attempt

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
    # as in the config
    nominal: Mapping = field(default_factory=dict)
    full_scale: Mapping = field(default_factory=dict)
    # settings of the stages that are not their defaults
    segment: Mapping = field(default_factory=dict)
    noise: Mapping = field(default_factory=dict)
    calibrate: Mapping = field(default_factory=dict)
    diagnose: Mapping = field(default_factory=dict)
    prior: str | None = None  # whether the other devices of its type are one, ``family``
    log: Path | None = None  # where a traceback goes
    threads: int = 1  # how many may work at once; changes nothing in a result

    def file(self, name):
        """Return the path of one of the device's results."""
        return Path(self.folder) / name

    @property
    def calibration(self):
        """The path of the calibration to use: with the prior, where one is asked for."""
        return self.file("family_calibration.json" if self.prior else "calibration.json")

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
    declared.
    """
    from imuloop.ingest.ingest import Declared, ingest, write_nothing

    files = device.sessions[session]
    what = {
        "device": device.name,
        "session": session,
        "kind": files["kind"],
        "samples_path": files["samples"],
        "quality_path": files["quality"],
    }
    given = {key: getattr(device, key) for key in ("nominal", "full_scale", "gravity")}
    stated = {key: value for key, value in declared.items() if value is not None}
    how = {"declared": Declared(**stated, **given), "threads": device.threads}
    work = partial(ingest, **what, paths=paths, **how)
    return attempt(device, "ingest", work, lambda *why: write_nothing(**what, why=why))


def segment(device):
    """Write the segments of each session."""
    from imuloop.core.samples import Samples, read_metadata
    from imuloop.core.tables import write_table
    from imuloop.segment.segment import no_segments, segment_session
    from imuloop.segment.settings import SegmentSettings

    settings = SegmentSettings(**device.segment)

    def work(files):
        samples = Samples(files["samples"])
        known = read_metadata(files["samples"])
        unknown = {name: known[name] for name in ("rails", "stuck") if name in known}
        found = segment_session(samples, files["kind"], settings, **unknown)
        write_table(files["segments"], *found)

    def write_placeholder(files, reason, failed):
        segments, metadata = no_segments(files["kind"])
        write_table(files["segments"], segments, metadata | {"failed": failed})

    return _of_each_session(device, "segment", work, write_placeholder)


def noise(device):
    """Write noise.json, and Allan curves as logged and spectra, of all sessions in a table."""
    from imuloop.core.samples import Samples, read_columns
    from imuloop.core.tables import write_sessions
    from imuloop.noise.noise import estimate_noise, no_noise
    from imuloop.noise.records import RecordedSession
    from imuloop.noise.settings import NoiseSettings

    def write(result, failed=None):
        result.to_json(device.file("noise.json"), failed)
        write_sessions(device.file("allan_raw.parquet"), result.allan)
        write_sessions(device.file("spectra.parquet"), result.spectra)

    def work():
        sessions = [
            RecordedSession(
                name, each["kind"], Samples(each["samples"]), read_columns(each["segments"])
            )
            for name, each in device.sessions.items()
        ]
        write(estimate_noise(device.name, sessions, NoiseSettings(**device.noise)))

    def write_placeholder(reason, failed):
        write(no_noise(device.name, device.kinds, reason), failed)

    return attempt(device, "noise", work, write_placeholder)


def calibrate(device):
    """Write six_position.json and multi_position.json."""
    from imuloop.calibrate.calibrate import calibrate_device, write_nominal
    from imuloop.calibrate.settings import CalibrateSettings

    what = {
        "device": device.name,
        "gravity": device.gravity,
        "sessions": device.sessions,
        "six_path": device.file("six_position.json"),
        "multi_path": device.file("multi_position.json"),
    }
    given = device.file("noise.json")

    def work():
        calibrate_device(**what, noise=given, settings=CalibrateSettings(**device.calibrate))

    return attempt(device, "calibrate", work, lambda *why: write_nominal(**what, why=why), [given])


def diagnose(device):
    """Write diagnosis, calibration, attitude, poses, moves, windows, corrected Allan curves."""
    from imuloop.calibrate.calibrate import with_sessions
    from imuloop.calibrate.settings import CalibrateSettings
    from imuloop.core.files import write_json
    from imuloop.core.tables import write_sessions, write_table
    from imuloop.diagnose.diagnose import calibrated, diagnose_device, undiagnosed
    from imuloop.diagnose.records.pose_tables import no_tables
    from imuloop.diagnose.settings import DiagnoseSettings
    from imuloop.discover.search import search_formulas
    from imuloop.noise.allan import allan_table
    from imuloop.noise.settings import NoiseSettings
    from imuloop.plan.next_recording import next_recording
    from imuloop.validate.attitude import no_attitude, validate_attitude

    given = {name: device.file(f"{name}.json") for name in ("six_position", "multi_position")}
    noise_path = device.file("noise.json")

    def write(diagnosis, calibration, allan, attitude, tables):
        write_json(device.file("diagnosis.json"), diagnosis)
        calibration.to_json(device.file("calibration.json"))
        # of no session, for the columns
        none = allan_table("", [], [], [])
        write_sessions(device.file("allan_corrected.parquet"), {"": none, **allan})
        write_json(device.file("attitude.json"), attitude)
        for name, table in tables.items():
            write_table(device.file(f"{name}.parquet"), table)

    def work():
        settings = DiagnoseSettings(**device.diagnose)
        found = diagnose_device(
            device=device.name,
            gravity=device.gravity,
            sessions=device.sessions,
            noise=noise_path,
            **given,
            calibrate_settings=CalibrateSettings(**device.calibrate),
            settings=settings,
            noise_settings=NoiseSettings(**device.noise),
            search_formulas=search_formulas,
        )
        diagnosis = found.content | {"next_recording": next_recording(found)}
        attitude, series = validate_attitude(device.name, found, settings)
        if "why" in attitude:
            attitude["why"] = with_sessions(attitude["why"], device.sessions)
        tables = {"attitude": series, **found.tables}
        write(diagnosis, found.calibration, found.allan, attitude, tables)

    def write_placeholder(reason, failed):
        diagnosis = undiagnosed(device.name, reason) | {"next_recording": {}}
        diagnosis |= {"failed": failed} if failed else {}
        attitude, series = no_attitude(device.name, reason)
        tables = {"attitude": series, **no_tables()}
        write(diagnosis, calibrated(**given), {}, attitude, tables)

    return attempt(
        device, "diagnose", work, write_placeholder, [noise_path, given["multi_position"]]
    )


def allan(device):
    """Write the Allan curves of each session, those as logged first, then the corrected."""
    from imuloop.core.tables import joined, read_session, write_table
    from imuloop.noise.allan import allan_table

    raw, corrected = (device.file(f"allan_{which}.parquet") for which in ("raw", "corrected"))

    def work(files):
        parts = [read_session(path, files["name"]) for path in (raw, corrected)]
        write_table(files["allan"], joined(parts))

    def write_placeholder(files, reason, failed):
        write_table(files["allan"], allan_table("", [], [], []))

    return _of_each_session(device, "allan", work, write_placeholder)


def family_prior(device, others):
    """Write family_calibration.json: the device's own calibration, completed by that of others.

    Takes the folders of the other devices of its type.
    """
    from imuloop.calibrate.calibrate import read_recording
    from imuloop.calibrate.settings import CalibrateSettings
    from imuloop.core.model import Calibration
    from imuloop.core.noise_model import NoiseModel
    from imuloop.family.prior import Prior, with_prior

    given = [device.file(f"{name}.json") for name in ("noise", "multi_position", "diagnosis")]

    def own():
        return Calibration.from_json(device.file("calibration.json"))

    def work():
        settings = CalibrateSettings(**device.calibrate)
        prior = Prior.of([Calibration.from_json(Path(o, "calibration.json")) for o in others])
        recording = read_recording(device.sessions, settings.longest_rotation)
        found = with_prior(own(), prior, recording, NoiseModel.from_json(given[0]), settings)
        found.to_json(device.calibration)

    def write_placeholder(reason, failed):
        own().to_json(device.calibration, failed)

    return attempt(device, "family_prior", work, write_placeholder, given)


def export(device):
    """Write the folder of other tools' files and exports.json, the list of them."""
    from imuloop.core.errors import one_line
    from imuloop.export.export import README, export_files, read_exported, write_exports

    given = [device.file(f"{name}.json") for name in ("noise", "multi_position", "diagnosis")]
    given += [device.calibration] * bool(device.prior)
    folder = device.file("exports")

    def work():
        calibration, noise_path = device.calibration, device.file("noise.json")
        qualities = [files["quality"] for files in device.sessions.values()]
        names = device.name, device.label or device.name
        exported = read_exported(*names, calibration, noise_path, qualities, given[2])
        write_exports(folder, export_files(exported))

    def write_placeholder(reason, failed):
        line = one_line(f"No file for other tools of {device.name}: {reason}")
        write_exports(folder, {README: f"{line}\n"}, failed)

    return attempt(device, "export", work, write_placeholder, given)


def report_device(device):
    """Write a device's part of the report, its page, its figures and its row of the comparison."""
    from imuloop.report.section import write_failed, write_section

    given = device.name, device.label or device.name, device.folder, device.kinds, device.prior
    return attempt(
        device,
        "report_device",
        lambda: write_section(*given),
        lambda reason, failed: write_failed(*given, failed),
    )


def stages():
    """Return the stages that make results of what was ingested, in order."""
    return segment, noise, calibrate, diagnose, allan


def run(device):
    """Do all stages of a device that follow ingest; return what went wrong, in order."""
    return [failure for stage in (*stages(), export, report_device) for failure in stage(device)]


def _of_each_session(device, stage, work, write_placeholder):
    """Attempt a stage with the files of each session; return what went wrong."""
    failures = []
    for name, files in device.sessions.items():
        files = files | {"name": name}
        failures += attempt(device, stage, partial(work, files), partial(write_placeholder, files))
    return failures
