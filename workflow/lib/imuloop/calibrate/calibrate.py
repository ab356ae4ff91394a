"""Calibrate a device: six-position and multi-position, from its sessions' segments."""

from dataclasses import replace

import numpy as np
from scipy.linalg import LinAlgError
from scipy.special import chdtri

from imuloop.calibrate.contradictions import change, changed_at
from imuloop.calibrate.known_rotation import read_turns
from imuloop.calibrate.poses import gather_poses
from imuloop.calibrate.recording import record
from imuloop.core.calibration_faults import sensor_fault
from imuloop.core.model import Calibration
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import (
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
from imuloop.core.sensor_calibration import SensorCalibration
from imuloop.core.units import RawUnit
from imuloop.estimate.joint_fit import JointFit
from imuloop.estimate.least_squares import NotConverged, fit, why_no_fit
from imuloop.factors.factors import Factors
from imuloop.model.prior import data_sheet
from imuloop.model.raw_units import in_raw_units
from imuloop.model.state import BASE, BIAS, COUNT

KINDS = ("multi_position", "six_position", "static", "known_rotation", "reference_motion")
# of sessions whose rests are poses in any attitude
POSED = ("multi_position", "reference_motion")
# sessions that are fitted together, by what the calibration is called
GROUPS = {method: (method,) for method in ("six_position", "known_rotation")}
GROUPS = {"multi_position": POSED} | GROUPS
# reduced chi square from which on a sensor may have changed amid the recording
CONTRADICTORY = 9.0
# rough errors of each kind of residual, SI, by which the start of a fit is found
START = {"gravity_norm": 1e-3, "pose_rate": 1e-3, "rotation": 0.01}
# their root mean square, over these errors, beyond which the data contradict each other
MISFIT = 10.0
# probability with which a sensor as its prior has it is taken for one that contradicts itself
CHANCE = 1e-4
# standard deviations up to which two biases may differ and be one
SAME = 5.0
# why a gyroscope has no fit where the accelerometer has none
NO_DIRECTION = "direction of gravity not known: the accelerometer has no calibration"


def usable(sessions, *kinds):
    """Return (session, segments) of each session of some kinds that was not rejected.

    Takes ``kind``, ``samples`` and ``segments`` (paths) of each session by name; the segments that
    it gives are a dict of arrays.
    """
    chosen = [(s, read_columns(s["segments"])) for s in sessions.values() if s["kind"] in kinds]
    return [(session, table) for session, table in chosen if len(table["kind"])]


def without_pose(sessions, kind):
    """Return why there is no pose of one kind; arguments as in `usable`."""
    became = []
    for name, session in sessions.items():
        if session["kind"] == kind:
            rejected = not len(read_columns(session["segments"], ["kind"])["kind"])
            became.append(f"{name} {'was rejected' if rejected else 'has no rest that is a pose'}")
    return f"no {kind} session with a pose" + (f": {', '.join(became)}" if became else "")


def with_sessions(reason, sessions):
    """Return a reason, text or None; for missing poses, also what happened to the sessions.

    Sessions as in `usable`.
    """
    for kind in ("multi_position", "six_position"):
        bare = without_pose({}, kind)
        if reason and reason.startswith(bare):
            return reason.replace(bare, without_pose(sessions, kind), 1)
    return reason


def read_poses(sessions, kind):
    """Return the poses of the sessions of one kind; arguments as in `usable`."""
    return gather_poses([table for _, table in usable(sessions, kind)])


def read_recording(sessions, longest_rotation, kinds=POSED):
    """Return the Recording of the sessions of some kinds, without poses if there is none.

    Takes sessions as `usable` does, and the longest rotation, s.
    """
    chosen = usable(sessions, *kinds)
    columns = (TIME, *CHANNELS, TEMPERATURE, *OWN_TIME.values())
    samples = [read_columns(session["samples"], columns) for session, _ in chosen]
    rails = [read_metadata(session["samples"]).get("rails", {}) for session, _ in chosen]
    return record(samples, [table for _, table in chosen], longest_rotation, rails)


def first_log(sessions):
    """Return the metadata of the samples of the first session, by order of `KINDS`, a dict.

    Sessions as in `usable`. One without rows comes last: of a log that was not read the units are
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


def largest_recording(sessions, longest_rotation):
    """Return the name in `GROUPS` and the Recording of the sessions that have the most poses."""
    made = {name: read_recording(sessions, longest_rotation, k) for name, k in GROUPS.items()}
    return max(made.items(), key=lambda each: len(each[1].poses))


def start_fit(recording, noise, gravity, units, prior=None, turns=None, bias=None, method=POSED[0]):
    """Return the JointFit of a recording, None if it holds no data, and reasons.

    Parameters
    ----------
    recording, noise, gravity : Recording, NoiseModel, float
        Rests and turns between them, the noise of the device, local gravity, m/s^2.
    units : dict of str to RawUnit
        Units of each sensor.
    prior : Prior, optional
        What is known before; by default the data sheet of a generic device.
    turns : KnownTurns, optional
        Known turns of the gyroscope, in addition to the rotations of the recording.
    bias : (ndarray, ndarray), optional
        Bias of the gyroscope and its variance, SI as logged, where it is held.
    method : str, optional
        As in `JointFit`.

    Returns
    -------
    JointFit or None
        With the state to start a fit from.
    dict of str to str
        Why a sensor has no data.
    """
    poses, prior = recording.poses, prior or data_sheet()
    if not len(poses):
        why = without_pose({}, "multi_position") + recording.lost.rests_reason
        return None, dict.fromkeys(SENSORS, why)
    reasons = {s: why for s, axes in SENSORS.items() if (why := poses.unknown_noise(noise, axes))}
    estimated = tuple(s for s in SENSORS if s not in reasons)
    if not estimated:
        return None, reasons
    start = prior.mean.copy()
    if "gyroscope" in estimated:
        start[BIAS] = poses.w.mean(axis=0) if bias is None else bias[0]
    factors = Factors(gravity, estimated, bias_held=bias is not None)
    known = known_rows(prior, turns, bias)
    joint = JointFit(factors, noise, units, start, prior, known, method)
    # the variance components are estimated where the data lead, however far from the prior
    kinds = factors.rows(recording)[1].tolist()
    variance = np.array([START[kind] ** 2 for kind in kinds])
    try:
        rough = fit(joint.measure(start, recording).at, start, variance, joint.known)
    except NotConverged:
        return joint, reasons
    if np.mean(rough.white**2) <= MISFIT**2:
        known = known_rows(prior.widened(rough.x), turns, bias)
        joint = replace(joint, start=rough.x, known=known)
    return joint, reasons


def known_rows(prior, turns, bias):
    """Return rows R, (k, 21), and z of a Prior and KnownTurns; arguments as in `start_fit`."""
    rows, z = (prior if bias is None else prior.with_bias(*bias)).rows()
    if turns is None or not len(turns):
        return rows, z
    more, of_turns = turns.rows()
    more = np.pad(more, ((0, 0), (BASE["gyroscope"].start, 0)))
    return np.concatenate([rows, more]), np.append(z, of_turns)


def calibrate_sensors(
    recording, noise, gravity, units, settings, prior=None, turns=None, method="multi_position"
):
    """Return the calibration of both sensors by the poses of a recording and the turns between.

    A sensor keeps the nominal values, with the reason, where the recording holds none of its data,
    or data that contradict each other. Takes CalibrateSettings, others as in `start_fit`; `method`
    is the name that the calibrations carry.
    """
    poses, bias, prior = recording.poses, None, prior or data_sheet()
    if settings.gyroscope_bias == "initial_rest" and len(poses):
        # its error is the error of the mean over the first rest
        bias = poses.w[0], poses.mean_covariance(noise)[3:, 0, 0]
    joint, reasons = start_fit(recording, noise, gravity, units, prior, turns, bias, method)
    made = {}
    while joint is not None and joint.estimated:
        try:
            found = joint.fit(recording)
        except LinAlgError as error:
            changes = {s: why for s in joint.estimated if (why := change(s, recording))}
            refused = changes or {joint.estimated[-1]: why_no_fit(error)}
        else:
            made, refused = joint.calibrations(found), contradictions(joint, found, recording)
        if not refused:
            break
        reasons |= refused
        if "accelerometer" in refused and "gyroscope" in joint.estimated:
            reasons.setdefault("gyroscope", NO_DIRECTION)
        joint = joint.of_sensors(s for s in joint.estimated if s not in reasons)
        made = {}
    return made | nominal_sensors(reasons, recording, noise, units, prior)


def contradictions(joint, found, recording):
    """Return why the data of a sensor contradict each other, text, by such sensors.

    They do if the sensor changed amid the recording, if the fit gives what no sensor has, or if its
    n residuals r are larger than the prior alone lets expect: ``|r|² > χ²(n) tr(J P₀ Jᵀ)/n``, with
    the quantile of χ² at the probability `CHANCE` for an accelerometer and its mean n for a
    gyroscope, whose bias a rest alone gives. Takes the JointFit, its Fit and the Recording.
    """
    refused, owner = {}, joint.factors.owners(recording)
    at = joint.linearise(found, recording)
    jacobian = at.jacobian[:, :COUNT]
    expected = np.einsum("np,pq,nq->n", jacobian, joint.prior.covariance, jacobian)
    for sensor, made in joint.calibrations(found).items():
        rows, why = owner == sensor, None
        count = rows.sum()
        most = chdtri(count, CHANCE) if sensor == "accelerometer" else count
        if fault := sensor_fault(made, sensor):
            why = f"the fit gives what no sensor has: {fault}"
        elif np.sum(at.residual[rows] ** 2) > np.mean(expected[rows]) * most:
            what = "poses" if sensor == "accelerometer" else "turns"
            why = (
                f"its {what} contradict each other by more than the data sheet's tolerance; were "
                "samples clipped or wrapped around, did scale, offset or axes change midway?"
            )
        if why or (made.reduced_chi2 or 0.0) > CONTRADICTORY:
            why = change(sensor, recording) or why
        if why:
            refused[sensor] = why
    return refused


def nominal_sensors(reasons, recording, noise, units, prior):
    """Return the calibrations of sensors that have no fit, by the reasons.

    The gyroscope's bias is measured wherever there is a rest, unless it changed amid the recording.
    Arguments as in `start_fit`, and the reason by sensor.
    """
    made = {}
    for sensor, reason in reasons.items():
        nominal = SensorCalibration.nominal(units[sensor], reason)
        if sensor == "gyroscope":
            time, words = changed_at(sensor, recording) or (np.inf, "")
            reason = reason if words in reason else f"{reason}; {words}"
            nominal = rest_bias(recording.poses, noise, units[sensor], reason, time)
        made[sensor] = at_prior(nominal, prior, sensor)
    return made


def at_prior(calibration, prior, sensor):
    """Return a SensorCalibration without a fit, its unmeasured parameters those of the Prior."""
    mean = in_raw_units(sensor, calibration.raw_unit, *prior.of(sensor), prior=prior)
    b = calibration.b if calibration.names else mean.b
    return replace(calibration, T=mean.T, K=mean.K, b=b, prior=mean.prior)


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


def calibrate_device(
    *, device, gravity, sessions, noise, settings, six_path, multi_path, prior=None
):
    """Calibrate a device from its sessions, as in `usable`, and its noise.json.

    Writes the six-position and the multi-position calibration; gravity is local, m/s^2. `prior`
    as in `start_fit`.
    """
    model, units = NoiseModel.from_json(noise), dict(zip(SENSORS, raw_units(sessions), strict=True))
    how = model, gravity, units, settings, prior
    multi, six, turned = (
        read_recording(sessions, settings.longest_rotation, kinds) for kinds in GROUPS.values()
    )
    method = "multi_position" if len(multi.poses) else "known_rotation"
    recording = multi if len(multi.poses) else turned
    six = calibrate_sensors(six, *how, method="six_position")
    made = calibrate_sensors(recording, *how, method=method)
    # the direction of gravity, which a known turn starts from
    known = made if made["accelerometer"].names else six
    if turns := read_turns(sessions, known["accelerometer"]):
        made = calibrate_sensors(recording, *how, turns, method=method)
    static = read_poses(sessions, "static")
    if not len(recording.poses) and len(static):
        reason = f"{without_pose(sessions, 'multi_position')}; bias only"
        bias = rest_bias(static, model, units["gyroscope"], reason)
        made["gyroscope"] = at_prior(bias, prior or data_sheet(), "gyroscope")
    log, sha256 = layout(sessions), hashes(sessions)
    for path, sensors in ((six_path, six), (multi_path, made)):
        named = (
            replace(sensors[s], not_testable=with_sessions(sensors[s].not_testable, sessions))
            for s in SENSORS
        )
        Calibration(device, gravity, *named, log, sha256=sha256).to_json(path)
