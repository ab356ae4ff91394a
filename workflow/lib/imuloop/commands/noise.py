"""``imuloop noise``: noise of a log at rest: Allan deviation, N, B, K.

For example:
  imuloop noise night.csv
  imuloop noise night.bag -o results/noise

Prints angle and velocity random walk N, bias instability B and random walk K of a log at rest, with
intervals; B and K need hours of rest. -o writes noise.json, allan.csv, the Allan deviations as SVG,
and the files that Kalibr, OpenVINS, VINS-Fusion, ORB-SLAM3, allan_variance_ros and ROS read.
"""

from pathlib import Path

import pandas as pd

from imuloop.commands.info import noise_lines
from imuloop.commands.lines import say
from imuloop.commands.logs import LOG, Log, read_log, recorded
from imuloop.commands.options import add_keys
from imuloop.config import known_figures
from imuloop.core.errors import ImuloopError
from imuloop.core.files import make_folder, refuse_overwriting
from imuloop.core.units import STANDARD_GRAVITY, RawUnit
from imuloop.export.export import FORMATS, render
from imuloop.export.values import Exported, reasons, values
from imuloop.model.calibration import Calibration
from imuloop.model.sensor_calibration import SensorCalibration
from imuloop.noise.allan import session_curves
from imuloop.noise.noise import estimate_noise
from imuloop.noise.settings import NoiseSettings

# formats that need nothing else are written without a calibration; the file of OpenVINS also has
# matrices, for which those of a perfect sensor are taken
NEEDS, IDENTITY = {"N", "K", "rate"}, "openvins_kalibr_imu_chain.yaml"


def add(command):
    """Add the arguments of ``imuloop noise`` to `command`, its argparse parser."""
    command.add_argument("log", type=Log.parse, help=LOG)
    command.add_argument("-o", "--output", type=Path, help="folder of the results")
    add_keys(command)


def run(arguments):
    """Print the noise of a log at rest, and write it for other tools if a folder is named.

    `arguments` are those that `add` declares, parsed.
    """
    log, folder = arguments.log, arguments.output
    if folder:
        refuse_overwriting([folder], log.paths)
    samples, metadata, quality = read_log(log, arguments.declared)
    session, _ = recorded(log, samples, metadata, "static")
    if session.static:
        # a log with several poses has its rests searched for, too
        posed, poses = recorded(log, samples, metadata, "multi_position")
        session = posed if poses > 1 else session
    estimate = estimate_noise(log.name, [session], NoiseSettings(), views=False)
    if estimate.rate_hz is None:
        raise ImuloopError(f"{log}: {'; '.join(estimate.notes)}")
    say(*noise_lines(estimate.to_dict(), known_figures(arguments.declared)["data_sheet"]))
    say(*(f"warning: {w}" for w in quality.get("warnings", ())))
    if folder:
        make_folder(folder)
        estimate.to_json(folder / "noise.json")
        paths = [folder / "noise.json", *write_formats(folder, log.name, estimate)]
        paths += write_curves(folder, session, estimate)
        say(*(f"wrote {path}" for path in paths))


def write_formats(folder, name, estimate):
    """Write the noise in those formats of other tools that need no calibration; return their paths.

    The paths are a list. A file that needs a number which the data do not give is not written, and
    a line on the terminal says why. `folder` is the folder of the files, `name` the name of the
    log, and `estimate` its NoiseResult.
    """
    why = "this log is of the noise alone"
    sensors = [SensorCalibration.nominal(RawUnit(unit, 1.0), why) for unit in ("m/s^2", "rad/s")]
    nominal, paths = Calibration(name, STANDARD_GRAVITY, *sensors), []
    exported = Exported(
        device=name,
        label=name,
        calibration=nominal,
        noise=estimate.model,
        rate_hz=estimate.rate_hz,
        notes=estimate.notes,
        sensors=(*estimate.rates_hz,),
    )
    lacking = reasons(exported)
    for form in FORMATS:
        needs = NEEDS if form.file == IDENTITY else {*form.needs}
        if not needs <= NEEDS:
            continue
        if missing := needs & {*lacking}:
            say(f"{form.file} is not written: {lacking[min(missing)]}")
            continue
        paths.append(folder / form.file)
        text = render(form.file, values(exported))
        paths[-1].write_text(text, encoding="utf-8", newline="\n")
    return paths


def write_curves(folder, session, estimate):
    """Write the Allan deviation of each sensor as a table and as drawings, and return their paths.

    `folder` is the folder of the files, `session` the RecordedSession of the log, and `estimate`
    its NoiseResult. Without an Allan curve nothing is written and the list is empty.
    """
    allan = pd.DataFrame(session_curves(session, NoiseSettings()))
    if allan.empty:
        say("no Allan curve: AllanTools is not installed, or the rests are too short")
        return []
    allan.to_csv(folder / "allan.csv", index=False)
    try:
        from imuloop.report.figures.allan import allan_picture
    except ModuleNotFoundError as error:
        say(f"no drawing: {error.name} is not installed")
        return [folder / "allan.csv"]
    drawn = (
        allan_picture("noise", session.name, sensor, allan, estimate.model.axes)
        for sensor in estimate.rates_hz
    )
    return [folder / "allan.csv", *(picture.write_svg(folder) for picture in drawn if picture)]
