"""Calibrate a device: six-position and multi-position, from its sessions' segments."""

from dataclasses import replace

import numpy as np
from scipy.linalg import LinAlgError, block_diag
from scipy.special import chdtri

from imuloop.calibrate.contradictions import change, changed_at
from imuloop.calibrate.known_rotation import read_turns
from imuloop.calibrate.least_squares import NotConverged, fit, why_no_fit
from imuloop.calibrate.poses import gather_poses
from imuloop.calibrate.prior import data_sheets
from imuloop.calibrate.raw_units import in_raw_units, prior_content
from imuloop.calibrate.recording import record
from imuloop.calibrate.sensor_pair import BASES, SensorPair, places
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


def start_pair(
    recording, noise, gravity, units, settings, priors=None, turns=None, bias=None, method=POSED[0]
):
    """Return the SensorPair of a recording, None if it holds no data, and reasons.

    Parameters
    ----------
    recording, noise, gravity, settings : Recording, NoiseModel, float, CalibrateSettings
        As in `SensorPair`.
    units : dict of str to RawUnit
        Units of each sensor.
    priors : dict of str to SensorPrior, optional
        What is known of each sensor before; by default the data sheet of a generic device.
    turns : KnownTurns, optional
        Known turns of the gyroscope, in addition to the rotations of the recording.
    bias, method : optional
        As in `SensorPair`.

    Returns
    -------
    SensorPair or None
        Its base parameters are those to start a fit from.
    dict of str to str
        Why a sensor has no data.
    """
    poses, priors = recording.poses, priors or data_sheets()
    if not len(poses):
        why = without_pose({}, "multi_position") + recording.lost.rests_reason
        return None, dict.fromkeys(SENSORS, why)
    reasons = {s: poses.unknown_noise(noise, axes) for s, axes in SENSORS.items()}
    reasons = {sensor: why for sensor, why in reasons.items() if why}
    estimated = tuple(s for s in SENSORS if s not in reasons)
    if not estimated:
        return None, reasons
    base = np.concatenate([prior.mean for prior in priors.values()])
    how = {"priors": priors, "method": method, "bias": bias}
    pair = SensorPair(noise, gravity, units, settings, estimated, base, **how)
    if "gyroscope" in estimated:
        base[-3:] = poses.w.mean(axis=0) if bias is None else bias[0]
    known = _knowing(pair, priors, turns)
    # the variance components are estimated where the data lead, however far from the prior
    model, kinds = pair.model_at(base[pair.free], recording), pair.kinds_of_rows(recording)[0]
    variance = np.array([START[kind] ** 2 for kind in kinds.tolist()])
    try:
        rough = fit(model.residuals, base[pair.free], variance, known.prior_rows())
    except NotConverged:
        return known, reasons
    if np.mean(rough.white**2) > MISFIT**2:
        return known, reasons
    base[pair.free] = rough.x
    each = places()
    wide = {sensor: prior.widened(base[each[sensor]]) for sensor, prior in priors.items()}
    return _knowing(pair, wide, turns), reasons


def _knowing(pair, priors, turns):
    """Return a SensorPair with the rows of the priors of its sensors and of known turns."""
    for sensor in pair.estimated:
        pair = pair.knowing(sensor, *priors[sensor].rows())
    if turns is not None and len(turns) and "gyroscope" in pair.estimated:
        pair = pair.knowing("gyroscope", *turns.rows())
    return pair


def calibrate_sensors(
    recording, noise, gravity, units, settings, priors=None, turns=None, method="multi_position"
):
    """Return the calibration of both sensors by the poses of a recording and the turns between.

    A sensor keeps the nominal values, with the reason, where the recording holds none of its data,
    or data that contradict each other. Arguments as in `start_pair`; `method` is the name that the
    calibrations carry.
    """
    poses, bias, priors = recording.poses, None, priors or data_sheets()
    if settings.gyroscope_bias == "initial_rest" and len(poses):
        # its error is the error of the mean over the first rest
        bias = poses.w[0], poses.mean_covariance(noise)[3:, 0, 0]
    how = noise, gravity, units, settings, priors
    pair, reasons = start_pair(recording, *how, turns, bias, method)
    made = {}
    while pair is not None and pair.estimated:
        try:
            solution = pair.fit(recording)
        except LinAlgError as error:
            refused = without_fit(pair, recording, error)
        else:
            made, refused = pair.calibrations(solution), contradictions(pair, solution, recording)
        if not refused:
            break
        reasons |= refused
        if "accelerometer" in refused and "gyroscope" in pair.estimated:
            reasons.setdefault("gyroscope", NO_DIRECTION)
        left = tuple(sensor for sensor in pair.estimated if sensor not in reasons)
        pair, made = replace(pair, estimated=left), {}
    return made | nominal_sensors(reasons, recording, noise, units, priors)


def without_fit(pair, recording, error):
    """Return why sensors have no fit, by sensor: those that changed, or else the last one.

    Takes the SensorPair, its Recording and the LinAlgError of the fit.
    """
    changes = {s: change(s, recording.poses, recording.rotations) for s in pair.estimated}
    changes = {sensor: why for sensor, why in changes.items() if why}
    return changes or {pair.estimated[-1]: why_no_fit(error)}


def contradictions(pair, solution, recording):
    """Return why the data of a sensor contradict each other, text, by such sensors.

    They do if the sensor changed amid the recording, if the fit gives what no sensor has, or if its
    n residuals r are larger than the prior alone lets expect: ``|r|² > χ²(n) tr(J P₀ Jᵀ)/n``, with
    the quantile of χ² at the probability `CHANCE` for an accelerometer and its mean n for a
    gyroscope, whose bias a rest alone gives. Takes the SensorPair, the Solution of its fit and the
    Recording.
    """
    found, owner = {}, pair.kinds_of_rows(recording)[1]
    r, jacobian = pair.model(solution, recording).residuals(solution.fit.x)
    prior = block_diag(*(p.covariance for p in pair.priors.values()))[np.ix_(pair.free, pair.free)]
    expected = np.einsum("np,pq,nq->n", jacobian[:, : len(prior)], prior, jacobian[:, : len(prior)])
    for sensor, made in pair.calibrations(solution).items():
        rows, why = owner == sensor, None
        count = rows.sum()
        most = chdtri(count, CHANCE) if sensor == "accelerometer" else count
        if fault := sensor_fault(made, sensor):
            why = f"the fit gives what no sensor has: {fault}"
        elif np.sum(r[rows] ** 2) > np.mean(expected[rows]) * most:
            what = "poses" if sensor == "accelerometer" else "turns"
            why = (
                f"its {what} contradict each other by more than the data sheet's tolerance; were "
                "samples clipped or wrapped around, did scale, offset or axes change midway?"
            )
        if why or (made.reduced_chi2 or 0.0) > CONTRADICTORY:
            why = change(sensor, recording.poses, recording.rotations) or why
        if why:
            found[sensor] = why
    return found


def nominal_sensors(reasons, recording, noise, units, priors):
    """Return the calibrations of sensors that have no fit, by the reasons.

    The gyroscope's bias is measured wherever there is a rest, unless it changed amid the recording.
    Arguments as in `start_pair`, and the reason by sensor.
    """
    made = {}
    for sensor, reason in reasons.items():
        unit = units[sensor]
        nominal = SensorCalibration.nominal(unit, reason)
        if sensor == "gyroscope":
            poses = recording.poses
            time, words = changed_at(sensor, poses, recording.rotations) or (np.inf, "")
            reason = reason if words in reason else f"{reason}; {words}"
            nominal = rest_bias(poses, noise, unit, reason, time)
        made[sensor] = at_prior(nominal, priors[sensor], BASES[sensor])
    return made


def at_prior(calibration, prior, base):
    """Return a SensorCalibration without a fit, its unmeasured parameters those of a SensorPrior.

    `base` are the names of the parameters of the prior.
    """
    unit = calibration.raw_unit
    mean = in_raw_units(unit, base, prior.mean, prior.covariance, method="nominal")
    b = calibration.b if calibration.names else mean.b
    content = prior_content(prior, base, unit)
    return replace(calibration, T=mean.T, K=mean.K, b=b, prior=content)


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
    *, device, gravity, sessions, noise, settings, six_path, multi_path, priors=None
):
    """Calibrate a device from its sessions, as in `usable`, and its noise.json.

    Writes the six-position and the multi-position calibration; gravity is local, m/s^2. `priors`
    as in `start_pair`.
    """
    model, units = NoiseModel.from_json(noise), dict(zip(SENSORS, raw_units(sessions), strict=True))
    how = model, gravity, units, settings, priors
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
        gyroscope = (priors or data_sheets())["gyroscope"]
        made["gyroscope"] = at_prior(bias, gyroscope, BASES["gyroscope"])
    log, sha256 = layout(sessions), hashes(sessions)
    for path, sensors in ((six_path, six), (multi_path, made)):
        named = (
            replace(sensors[s], not_testable=with_sessions(sensors[s].not_testable, sessions))
            for s in SENSORS
        )
        Calibration(device, gravity, *named, log, sha256=sha256).to_json(path)
