"""``imuloop noise``: noise coefficients and Allan deviation of one log, for a filter's settings."""

import tempfile
from pathlib import Path

import pandas as pd

from imuloop.commands.info import noise_lines
from imuloop.commands.lines import say
from imuloop.commands.logs import (
    LOG,
    figures_of,
    files_of,
    log_of,
    log_samples,
    name_of,
    paths_of,
    refuse_rejected,
)
from imuloop.commands.options import add_arguments
from imuloop.core.errors import ImuloopError
from imuloop.core.files import refuse_overwriting
from imuloop.core.samples import read_metadata, read_samples
from imuloop.core.segments import MOTION
from imuloop.core.units import STANDARD_GRAVITY, RawUnit
from imuloop.export.export import FORMATS, render
from imuloop.export.values import Exported, reasons, values
from imuloop.model.calibration import Calibration
from imuloop.model.sensor_calibration import SensorCalibration
from imuloop.noise.allan import session_curves
from imuloop.noise.noise import estimate_noise
from imuloop.noise.records import RecordedSession
from imuloop.noise.settings import NoiseSettings
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings

EXAMPLE = """examples:
  imuloop noise night.csv
  imuloop noise night.bag -o results/noise

Prints angle and velocity random walk N, bias instability B and random walk K of a log at rest, with
intervals; B and K need hours of rest. -o writes noise.json, allan.csv, the Allan deviations as SVG,
and the files that Kalibr, OpenVINS, VINS-Fusion, ORB-SLAM3, allan_variance_ros and ROS read."""
# formats with no other needs take no calibration; OpenVINS takes matrices, here of a perfect sensor
NEEDS, IDENTITY = {"N", "K", "rate"}, "openvins_kalibr_imu_chain.yaml"


def add(commands, **how):
    """Add the command and its arguments."""
    command = commands.add_parser(
        "noise", help="noise of a log at rest: Allan deviation, N, B, K", epilog=EXAMPLE, **how
    )
    command.add_argument("log", type=log_of, help=LOG)
    command.add_argument("-o", "--output", type=Path, help="folder of the results")
    add_arguments(command)
    command.set_defaults(run=run)


def run(arguments):
    """Print the noise of a log, and write it for other tools."""
    log, folder = arguments.log, arguments.output
    data_sheet = figures_of(arguments)["data_sheet"]
    if folder:
        refuse_overwriting([folder], files_of(log))
    with tempfile.TemporaryDirectory(prefix="imuloop-") as temporary:
        path, quality = log_samples(log, arguments, Path(temporary))
        refuse_rejected(log, quality)
        samples, known = read_samples(path), read_metadata(path)
    how = SegmentSettings(), known.get("rails"), known.get("stuck", ())
    kind, (segments, _) = "static", segment_session(samples, "static", *how)
    if MOTION not in set(segments["kind"]):
        posed, figures = segment_session(samples, "multi_position", *how)
        if figures["poses"] > 1:
            kind, segments = "multi_position", posed
    session = RecordedSession(name_of(log), kind, samples, segments)
    found = estimate_noise(name_of(log), [session], NoiseSettings(), views=False)
    if found.rate_hz is None:
        raise ImuloopError(f"{paths_of(log)}: {'; '.join(found.notes)}")
    say(*noise_lines(found.to_dict(), data_sheet))
    say(*(f"warning: {w}" for w in quality.get("warnings", ())))
    if folder:
        folder.mkdir(parents=True, exist_ok=True)
        say(*(f"wrote {path}" for path in written(folder, session, found)))


def written(folder, session, found):
    """Write `found`, a NoiseResult, its curves and other tools' files; return their paths."""
    name = session.name
    found.to_json(folder / "noise.json")
    paths = [folder / "noise.json"]
    why = "this log is of the noise alone"
    sensors = [SensorCalibration.nominal(RawUnit(unit, 1.0), why) for unit in ("m/s^2", "rad/s")]
    nominal = Calibration(name, STANDARD_GRAVITY, *sensors)
    exported = Exported(
        name, name, nominal, found.model, found.rate_hz, found.notes, sensors=(*found.rates_hz,)
    )
    lacking = reasons(exported)
    for each in FORMATS:
        needs = NEEDS if each.file == IDENTITY else {*each.needs}
        if not needs <= NEEDS:
            continue
        if missing := needs & {*lacking}:
            say(f"{each.file} is not written: {lacking[min(missing)]}")
            continue
        paths.append(folder / each.file)
        text = render(each.file, values(exported))
        paths[-1].write_text(text, encoding="utf-8", newline="\n")
    allan = pd.DataFrame(session_curves(session, NoiseSettings()))
    if allan.empty:
        say("no Allan curve: AllanTools is not installed, or the rests are too short")
        return paths
    allan.to_csv(folder / "allan.csv", index=False)
    return [*paths, folder / "allan.csv", *drawings(folder, name, allan, found)]


def drawings(folder, name, allan, found):
    """Draw the Allan deviation of each sensor; return the paths, empty if matplotlib is missing."""
    try:
        from imuloop.report.figures.allan import allan_picture
    except ModuleNotFoundError as error:
        say(f"no drawing: {error.name} is not installed")
        return []
    drawn = (
        allan_picture("noise", name, sensor, allan, found.model.axes) for sensor in found.rates_hz
    )
    return [picture.write_svg(folder) for picture in drawn if picture]
