"""``imuloop check``: test on a new log whether a device has drifted.

For example:
  imuloop check results/my_imu/calibration.json poses_today.csv
  imuloop check calibration.json rest.csv --turn-on 0.02,0.002 --json drift.json
  imuloop check calibration.json poses_today.csv --update -o calibration_today.json

LOG is a new log of the same device. Poses test all parameters; one rest tests the biases of the
gyroscope and the accelerometer's bias along gravity; three rests in different directions test all
biases. Exit status: 0 no drift, 3 drift, 1 error, 2 usage.
"""

from pathlib import Path

# a calibration may hold any effect of the library
import imuloop.effects  # noqa: F401
from imuloop import Calibration
from imuloop.calibrate.recording import record
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.commands.lines import aligned, say
from imuloop.commands.logs import LOG, Log, read_log, recorded, refuse_swapped
from imuloop.commands.options import add_keys, between
from imuloop.config import known_figures
from imuloop.core.errors import ImuloopError, plural
from imuloop.core.files import refuse_overwriting, write_json
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import SENSORS
from imuloop.effects.turn_on_bias import TURN_ON
from imuloop.model.calibration_faults import implausible_values
from imuloop.noise.noise import estimate_noise
from imuloop.noise.settings import NoiseSettings
from imuloop.report.numbers import number, p_text, with_sigma
from imuloop.report.page import RESIDUALS
from imuloop.report.units import MILLIRADIAN, data_sheet
from imuloop.validate.drift import check_drift
from imuloop.validate.new_bias import update_biases

# exit status of a device that has drifted
DRIFTED = 3


def add(command):
    """Add the arguments of ``imuloop check`` to `command`, its argparse parser."""
    command.add_argument("calibration", type=Path, help="calibration.json of the device")
    command.add_argument("log", type=Log.parse, help=f"new log of the same device: {LOG}")
    command.add_argument(
        "--turn-on",
        type=between(0, 1e3, 2),
        metavar="M/S^2,RAD/S",
        help="standard deviation of the bias from one switching on to the next; default: the "
        f"calibration's turn_on_bias, or {TURN_ON['accelerometer']:.3g},"
        f"{TURN_ON['gyroscope']:.2g} of MEMS data sheets",
    )
    command.add_argument("--json", type=Path, metavar="OUT", help="write the result, for programs")
    command.add_argument(
        "--update", action="store_true", help="write the calibration with the biases of LOG to -o"
    )
    command.add_argument("-o", "--output", type=Path, help="calibration to write, with --update")
    add_keys(command)


def run(arguments):
    """Test a calibration on a new log, and update its biases if asked; return the exit status.

    The status is `DRIFTED` if the device has drifted, else 0. `arguments` are those that `add`
    declares, parsed.
    """
    path, log, output = arguments.calibration, arguments.log, arguments.output
    if arguments.update != bool(output):
        raise ImuloopError("--update needs -o, the calibration to write, and -o needs --update")
    refuse_swapped(path, log)
    calibration = Calibration.from_json(path)
    noise_path = path.with_name("noise.json")
    read = [path, *log.paths, noise_path, log.paths[0].with_name("quality.json")]
    refuse_overwriting(filter(None, [arguments.json, output]), read)
    samples, metadata, _ = read_log(log, arguments.declared, calibration)
    if set(metadata.get("sha256", {}).values()) & set(calibration.sha256):
        raise ImuloopError(
            f"{log}: the calibration is from this log (the same SHA-256), so it shows no drift: "
            "give a later log"
        )
    session, poses = recorded(log, samples, metadata, "multi_position")
    if poses < 2:
        session, _ = recorded(log, samples, metadata, "static")
    longest, rails = CalibrateSettings().longest_rotation, metadata.get("rails", {})
    recording = record([samples], [session.segments], longest, [rails])
    if noise_path.is_file():
        noise, source = read_noise(noise_path), f"of {noise_path}"
    else:
        noise = estimate_noise(calibration.device, [session], NoiseSettings(), views=False).model
        source = "of the log itself"
    figures = known_figures({"gravity": calibration.gravity} | arguments.declared)
    gravity, update = figures["gravity"], None
    try:
        drift = check_drift(
            calibration, recording, noise, gravity=gravity, turn_on=arguments.turn_on
        )
        if arguments.update:
            update = update_biases(calibration, recording, noise, log.name, gravity=gravity)
    except ImuloopError as error:
        raise ImuloopError(f"{log}: {error}") from error
    head = f"{log.name} against the calibration of {drift.device}; noise {source}"
    say(f"{head}; gravity {gravity:.6g} m/s²", *lines(drift))
    for sensor in SENSORS:
        if why := implausible_values(getattr(calibration, sensor), sensor):
            say(f"The calibration of the {sensor}: {why}")
    if update:
        updated, kept = update
        updated.to_json(output)
        say(*update_lines(updated, kept), f"wrote {output}")
        if drift.drifted and not drift.bias_only:
            say("Other parameters drifted too and are unchanged: calibrate again.")
    if arguments.json:
        origin = {"calibration": str(path), "log": str(log), "kind": session.kind, "noise": source}
        write_json(arguments.json, drift.to_dict() | origin | {"gravity": gravity})
    return DRIFTED if drift.drifted else 0


def read_noise(path):
    """Return the NoiseModel in the file at `path`, a noise.json.

    Raises an ImuloopError if the file does not hold a noise model.
    """
    try:
        return NoiseModel.from_json(path)
    except (KeyError, TypeError, ValueError) as error:
        raise ImuloopError(f"{path}: not a noise model: {error!r}") from error


def lines(drift):
    """Return the result of a test for drift as lines of text, a list; `drift` is the Drift."""
    text = [f"{plural(drift.poses, 'rest')}, {plural(drift.rotations, 'turn')} between them"]
    for name, sensor in drift.sensors.items():
        if sensor.drifted is None:
            text.append(f"{name}: not tested: {sensor.why}")
            continue
        word = "DRIFTED" if sensor.drifted else "no drift"
        together = f"χ² {number(sensor.chi2)} of {sensor.dof}, {p_text(sensor.p_holm)}"
        text.append(f"{name}: {word} ({plural(sensor.dof, 'parameter')} together: {together})")
        rows = []
        for change in sensor.changes:
            display = MILLIRADIAN if change.unit == "rad" else data_sheet(change.unit)
            size = with_sigma(change.change, change.measured_std, display.factor)
            moved = f"moved by {size} {display.unit}"
            sigmas = f"{number(abs(change.sigmas), 2)} σ", p_text(change.p_holm)
            rows.append((change.name, moved, *sigmas, _comment(change, sensor)))
        text += aligned(rows)
        for key, r in sensor.residuals.items():
            display = data_sheet(r["unit"])
            size, floor = (number(r[k] * display.factor) for k in ("rms", "floor"))
            text.append(
                f"  {RESIDUALS[key]}, old calibration: {size} {display.unit}, {floor} expected"
            )
        if sensor.untested:
            # name an effect once, not each of its parameters
            names = dict.fromkeys(name.partition(".")[0] for name in sensor.untested)
            text.append(f"  not tested: {', '.join(names)}: {sensor.why}")
    if drift.bias_only:
        text.append(
            "Only biases moved, by more than --turn-on allows. --update writes the new biases."
        )
    return text


def update_lines(updated, kept):
    """Return lines of text on the biases of both sensors after an update, in raw units, a list.

    `updated` is the updated Calibration. `kept` is a dict by name of the sensors whose biases were
    not updated; its values are the reasons, texts.
    """
    text = [f"{name}: bias left as it was: {why}" for name, why in kept.items()]
    for name in updated.updated.keys() - kept.keys():
        sensor = getattr(updated, name)
        new = (with_sigma(b, sensor.std[f"b{k}"]) for k, b in enumerate(sensor.b.tolist()))
        text.append(f"{name}: bias now {', '.join(new)} {sensor.raw_unit.name}")
    return sorted(text)


def _comment(change, sensor):
    """Return words on whether the change of a parameter is drift, for its line on the terminal.

    For a bias, the words also name the change that is allowed. For another parameter, the text is
    empty unless it has drifted. `change` is the Change of the parameter, and `sensor` the
    SensorDrift that contains it.
    """
    if not change.is_bias:
        return "DRIFTED" if change.drifted else ""
    allowed = data_sheet(change.unit)
    bound = f"noise and {number(max(sensor.turn_on) * allowed.factor, 2)} {allowed.unit} at turn-on"
    return f"DRIFTED, above {bound}" if change.drifted else f"within {bound}"
