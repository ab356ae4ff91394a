"""Calibrate a device: six-position and multi-position, from its sessions' segments."""

from dataclasses import replace

import numpy as np
from scipy.linalg import LinAlgError, block_diag

from imuloop.calibrate import accelerometer, six_position
from imuloop.calibrate.accelerometer import AccelerometerModel
from imuloop.calibrate.contradictions import change, changed_at
from imuloop.calibrate.determined import (
    NO_DIRECTION,
    NO_POSE,
    accelerometer_undetermined,
    gyroscope_undetermined,
    known_worse,
    no_ellipsoid,
)
from imuloop.calibrate.gyroscope import NAMES as OF_GYROSCOPE
from imuloop.calibrate.known_rotation import read_turns
from imuloop.calibrate.least_squares import (
    NotConverged,
    condition_number,
    fit,
    known_rows,
    why_no_fit,
)
from imuloop.calibrate.poses import gather_poses
from imuloop.calibrate.raw_units import as_logged, in_raw_units, si_factor
from imuloop.calibrate.recording import record
from imuloop.calibrate.sensor_pair import FORCE, SensorPair
from imuloop.core.calibration_faults import sensor_fault
from imuloop.core.model import Calibration, SensorCalibration
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import (
    ACCELERATION,
    ANGULAR_RATE,
    CHANNELS,
    OWN_TIME,
    SENSORS,
    TEMPERATURE,
    TIME,
    Samples,
    read_columns,
    read_metadata,
)
from imuloop.core.units import RawUnit

# what a calibration rests on, most first
METHODS = (
    *("multi_position", "known_rotation", "six_position", "reference_motion"),
    *("static", "nominal"),
)
# condition number up to which turns determine a gyroscope
BY_TURNS = 100
# standard deviations up to which two biases may differ and be one
SAME = 5.0
KINDS = ("multi_position", "six_position", "static", "known_rotation", "reference_motion")
# of sessions whose rests are poses in any attitude
POSED = ("multi_position", "reference_motion")


def usable(sessions, *kinds):
    """Return (session, segments) of each session of some kinds that was not rejected.

    Takes ``kind``, ``samples`` and ``segments`` (paths) of each session by name; the segments that
    it gives are a dict of arrays.
    """
    chosen = [(s, read_columns(s["segments"])) for s in sessions.values() if s["kind"] in kinds]
    return [(session, table) for session, table in chosen if len(table["kind"])]


def without_pose(sessions, kind):
    """Return why there is no pose of one kind; arguments as of `usable`."""
    became = []
    for name, session in sessions.items():
        if session["kind"] == kind:
            rejected = not len(read_columns(session["segments"], ["kind"])["kind"])
            became.append(f"{name} {'was rejected' if rejected else 'has no rest that is a pose'}")
    return f"no {kind} session with a pose" + (f": {', '.join(became)}" if became else "")


def with_sessions(reason, sessions, six=None):
    """Return a reason, text or None; for missing poses, also what happened to the sessions.

    Sessions as of `usable`. Where poses were recorded as six faces alone, it is `six`, why these do
    not calibrate the sensor, if that is given.
    """
    kinds = {session["kind"] for session in sessions.values()}
    if six and reason == NO_POSE and "six_position" in kinds and "multi_position" not in kinds:
        return with_sessions(six, sessions)
    for kind in ("multi_position", "six_position"):
        bare = without_pose({}, kind)
        if reason and reason.startswith(bare):
            return reason.replace(bare, without_pose(sessions, kind), 1)
    return reason


def read_poses(sessions, kind):
    """Return the poses of the sessions of one kind; arguments as of `usable`."""
    return gather_poses([table for _, table in usable(sessions, kind)])


def read_recording(sessions, longest_rotation):
    """Return the Recording of the sessions of kinds `POSED`, without poses if there is none.

    Takes sessions as `usable` does, and the longest rotation, s.
    """
    chosen = usable(sessions, *POSED)
    columns = (TIME, *CHANNELS, TEMPERATURE, *OWN_TIME.values())
    samples = [read_columns(session["samples"], columns) for session, _ in chosen]
    rails = [read_metadata(session["samples"]).get("rails", {}) for session, _ in chosen]
    return record(samples, [table for _, table in chosen], longest_rotation, rails)


def first_log(sessions):
    """Return the metadata of the samples of the first session, by order of `KINDS`, a dict.

    Sessions as of `usable`. One without rows comes last: of a log that was not read the units are
    not known.
    """

    def order(session):
        return not len(Samples(session["samples"])), KINDS.index(session["kind"])

    return read_metadata(min(sessions.values(), key=order)["samples"])


def raw_units(sessions):
    """Return the RawUnits (accelerometer, gyroscope) of the log that `first_log` chooses."""
    units = first_log(sessions)["raw_units"]
    found = (units[quantity] for quantity in ("acceleration", "angular_rate"))
    return tuple(RawUnit(unit["name"], unit["scale"], unit["offset"]) for unit in found)


def layout(sessions):
    """Return what was declared of the log that `first_log` chooses, a dict.

    With the key ``sensor_ids``, an autopilot's numbers of its sensors, where the log holds them.
    """
    first = first_log(sessions)
    ids = first.get("sensor_ids")
    return first.get("declared", {}) | ({"sensor_ids": ids} if ids else {})


def hashes(sessions):
    """Return the SHA-256 of each file of the logs of sessions, (n,) of str, in order of names."""
    found = [read_metadata(session["samples"]).get("sha256", {}) for session in sessions.values()]
    return tuple(dict.fromkeys(each for files in found for each in files.values()))


def start_pair(recording, noise, gravity, units, settings, given=None, turns=None, bias=None):
    """Return the SensorPair of a recording, None if it determines no sensor, and reasons.

    Parameters
    ----------
    recording, noise, gravity, settings : Recording, NoiseModel, float, CalibrateSettings
        As of `SensorPair`.
    units : dict of str to RawUnit
        Of each sensor.
    given : SensorCalibration, optional
        The accelerometer's from elsewhere, where these poses do not determine it.
    turns : KnownTurns, optional
        What counts beside the rotations of the gyroscope.
    bias : tuple of two ndarray, optional
        As of `SensorPair`.

    Returns
    -------
    SensorPair or None
        Its parameters are those of a first fit.
    dict of str to str
        Why a sensor is not estimated.
    """
    poses, largest, reasons = recording.poses, settings.largest_condition, {}
    # as the data sheet has it
    base = np.repeat([0.0, 1.0, 0.0, 0.0, 1.0, 0.0], [3, 3, 3, 6, 3, 3])
    pair = SensorPair(noise, gravity, units, settings, (), base, bias=bias)
    if turns is not None and len(turns) and bias is None:
        pair = pair.knowing("gyroscope", *turns.rows())
    if reason := accelerometer_undetermined(poses, gravity, largest):
        reason += recording.lost.rests_reason
    reason = reason or poses.unknown_noise(noise, ACCELERATION)
    if not reason:
        base[:FORCE] = AccelerometerModel(poses.f, np.zeros((len(poses), 3, 0)), gravity).start()
        alone, reason = _estimated(replace(pair, estimated=("accelerometer",)), recording)
        pair = alone or pair
    if reason:
        reasons["accelerometer"] = reason
        if given is not None:
            pair.base[:FORCE] = as_logged(given, accelerometer.NAMES)
            if given.names[:FORCE] == accelerometer.NAMES:
                factor = si_factor(accelerometer.NAMES, given.raw_unit)
                own = given.covariance[:FORCE, :FORCE] * np.outer(factor, factor)
                root = known_rows(own)
                pair = pair.knowing("accelerometer", root, root @ pair.base[:FORCE])
            pair = replace(pair, given=given)
    if not len(poses):
        reason = NO_POSE
    elif reason and given is None:
        reason = NO_DIRECTION
    else:
        pair.base[-3:] = poses.w.mean(axis=0) if bias is None else bias[0]
        reason = poses.unknown_noise(noise, ANGULAR_RATE)
        reason = reason or gyroscope_undetermined(pair.turns_derivative(recording), largest)
        if reason:
            reason += recording.lost.reason
        else:
            both = (*pair.estimated, "gyroscope")
            whole, reason = _estimated(replace(pair, estimated=both), recording)
            pair = whole or pair
    if reason:
        reasons["gyroscope"] = reason
    return (pair if pair.estimated else None), reasons


def _estimated(pair, recording):
    """Return a pair with the parameters of its fit, None if there is none, and why."""
    sensor = pair.estimated[-1]
    solution, reason = _valid(pair, recording)
    if reason:
        return None, change(sensor, recording.poses, recording.rotations) or reason
    base = pair.base.copy()
    base[pair.free] = solution.fit.x
    return replace(pair, base=base), None


def _valid(pair, recording):
    """Return the Solution of a pair's fit, None if there is none, and why it is not valid."""
    sensor = pair.estimated[-1]
    try:
        solution = pair.fit(recording)
    except LinAlgError as error:
        if sensor == "accelerometer" and isinstance(error, NotConverged):
            return None, no_ellipsoid(len(recording.poses), "no minimum")
        return None, why_no_fit(error)
    if reason := pair.why_invalid(sensor, solution, recording):
        return solution, reason
    if fault := sensor_fault(pair.calibrations(solution)[sensor], sensor):
        return solution, f"the fit gives what no sensor has: {fault}"
    return solution, None


def calibrate_sensors(recording, noise, gravity, units, settings, given=None, turns=None):
    """Return the calibration of both sensors by a multi-position recording.

    Nominal, with the reason, where it does not determine an accelerometer. A gyroscope has the bias
    alone, and the reason, where the rotations do not determine the rest; it is nominal where the
    noise of an axis is not known. Arguments as of `start_pair`; the known turns alone count where
    the recording does not determine it.
    """
    poses, bias = recording.poses, None
    if settings.gyroscope_bias == "initial_rest" and len(poses):
        # its error is that of the first rest's mean
        bias = poses.w[0], poses.mean_covariance(noise)[3:, 0, 0]
    how = given, turns, bias
    pair, reasons = start_pair(recording, noise, gravity, units, settings, *how)
    made = pair.calibrations(pair.fit(recording)) if pair else {}
    return made | not_by_poses(reasons, recording, noise, units, turns)


def not_by_poses(reasons, recording, noise, units, turns):
    """Return the calibrations of the sensors that poses do not calibrate, by the reasons.

    Arguments as in `start_pair`, and the reason by sensor. A gyroscope that changed amid the
    recording has a bias only if it is the same before and after.
    """
    made = {}
    if "accelerometer" in reasons:
        unit, reason = units["accelerometer"], reasons["accelerometer"]
        made["accelerometer"] = SensorCalibration.nominal(unit, reason)
    if "gyroscope" in reasons:
        unit, reason = units["gyroscope"], reasons["gyroscope"]
        known, poses = by_turns(turns, unit), recording.poses
        changed = None if known else changed_at("gyroscope", poses, recording.rotations)
        time, words = changed or (np.inf, "")
        reason = reason if words in reason else f"{reason}; {words}"
        made["gyroscope"] = known or rest_bias(poses, noise, unit, reason, time)
    return made


def by_turns(turns, unit):
    """Return the gyroscope's calibration by KnownTurns alone; None where they do not determine it.

    Its bias is that of the rests in these sessions. Takes the RawUnit of the gyroscope. A
    `NotConverged` or another LinAlgError if the turns have no fit.
    """
    if turns is None or not len(turns):
        return None
    rows, z = turns.rows()
    if not condition_number(rows[:, :9], np.ones(9)) < BY_TURNS:
        return None
    rows, of_bias = rows[:, :9], rows[:, 9:]
    z = z - of_bias @ turns.bias
    found = fit(lambda x: (rows @ x - z, rows), turns.start()[:9], np.eye(len(z)))
    # of what the turns themselves let a bias be wrong by
    bias = np.diag(1 / np.maximum((of_bias**2).sum(axis=0), 1e-12))
    x, covariance = np.append(found.x, turns.bias), block_diag(found.scaled_covariance, bias)
    return in_raw_units(unit, OF_GYROSCOPE, x, covariance, method="known_rotation")


def rest_bias(poses, noise, unit, reason, changed=np.inf):
    """Return the calibration of a gyroscope that only rested: its bias, weighted by the noise.

    Where it differs more between power cycles than noise lets expect, the mean over them, with the
    variance ``s²/n`` of n power cycles. Nominal without a rest, where the noise of an axis is not
    known, or where the biases before and after a time at which the sensor `changed`, s, differ by
    more than `SAME` standard deviations. Takes Poses, NoiseModel, the RawUnit of the gyroscope, and
    why the rest of it is not calibrated, text.
    """
    silent = poses.unknown_noise(noise, ANGULAR_RATE)
    if silent or not len(poses):
        reasons = dict.fromkeys(filter(None, (reason, silent)))
        return SensorCalibration.nominal(unit, "; ".join(reasons))
    covariance = poses.mean_covariance(noise)[3:]
    weights = np.linalg.solve(covariance, np.ones((3, len(poses), 1)))[..., 0]
    late = poses.start_s > changed
    if late.any() and not late.all():
        parts = [weights * at for at in (late, ~late)]
        parts = [own / own.sum(axis=1, keepdims=True) for own in parts]
        contrast = parts[0] - parts[1]
        differs = np.einsum("an,na->a", contrast, poses.w)
        if np.any(differs**2 > SAME**2 * np.einsum("an,anm,am->a", contrast, covariance, contrast)):
            return SensorCalibration.nominal(unit, reason)
    total = weights.sum(axis=1)
    bias, variance = np.einsum("an,na->a", weights, poses.w) / total, 1 / total
    cycles = [weights * (poses.power_cycle == k) for k in np.unique(poses.power_cycle)]
    if len(cycles) > 1:
        each = np.array([np.einsum("an,na->a", w, poses.w) / w.sum(axis=1) for w in cycles])
        scatter = each.var(axis=0, ddof=1) / len(cycles)
        bias = np.where(scatter > variance, each.mean(axis=0), bias)
        variance = np.maximum(scatter, variance)
    return replace(
        SensorCalibration.nominal(unit, reason),
        b=unit.from_si(bias),
        names=("b0", "b1", "b2"),
        covariance=np.diag(variance) / unit.scale**2,
        method="static",
    )


def calibrate_six_position(poses, noise, gravity, units, settings):
    """Return the accelerometer's six-position calibration and the gyroscope's bias.

    Poses that are no face are left out. Takes Poses, NoiseModel, gravity, m/s^2, the RawUnit of
    both sensors, and CalibrateSettings.
    """
    if not len(poses):
        reason = without_pose({}, "six_position")
        return tuple(SensorCalibration.nominal(unit, reason) for unit in units)
    faces = six_position.find_faces(poses.f, settings.face_tolerance)
    turns = "six faces do not show misalignment and scale factor of a gyroscope: bias only"
    rest = rest_bias(poses, noise, units[1], turns)
    if reason := six_position.untestable_faces(faces):
        return SensorCalibration.nominal(units[0], reason), rest
    known = faces != 0
    means = np.diagonal(poses.mean_covariance(noise)[:3], axis1=1, axis2=2)
    fit = six_position.fit_six_position(
        poses.f[known], faces[known], gravity, means[:, known].mean()
    )
    made = in_raw_units(units[0], accelerometer.NAMES, fit.x, fit.covariance, method="six_position")
    why = None
    if fault := sensor_fault(made, "accelerometer"):
        why = f"the fit gives what no sensor has: {fault}"
    elif beyond := known_worse(fit.covariance[:6, :6], fit.x[3:6]):
        why = f"six faces show {beyond}: lay the device against a square edge"
    return (SensorCalibration.nominal(units[0], why) if why else made), rest


def best(*candidates):
    """Return the best calibration: multi-position, six-position, rest, nominal, in that order."""
    return min(candidates, key=lambda c: METHODS.index(c.method))


def calibrate_device(*, device, gravity, sessions, noise, settings, six_path, multi_path):
    """Calibrate a device from its sessions, as of `usable`, and its noise.json.

    Writes the six-position and the multi-position calibration; gravity is local, m/s^2.
    """
    model, units = NoiseModel.from_json(noise), raw_units(sessions)
    multi = read_recording(sessions, settings.longest_rotation)
    six, static = (read_poses(sessions, kind) for kind in ("six_position", "static"))
    largest = settings.largest_condition
    if not len(six) and accelerometer_undetermined(multi.poses, gravity, largest):
        # they may be faces
        six = multi.poses
    six_sensors = calibrate_six_position(six, model, gravity, units, settings)
    # the gyroscope needs the direction of gravity, from whichever calibration there is
    named = dict(zip(SENSORS, units, strict=True))
    given = six_sensors[0] if six_sensors[0].method != "nominal" else None
    how = model, gravity, named, settings, given
    made = calibrate_sensors(multi, *how)
    if turns := read_turns(sessions, best(made["accelerometer"], six_sensors[0])):
        made = calibrate_sensors(multi, *how, turns)
    force, turn = (made[sensor] for sensor in SENSORS)
    if not len(multi.poses) and len(static) and turn.method != "known_rotation":
        reason = f"{without_pose({}, 'multi_position')}; bias only"
        turn = rest_bias(static, model, units[1], reason)
    log, sha256 = layout(sessions), hashes(sessions)
    force = replace(
        force, not_testable=with_sessions(force.not_testable, sessions, six_sensors[0].not_testable)
    )
    for path, sensors in ((six_path, six_sensors), (multi_path, (force, turn))):
        named = (replace(s, not_testable=with_sessions(s.not_testable, sessions)) for s in sensors)
        Calibration(device, gravity, *named, log, sha256=sha256).to_json(path)
