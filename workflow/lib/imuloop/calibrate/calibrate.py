"""Calibration of a device by the six-position and the multi-position method."""

from dataclasses import replace

import numpy as np
from scipy.linalg import LinAlgError
from scipy.special import chdtri

from imuloop.calibrate.contradictions import change, changed_at
from imuloop.calibrate.known_rotation import read_turns
from imuloop.calibrate.poses import gather_poses
from imuloop.calibrate.recording import record
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
from imuloop.core.units import RawUnit
from imuloop.estimate.joint_fit import JointFit
from imuloop.estimate.least_squares import NotConverged, fit, why_no_fit
from imuloop.factors.factors import Factors
from imuloop.model.calibration import Calibration
from imuloop.model.calibration_faults import sensor_fault
from imuloop.model.prior import data_sheet
from imuloop.model.raw_units import in_raw_units
from imuloop.model.sensor_calibration import SensorCalibration
from imuloop.model.state import BASE, BIAS, COUNT

KINDS = ("multi_position", "six_position", "static", "known_rotation", "reference_motion")
# kinds of the sessions whose rests are poses in any attitude
POSED = ("multi_position", "reference_motion")
# kinds of the sessions that are fitted together, by the method of the calibration
GROUPS = {method: (method,) for method in ("six_position", "known_rotation")}
GROUPS = {"multi_position": POSED} | GROUPS
# reduced chi square above which the sensor may have changed during the recording
CONTRADICTORY = 9.0
# rough standard deviations of each kind of residual, SI, for the first fit that gives the start
START = {"gravity_norm": 1e-3, "pose_rate": 1e-3, "rotation": 0.01}
# root mean square of the residuals of the first fit, in these standard deviations, above which the
# data contradict each other
MISFIT = 10.0
# probability that a sensor within its prior is rejected as contradictory
CHANCE = 1e-4
# standard deviations by which two equal biases may differ
SAME = 5.0
# why a gyroscope has no fit if the accelerometer has none
NO_DIRECTION = "direction of gravity not known: the accelerometer has no calibration"


def usable_sessions(sessions, *kinds):
    """Return a list of (session, segments) of the sessions of some kinds that were not rejected.

    `sessions` are dicts by name, with ``kind`` and the paths ``samples`` and ``segments``. The
    segments of the result are dicts of arrays.
    """
    chosen = [(s, read_columns(s["segments"])) for s in sessions.values() if s["kind"] in kinds]
    return [(session, table) for session, table in chosen if len(table["kind"])]


def without_pose(sessions, kind):
    """Return why the sessions of one kind have no pose, text.

    `sessions` are dicts by name, as for `usable_sessions`.
    """
    fates = []
    for name, session in sessions.items():
        if session["kind"] == kind:
            rejected = not len(read_columns(session["segments"], ["kind"])["kind"])
            fates.append(f"{name} {'was rejected' if rejected else 'has no rest that is a pose'}")
    return f"no {kind} session with a pose" + (f": {', '.join(fates)}" if fates else "")


def with_sessions(reason, sessions):
    """Return a reason, text or None, with the fate of each session if the reason is missing poses.

    `sessions` are dicts by name, as for `usable_sessions`.
    """
    for kind in ("multi_position", "six_position"):
        bare = without_pose({}, kind)
        if reason and reason.startswith(bare):
            return reason.replace(bare, without_pose(sessions, kind), 1)
    return reason


def read_poses(sessions, kind):
    """Return the Poses of the sessions of one kind.

    `sessions` are dicts by name, as for `usable_sessions`.
    """
    return gather_poses([table for _, table in usable_sessions(sessions, kind)])


def read_recording(sessions, longest_rotation, kinds=POSED):
    """Return the Recording of the sessions of some kinds; it has no poses if there is no session.

    `sessions` are dicts by name, as for `usable_sessions`; `longest_rotation` is in s.
    """
    chosen = usable_sessions(sessions, *kinds)
    columns = (TIME, *CHANNELS, TEMPERATURE, *OWN_TIME.values())
    samples = [read_columns(session["samples"], columns) for session, _ in chosen]
    rails = [read_metadata(session["samples"]).get("rails", {}) for session, _ in chosen]
    return record(samples, [table for _, table in chosen], longest_rotation, rails)


def first_log(sessions):
    """Return the metadata of the samples of the first session in the order of `KINDS`, a dict.

    A session without samples comes last, because the units of a log that was not read are not
    known. `sessions` are dicts by name, as for `usable_sessions`.
    """

    def order(session):
        return not len(Samples(session["samples"])), KINDS.index(session["kind"])

    return read_metadata(min(sessions.values(), key=order)["samples"])


def raw_units(sessions):
    """Return the RawUnit of the accelerometer and of the gyroscope in the log of `first_log`."""
    units = first_log(sessions)["raw_units"]
    chosen = (units[quantity] for quantity in ("acceleration", "angular_rate"))
    return tuple(RawUnit(unit["name"], unit["scale"], unit["offset"]) for unit in chosen)


def layout(sessions):
    """Return the settings that were declared for the log of `first_log`, a dict.

    If the log holds an autopilot's numbers of its sensors, they have the key ``sensor_ids``.
    """
    first = first_log(sessions)
    ids = first.get("sensor_ids")
    return first.get("declared", {}) | ({"sensor_ids": ids} if ids else {})


def hashes(sessions):
    """Return the SHA-256 of each file of the sessions' logs, a tuple of str without duplicates.

    `sessions` are dicts by name, as for `usable_sessions`.
    """
    files = [read_metadata(session["samples"]).get("sha256", {}) for session in sessions.values()]
    return tuple(dict.fromkeys(value for by_file in files for value in by_file.values()))


def largest_recording(sessions, longest_rotation):
    """Return the method in `GROUPS` whose sessions have the most poses, and their Recording.

    `sessions` are dicts by name, as for `usable_sessions`; `longest_rotation` is in s.
    """
    made = {name: read_recording(sessions, longest_rotation, k) for name, k in GROUPS.items()}
    return max(made.items(), key=lambda item: len(item[1].poses))


def start_fit(recording, noise, gravity, units, prior=None, turns=None, bias=None, method=POSED[0]):
    """Return the JointFit of a recording, and why a sensor has no data.

    Parameters
    ----------
    recording, noise, gravity : Recording, NoiseModel, float
        Poses and the rotations between them, the noise of the device, local gravity, m/s^2.
    units : dict of str to RawUnit
        Unit of each sensor.
    prior : Prior, optional
        Prior of the parameters; by default the data sheet of a generic device.
    turns : KnownTurns, optional
        Known turns of the gyroscope, in addition to the rotations of the recording.
    bias : (ndarray, ndarray), optional
        Bias of the gyroscope and its variance, nominal SI, (3,) each, if the bias is not estimated.
    method : str, optional
        Name of the method, which the calibrations carry.

    Returns
    -------
    JointFit or None
        The fit, with the state to start from; None if no sensor has data.
    dict of str to str
        For each sensor without data, why it has none.
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
    # a first fit gives the start, so that the variance components are estimated near the solution
    # even if it is far from the prior
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
    """Return rows R, (k, 21), and z, (k,), of a Prior and KnownTurns: R x - z has variance one.

    x is the state without effects. `turns` may be None. `bias`, if not None, is the gyroscope's
    bias and its variance, nominal SI, which replace those of the prior.
    """
    rows, z = (prior if bias is None else prior.with_bias(*bias)).rows()
    if turns is None or not len(turns):
        return rows, z
    turn_rows, turn_z = turns.rows()
    turn_rows = np.pad(turn_rows, ((0, 0), (BASE["gyroscope"].start, 0)))
    return np.concatenate([rows, turn_rows]), np.append(z, turn_z)


def calibrate_sensors(
    recording, noise, gravity, units, settings, prior=None, turns=None, method="multi_position"
):
    """Return the SensorCalibration of both sensors, a dict by sensor.

    They are fitted to the poses of a recording and the rotations between them. A sensor without
    data, or with data that contradict each other, keeps the nominal values and gets the reason.
    `settings` is a CalibrateSettings; the other arguments are the same as for `start_fit`.
    """
    poses, bias, prior = recording.poses, None, prior or data_sheet()
    if settings.gyroscope_bias == "initial_rest" and len(poses):
        # the mean over the first rest, and its variance
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
    """Return why the data of a sensor contradict each other, text by sensor, if they do.

    The data of a sensor contradict each other in three cases: the sensor changed during the
    recording; the fit gives values that no sensor has; or the residuals are larger than the prior
    allows. The last is ``|r|² > q tr(J P₀ Jᵀ)/n``, with the n residuals r, their Jacobian J and the
    covariance P₀ of the prior. For the accelerometer q is the quantile of χ²(n) that is exceeded
    with the probability `CHANCE`. For the gyroscope q is n, the mean of χ²(n): if its fit is
    refused, a rest still gives its bias.

    Takes a JointFit, its Fit, `found`, and the Recording.
    """
    refused, owner = {}, joint.factors.owners(recording)
    linearised = joint.linearise(found, recording)
    jacobian = linearised.jacobian[:, :COUNT]
    expected = np.einsum("np,pq,nq->n", jacobian, joint.prior.covariance, jacobian)
    for sensor, made in joint.calibrations(found).items():
        rows, why = owner == sensor, None
        count = rows.sum()
        quantile = chdtri(count, CHANCE) if sensor == "accelerometer" else count
        if fault := sensor_fault(made, sensor):
            why = f"the fit gives what no sensor has: {fault}"
        elif np.sum(linearised.residual[rows] ** 2) > np.mean(expected[rows]) * quantile:
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
    """Return the SensorCalibration of each sensor without a fit, a dict by sensor.

    The bias of the gyroscope is measured if there is a rest, unless it changed during the
    recording. `reasons` says by sensor why there is no fit, `units` is the RawUnit by sensor.
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
    """Return a SensorCalibration without a fit, with the Prior's mean for unmeasured parameters.

    T and K are always unmeasured, b if the calibration names no parameter.
    """
    mean = in_raw_units(sensor, calibration.raw_unit, *prior.of(sensor), prior=prior)
    b = calibration.b if calibration.names else mean.b
    return replace(calibration, T=mean.T, K=mean.K, b=b, prior=mean.prior)


def rest_bias(poses, noise, unit, reason, changed=np.inf):
    """Return the SensorCalibration of a gyroscope that only rested: only its bias is measured.

    The bias is the mean over the poses, weighted by the inverse covariance of their noise. If it
    varies more between n power cycles than the noise explains, it is the mean over the power
    cycles, with the variance ``s²/n``, where s² is the variance between them.

    The bias is nominal if there is no rest, if the noise of an axis is not known, or if the biases
    before and after the time `changed` differ by more than `SAME` standard deviations.

    Parameters
    ----------
    poses, noise, unit : Poses, NoiseModel, RawUnit
        The rests, the noise of the device, and the unit of the gyroscope.
    reason : str
        Why the other parameters are not calibrated.
    changed : float, optional
        Time at which the gyroscope changed, s.
    """
    silent = poses.unknown_noise(noise, ANGULAR_RATE)
    if silent or not len(poses):
        reasons = dict.fromkeys(filter(None, (reason, silent)))
        return SensorCalibration.nominal(unit, "; ".join(reasons))
    covariance = poses.mean_covariance(noise)[3:]
    weights = np.linalg.solve(covariance, np.ones((3, len(poses), 1)))[..., 0]
    late = poses.start_s > changed
    if late.any() and not late.all():
        parts = [weights * mask for mask in (late, ~late)]
        parts = [part / part.sum(axis=1, keepdims=True) for part in parts]
        contrast = parts[0] - parts[1]
        change = np.einsum("an,na->a", contrast, poses.w)
        if np.any(change**2 > SAME**2 * np.einsum("an,anm,am->a", contrast, covariance, contrast)):
            return SensorCalibration.nominal(unit, reason)
    total = weights.sum(axis=1)
    bias, variance = np.einsum("an,na->a", weights, poses.w) / total, 1 / total
    cycles = [weights * (poses.power_cycle == k) for k in np.unique(poses.power_cycle)]
    if len(cycles) > 1:
        biases = np.array([np.einsum("an,na->a", w, poses.w) / w.sum(axis=1) for w in cycles])
        between = biases.var(axis=0, ddof=1) / len(cycles)
        bias = np.where(between > variance, biases.mean(axis=0), bias)
        variance = np.maximum(between, variance)
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
    """Write the six-position and the multi-position calibration of a device, JSON files.

    Parameters
    ----------
    device : str
        Name of the device.
    gravity : float
        Local gravity, m/s^2.
    sessions : dict
        Sessions by name, as for `usable_sessions`.
    noise, six_path, multi_path : path
        The noise.json to read, and the files to write.
    settings : CalibrateSettings
    prior : Prior, optional
        Prior of the parameters; by default the data sheet of a generic device.
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
    # a known turn needs the direction of gravity at its start
    levelled = made if made["accelerometer"].names else six
    if turns := read_turns(sessions, levelled["accelerometer"]):
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
