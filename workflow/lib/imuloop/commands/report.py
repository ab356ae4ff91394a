"""``imuloop report``: the report of one device from its logs, without a config or a workflow."""

import argparse
import shlex
import sys
import tempfile
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import imuloop
from imuloop.calibrate.calibrate import calibrate_device
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.commands.lines import say
from imuloop.commands.raw_log import add_arguments, log_samples
from imuloop.core.errors import ImuloopError
from imuloop.core.gravity import normal_gravity
from imuloop.core.samples import Columns, read_samples
from imuloop.core.segments import read_segments, write_segments
from imuloop.core.units import STANDARD_GRAVITY
from imuloop.diagnose.settings import DiagnoseSettings
from imuloop.export.export import export_files, read_exported, write_exports
from imuloop.noise.records import Session
from imuloop.noise.settings import NoiseSettings
from imuloop.noise.tables import write_table
from imuloop.report.provenance import provenance
from imuloop.segment.settings import SegmentSettings

KINDS = ("multi_position", "six_position", "static")
TEMPLATES = Path(imuloop.__file__).parent / "templates"
EXAMPLE = """examples:
  imuloop report poses.csv -o report.html
  imuloop report multi_position=poses.csv static=night.csv -o report.html --keep results

The whole chain on the logs of one device, with default settings. For several devices, other
settings, and to repeat only what has changed, write a config and use the workflow."""


def add(commands, **how):
    """Add the command and its arguments."""
    command = commands.add_parser(
        "report", help="report of one device's logs", epilog=EXAMPLE, **how
    )
    command.add_argument(
        "logs", nargs="+", type=log, metavar="[KIND=]LOG", help=f"KIND is {', '.join(KINDS)}"
    )
    command.add_argument(
        "--kind", choices=KINDS, default=KINDS[0], help=f"of logs without; default {KINDS[0]}"
    )
    command.add_argument("-o", "--output", type=Path, required=True, help="HTML file to write")
    command.add_argument(
        "--keep",
        type=Path,
        metavar="FOLDER",
        help="keep calibration.json, noise.json, exports and all else there; without, the report "
        "alone is kept",
    )
    command.add_argument("--label", help="name in the report; default: that of the first log")
    command.add_argument(
        "--gravity",
        type=gravity,
        default=STANDARD_GRAVITY,
        metavar="M/S^2 or LATITUDE,HEIGHT",
        help="local gravity, or degrees and m; default 9.80665: its error is one of scale",
    )
    add_arguments(command)
    command.set_defaults(run=run)


def log(text):
    """Return kind and path of an argument ``static=night.csv``, kind None without."""
    kind, _, path = text.partition("=")
    return (kind, Path(path)) if kind in KINDS and path else (None, Path(text))


def gravity(text):
    """Return gravity of an argument, m/s^2 as it is, or of latitude and height."""
    values = [float(value) for value in text.split(",")]
    if len(values) > 2:
        raise argparse.ArgumentTypeError(f"{text} is not M/S^2 or LATITUDE,HEIGHT")
    return values[0] if len(values) == 1 else normal_gravity(*values)


def run(arguments):
    """Write the report of one device."""
    for _, path in arguments.logs:
        if not path.exists():
            raise ImuloopError(f"{path}: there is no such file")
    if arguments.keep:
        make(arguments, arguments.keep)
        return
    with tempfile.TemporaryDirectory(prefix="imuloop-") as folder:
        make(arguments, Path(folder))


def make(arguments, folder):
    """Run all stages in a folder and write the report.

    Parameters
    ----------
    arguments : Namespace
        Of the command.
    folder : Path
        Where the results go, as in ``results/<device>``.
    """
    # these load for half a second, and every command would wait for it
    from imuloop.diagnose.diagnose import diagnose_device
    from imuloop.noise.noise import estimate_noise
    from imuloop.report.report import write_report
    from imuloop.report.section import write_section

    device, label = "device", arguments.label or arguments.logs[0][1].stem
    sessions = {}
    for kind, path in arguments.logs:
        kind = kind or arguments.kind
        name = f"{kind}_{sum(s['kind'] == kind for s in sessions.values()) + 1}"
        sessions[name] = ingested(path, kind, arguments, folder / name, device)
    noise = folder / "noise.json"
    result = estimate_noise(
        device,
        [
            Session(name, s["kind"], Columns(s["samples"]), read_segments(s["segments"]))
            for name, s in sessions.items()
        ],
        NoiseSettings(),
    )
    result.to_json(noise)
    for name, each in sessions.items():
        write_table(each["allan_raw"], result.allan[name])
        write_table(folder / name / "views.parquet", result.views[name])
    files = {k: folder / f"{k}.json" for k in ("six_position", "multi_position", "calibration")}
    common = {"device": device, "gravity": arguments.gravity, "sessions": sessions, "noise": noise}
    calibrate_device(
        **common,
        settings=CalibrateSettings(),
        six_path=files["six_position"],
        multi_path=files["multi_position"],
    )
    diagnose_device(
        **common,
        six_position=files["six_position"],
        multi_position=files["multi_position"],
        calibrate_settings=CalibrateSettings(),
        settings=DiagnoseSettings(),
        diagnosis_path=folder / "diagnosis.json",
        calibration_path=files["calibration"],
        attitude_path=folder / "attitude.json",
        attitude_series_path=folder / "attitude.parquet",
    )
    qualities = [each["quality"] for each in sessions.values()]
    exported = read_exported(device, label, files["calibration"], noise, qualities)
    write_exports(folder / "exports", export_files(exported))
    write_section(
        device=device,
        label=label,
        folder=folder,
        sessions={name: each["kind"] for name, each in sessions.items()},
        template=TEMPLATES / "section.html.j2",
        section_path=folder / "section.html",
        summary_path=folder / "summary.json",
        figures_folder=folder / "figures",
    )
    write_report(
        sections=[folder / "section.html"],
        summaries=[folder / "summary.json"],
        exports=[folder / "exports.json"],
        template=TEMPLATES / "report.html.j2",
        style=TEMPLATES / "style.css",
        script=TEMPLATES / "sorting.js",
        provenance=origin(arguments, sessions),
        report_path=arguments.output,
        comparison_path=folder / "comparison.csv",
    )
    say(f"wrote {arguments.output}")


def ingested(path, kind, arguments, folder, device):
    """Return the files of a session, with samples, quality and segments written."""
    # as above
    from imuloop.segment.segment import segment_session

    folder.mkdir(parents=True, exist_ok=True)
    samples, quality = log_samples(path, arguments, folder, kind=kind, device=device)
    if samples == path:
        raise ImuloopError(f"{path}: samples of a run; give the raw log they were made of")
    if quality["status"] == "rejected":
        say(f"{path}: rejected: {'; '.join(quality['reasons'])}")
    segments = folder / "segments.parquet"
    write_segments(segments, *segment_session(read_samples(samples), kind, SegmentSettings()))
    return {
        "kind": kind,
        "samples": samples,
        "quality": folder / "quality.json",
        "segments": segments,
        "allan_raw": folder / "allan_raw.parquet",
        "allan": folder / "allan.parquet",
    }


def origin(arguments, sessions):
    """Return what made the report: of a checkout its commit, else the version installed."""
    command = f"imuloop report {shlex.join(sys.argv[2:])}"
    config = {
        "gravity": arguments.gravity,
        "sessions": {
            name: {"kind": each["kind"], "file": str(path)}
            for (name, each), (_, path) in zip(sessions.items(), arguments.logs, strict=True)
        },
    }
    repository = Path(imuloop.__file__).parents[3]
    found = provenance(repository, command, config)
    if not (repository / "Snakefile").exists():
        try:
            found["commit"] = f"imuloop {version('imuloop')}, installed"
        except PackageNotFoundError:
            found["commit"] = "not known"
    return found
