"""``imuloop check``: whether a sensor has drifted since it was calibrated."""

import tempfile
from pathlib import Path

# a calibration may hold any effect of the library
import imuloop.effects  # noqa: F401
from imuloop import Calibration
from imuloop.calibrate.recording import record
from imuloop.calibrate.settings import CalibrateSettings
from imuloop.commands.gravity import add_gravity, gravity_line, local_gravity
from imuloop.commands.lines import aligned, say
from imuloop.commands.logs import (
    LOG,
    files_of,
    log_of,
    log_samples,
    name_of,
    paths_of,
    refuse_rejected,
    refuse_swapped,
    segmented,
)
from imuloop.commands.options import add_arguments, between
from imuloop.core.errors import ImuloopError, plural
from imuloop.core.files import refuse_overwriting, write_json
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import SENSORS, read_metadata, read_samples
from imuloop.effects.turn_on_bias import TURN_ON
from imuloop.model.calibration_faults import implausible_values
from imuloop.noise.noise import estimate_noise
from imuloop.noise.records import RecordedSession
from imuloop.noise.settings import NoiseSettings
from imuloop.report.numbers import number, p_text, with_sigma
from imuloop.report.page import RESIDUALS
from imuloop.report.units import MILLIRADIAN, data_sheet
from imuloop.validate.drift import check_drift
from imuloop.validate.new_bias import update_biases

# exit status of a device that has drifted
DRIFTED = 3
EXAMPLE = f"""examples:
  imuloop check results/my_imu/calibration.json poses_today.csv
  imuloop check calibration.json rest.csv --turn-on 0.02,0.002 --json drift.json
  imuloop check calibration.json poses_today.csv --update -o calibration_today.json

LOG is a new log of the same device. Poses test all parameters; one rest tests the biases of the
gyroscope and the accelerometer's bias along gravity; three rests in different directions test all
biases. Exit status: 0 no drift, {DRIFTED} drift, 1 error, 2 usage."""


def add(commands, **how):
    """Add the command and its arguments."""
    command = commands.add_parser(
        "check", help="test a calibration on a new log: has it drifted?", epilog=EXAMPLE, **how
    )
    command.add_argument("calibration", type=Path, help="calibration.json of the device")
    command.add_argument("log", type=log_of, help=f"new log of the same device: {LOG}")
    command.add_argument(
        "--kind",
        choices=("multi_position", "six_position", "static"),
        help="default: poses if the log has two or more attitudes, else static",
    )
    command.add_argument(
        "--noise",
        type=Path,
        help="noise.json; default: in the folder of the calibration, else from the log",
    )
    add_gravity(command, "that of the calibration")
    command.add_argument(
        "--turn-on",
        type=between(0, 1e3, 2),
        metavar="M/S^2,RAD/S",
        help="standard deviation of the bias from one switching on to the next; default: the "
        f"calibration's turn_on_bias, or {TURN_ON['accelerometer']:.3g},"
        f"{TURN_ON['gyroscope']:.2g} of MEMS data sheets",
    )
    command.add_argument(
        "--level",
        type=between(1e-9, 1),
        default=0.05,
        help="probability of a false alarm, default 0.05",
    )
    command.add_argument("--json", type=Path, metavar="OUT", help="write the result, for programs")
    command.add_argument(
        "--update", action="store_true", help="write the calibration with the biases of LOG to -o"
    )
    command.add_argument("-o", "--output", type=Path, help="calibration to write, with --update")
    add_arguments(command)
    command.set_defaults(run=run)


def run(arguments):
    """Test a calibration on a log, and update its biases; return the exit status."""
    if arguments.update != bool(arguments.output):
        raise ImuloopError("--update needs -o, the calibration to write, and -o needs --update")
    refuse_swapped(arguments.calibration, arguments.log)
    calibration, name = Calibration.from_json(arguments.calibration), name_of(arguments.log)
    noise = arguments.noise or arguments.calibration.with_name("noise.json")
    logs = files_of(arguments.log)
    read = [arguments.calibration, *logs, noise, logs[0].with_name("quality.json")]
    refuse_overwriting([path for path in (arguments.json, arguments.output) if path], read)
    with tempfile.TemporaryDirectory(prefix="imuloop-") as folder:
        path, quality = log_samples(arguments.log, arguments, Path(folder), calibration=calibration)
        refuse_rejected(arguments.log, quality)
        samples, known = read_samples(path), read_metadata(path)
    if set(known.get("sha256", {}).values()) & set(calibration.sha256):
        raise ImuloopError(
            f"{paths_of(arguments.log)}: the calibration is from this log (the same SHA-256), so "
            "it shows no drift: give a later log"
        )
    rails, stuck = known.get("rails", {}), known.get("stuck", ())
    kind, segments = segmented(samples, arguments.kind, rails, stuck)
    recording = record([samples], [segments], CalibrateSettings().longest_rotation, [rails])
    noise, source = noise_of(arguments, calibration, kind, samples, segments)
    given, gravity = (calibration, recording, noise), local_gravity(arguments, calibration.gravity)
    try:
        level, turn_on = arguments.level, arguments.turn_on
        drift = check_drift(*given, gravity=gravity, level=level, turn_on=turn_on)
        update = update_biases(*given, name, gravity=gravity) if arguments.update else None
    except ImuloopError as error:
        raise ImuloopError(f"{paths_of(arguments.log)}: {error}") from error
    of = f"{name} against the calibration of {drift.device}; noise {source}"
    say(f"{of}; {gravity_line(gravity)}", *lines(drift))
    for sensor in SENSORS:
        if why := implausible_values(getattr(calibration, sensor), sensor):
            say(f"The calibration of the {sensor}: {why}")
    if update:
        updated, kept = update
        updated.to_json(arguments.output)
        say(*update_lines(updated, kept), f"wrote {arguments.output}")
        if drift.drifted and not drift.bias_only:
            say("Other parameters drifted too and are unchanged: calibrate again.")
    if arguments.json:
        what = {"calibration": str(arguments.calibration), "log": paths_of(arguments.log)}
        how = {"kind": kind, "noise": source, "gravity": gravity}
        write_json(arguments.json, drift.to_dict() | what | how)
    return DRIFTED if drift.drifted else 0


def noise_of(arguments, calibration, kind, samples, segments):
    """Return the NoiseModel, and in words its origin: a file or the log itself."""
    path = arguments.noise or arguments.calibration.with_name("noise.json")
    if arguments.noise or path.is_file():
        try:
            return NoiseModel.from_json(path), f"of {path}"
        except (KeyError, TypeError, ValueError) as error:
            raise ImuloopError(f"{path}: not a noise model: {error!r}") from error
    session = RecordedSession(name_of(arguments.log), kind, samples, segments)
    found = estimate_noise(calibration.device, [session], NoiseSettings(), views=False)
    return found.model, "of the log itself"


def lines(drift):
    """Return the result of the test, a Drift, in lines for people."""
    found = [f"{plural(drift.poses, 'rest')}, {plural(drift.rotations, 'turn')} between them"]
    for name, sensor in drift.sensors.items():
        if sensor.drifted is None:
            found.append(f"{name}: not tested: {sensor.why}")
            continue
        word = "DRIFTED" if sensor.drifted else "no drift"
        together = f"χ² {number(sensor.chi2)} of {sensor.dof}, {p_text(sensor.p_holm)}"
        found.append(f"{name}: {word} ({plural(sensor.dof, 'parameter')} together: {together})")
        rows = []
        for change in sensor.changes:
            display = MILLIRADIAN if change.unit == "rad" else data_sheet(change.unit)
            size = with_sigma(change.change, change.measured_std, display.factor)
            moved = f"moved by {size} {display.unit}"
            sigmas = f"{number(abs(change.sigmas), 2)} σ", p_text(change.p_holm)
            rows.append((change.name, moved, *sigmas, _comment(change, sensor)))
        found += aligned(rows)
        for key, r in sensor.residuals.items():
            display = data_sheet(r["unit"])
            size, floor = (number(r[k] * display.factor) for k in ("rms", "floor"))
            found.append(
                f"  {RESIDUALS[key]}, old calibration: {size} {display.unit}, {floor} expected"
            )
        if sensor.untested:
            # an effect by its name, not by each of its parameters
            names = dict.fromkeys(name.partition(".")[0] for name in sensor.untested)
            found.append(f"  not tested: {', '.join(names)}: {sensor.why}")
    if drift.bias_only:
        found.append(
            "Only biases moved, by more than --turn-on allows. --update writes the new biases."
        )
    return found


def update_lines(updated, kept):
    """Return the result of `update_biases` in lines for people, in raw units."""
    found = [f"{name}: bias left as it was: {why}" for name, why in kept.items()]
    for name in updated.updated.keys() - kept.keys():
        sensor = getattr(updated, name)
        new = (with_sigma(b, sensor.std[f"b{k}"]) for k, b in enumerate(sensor.b.tolist()))
        found.append(f"{name}: bias now {', '.join(new)} {sensor.raw_unit.name}")
    return sorted(found)


def _comment(change, sensor):
    """Return in words whether a Change is drift, and for a bias what noise and turn-on allow."""
    if not change.is_bias:
        return "DRIFTED" if change.drifted else ""
    allowed = data_sheet(change.unit)
    bound = f"noise and {number(max(sensor.turn_on) * allowed.factor, 2)} {allowed.unit} at turn-on"
    return f"DRIFTED, above {bound}" if change.drifted else f"within {bound}"
