"""Calibration of a device by the six-position and the multi-position method.

Nominal SI values are raw readings less the data sheet's offset, times its scale. The state x has
the 21 parameters of both sensors in nominal SI. A pose is a rest; a rotation leads from one pose to
the next. A known turn is a turn by a declared angle or at a declared rate.
"""

from dataclasses import replace

import numpy as np
from scipy.linalg import LinAlgError
from scipy.special import chdtri

from imuloop.calibrate.contradictions import why_changed
from imuloop.calibrate.known_rotation import read_turns
from imuloop.calibrate.nominal import nominal_sensors
from imuloop.calibrate.sessions import (
    GROUPS,
    hashes,
    layout,
    raw_units,
    read_poses,
    read_recording,
)
from imuloop.core.noise_model import NoiseModel
from imuloop.core.samples import SENSORS
from imuloop.estimate.joint_fit import JointFit
from imuloop.estimate.least_squares import NotConverged, fit, why_no_fit
from imuloop.factors.factors import Factors
from imuloop.model.calibration import Calibration
from imuloop.model.calibration_faults import sensor_fault
from imuloop.model.prior import data_sheet
from imuloop.model.state import BIAS, COUNT

# reduced chi square above which the sensor may have changed during the recording
CONTRADICTORY = 9.0
# rough standard deviations of each kind of residual, SI, for the first fit that gives the start
START = {"gravity_norm": 1e-3, "pose_rate": 1e-3, "rotation": 0.01}
# root mean square of the residuals of the first fit, in the standard deviations `START`, above
# which the data contradict each other
MISFIT = 10.0
# probability that a sensor within its prior is rejected as contradictory
CHANCE = 1e-4
# why a gyroscope has no fit if the accelerometer has none
NO_DIRECTION = "direction of gravity not known: the accelerometer has no calibration"


def start_fit(recording, noise, gravity, units, prior=None, turns=None, bias=None):
    """Return the JointFit, the set-up of a fit of both sensors, and why a sensor cannot be fitted.

    The iterations of the JointFit start at the result of a first fit, in which all residuals of a
    kind, such as rotations, have the same standard deviation, given in `START`. So the variances of
    the noise are estimated near the solution even if the solution is far from the prior. Exception:
    the iterations start at the mean of the prior if the first fit does not converge, or if its
    residuals, each divided by its standard deviation from `START`, have a root mean square above
    `MISFIT`. The data then contradict each other.

    Parameters
    ----------
    recording, noise, gravity : Recording, NoiseModel, float
        Poses and the rotations between them, the noise of the device, local gravity, m/s^2.
    units : dict of str to RawUnit
        Raw unit of each sensor, its scale and offset by the data sheet.
    prior : Prior, optional
        Prior of the parameters; by default the data sheet of a generic device.
    turns : KnownTurns, optional
        Known turns of the gyroscope, in addition to the rotations of the recording.
    bias : (ndarray, ndarray), optional
        Bias of the gyroscope and its variance, nominal SI, (3,) each. If given, the fit takes this
        bias as known and does not estimate it from the rests.

    Returns
    -------
    JointFit or None
        The fit, with the state to start from; None if no sensor can be fitted.
    dict of str to str
        Why a sensor cannot be fitted, by sensor: poses are missing, or its noise is not known.
    """
    poses, prior = recording.poses, prior or data_sheet()
    if not len(poses):
        why = recording.why_no_pose + recording.lost.rests_reason
        return None, dict.fromkeys(SENSORS, why)
    reasons = {s: why for s, axes in SENSORS.items() if (why := poses.unknown_noise(noise, axes))}
    estimated = tuple(s for s in SENSORS if s not in reasons)
    if not estimated:
        return None, reasons
    start = prior.mean.copy()
    if "gyroscope" in estimated:
        start[BIAS] = poses.w.mean(axis=0) if bias is None else bias[0]
    joint = JointFit(
        factors=Factors(gravity, sensors=estimated, bias_held=bias is not None),
        noise=noise,
        units=units,
        start=start,
        prior=prior,
        prior_rows=prior_rows(prior, turns, bias),
        method=recording.kind,
    )
    # all residuals of a kind have one variance
    _, kinds = joint.factors.rows(recording)
    variance = np.array([START[kind] ** 2 for kind in kinds.tolist()])
    linearise = joint.measure(start, recording).at
    try:
        rough = fit(linearise, x0=start, covariance=variance, prior=joint.prior_rows)
    except NotConverged:
        return joint, reasons
    if np.mean(rough.white**2) <= MISFIT**2:
        # the prior is widened if the data are of another unit, range or board than the data sheet
        rows = prior_rows(prior.widened(rough.x), turns, bias)
        joint = replace(joint, start=rough.x, prior_rows=rows)
    return joint, reasons


def prior_rows(prior, turns, bias):
    """Return the prior of the 21 parameters x of a fit as k linear equations ``R x = z``.

    R, (k, 21), and z, (k,), are scaled so that, by the prior, the components of ``R x - z`` are
    independent with mean zero and variance one. The first 21 equations are from the Prior `prior`.
    All further ones are from `turns`, the KnownTurns (turns of a declared angle or rate); if
    `turns` is None, there are 21 only. `bias` is the gyroscope's bias and its variance, nominal SI,
    (3,) each, which replace the bias of the prior. If it is None, the bias of the prior is kept.
    """
    if bias is not None:
        prior = prior.with_part(BIAS, mean=bias[0], covariance=np.diag(bias[1]))
    R, z = prior.rows()
    if turns:
        R_turns, z_turns = turns.rows()
        R, z = np.concatenate([R, R_turns]), np.append(z, z_turns)
    return R, z


def calibrate_sensors(recording, noise, gravity, units, settings, prior=None, turns=None):
    """Return the calibrations of both sensors by one fit to poses, rotations and known turns.

    A sensor without data, or with data that contradict each other, is not fitted. Its misalignment
    T, scale factors K and bias b are then the means of the prior, and its calibration says why. The
    bias of a gyroscope that is not fitted is still measured at rest.

    Parameters
    ----------
    recording, noise, gravity : Recording, NoiseModel, float
        Poses and the rotations between them, the noise of the device, local gravity, m/s^2.
    units : dict of str to RawUnit
        Raw unit of each sensor, its scale and offset by the data sheet.
    settings : CalibrateSettings
        If its `gyroscope_bias` is ``initial_rest``, the bias of the gyroscope is not a parameter of
        the fit: it is taken as the mean angular rate over the first rest.
    prior : Prior, optional
        Prior of the parameters; by default the data sheet of a generic device.
    turns : KnownTurns, optional
        Known turns of the gyroscope, in addition to the rotations of the recording.

    Returns
    -------
    dict of str to SensorCalibration
        The calibration of each sensor by name.
    """
    poses, bias, prior, calibrations = recording.poses, None, prior or data_sheet(), {}
    if settings.gyroscope_bias == "initial_rest" and len(poses):
        # the mean over the first rest, and its variance
        bias = poses.w[0], poses.mean_covariance(noise)[3:, 0, 0]
    joint, reasons = start_fit(recording, noise, gravity, units, prior, turns, bias)
    # a sensor whose data contradict each other is left out, and the other one is fitted again
    while joint is not None and joint.estimated:
        try:
            solution = joint.fit(recording)
        except LinAlgError as error:
            # if no sensor changed during the recording, the error does not say which one caused it;
            # the last is left out, because the first can be fitted without it
            changes = {s: why for s in joint.estimated if (why := why_changed(s, recording))}
            refused = changes or {joint.estimated[-1]: why_no_fit(error)}
        else:
            refused = contradictions(joint, solution, recording)
        if not refused:
            calibrations = joint.calibrations(solution)
            break
        reasons |= refused
        if "accelerometer" in refused and "gyroscope" in joint.estimated:
            reasons.setdefault("gyroscope", NO_DIRECTION)
        joint = joint.of_sensors(s for s in joint.estimated if s not in reasons)
    return calibrations | nominal_sensors(reasons, recording, noise, units, prior)


def contradictions(joint, solution, recording):
    """Return why the data of a sensor contradict each other, by sensor; empty if none do.

    The data of a sensor contradict each other in three cases:

    - the fit gives values that no sensor has;
    - the residuals of the sensor are larger than the prior allows;
    - the sensor changed during the recording, and the effects of the fit do not explain the change.
      A change is looked for only if one of the first two cases holds, or if the reduced χ² of the
      sensor is above `CONTRADICTORY`. If a change is found, only the change is given as the reason.

    The prior allows ``|r|² ≤ q tr(J P₀ Jᵀ)/n``, where r are the n residuals of the sensor after the
    fit, J is their Jacobian, and P₀ the covariance of the prior. The trace is the expected value of
    |r|² before the fit. For the accelerometer q is the quantile of χ²(n) that is exceeded with the
    probability `CHANCE`. For the gyroscope q is n, the mean of χ²(n). This limit is lower, because
    little is lost without the fit of a gyroscope: its bias is still measured at rest.

    Parameters
    ----------
    joint, solution : JointFit, Fit
        The set-up of the fit and its result.
    recording : Recording
        The poses and rotations that were fitted.

    Returns
    -------
    dict of str to str
        The reason for each sensor with contradictory data.
    """
    # the sensor that each residual measures
    refused, owner = {}, joint.factors.owners(recording)
    linearised = joint.linearise(solution, recording)
    jacobian = linearised.jacobian[:, :COUNT]
    # variance of each residual by the prior of the parameters
    expected = np.einsum("np,pq,nq->n", jacobian, joint.prior.covariance, jacobian)
    calibrations = joint.calibrations(solution)
    for sensor, calibration in calibrations.items():
        rows, why = owner == sensor, None
        count = rows.sum()
        quantile = chdtri(count, CHANCE) if sensor == "accelerometer" else count
        if fault := sensor_fault(calibration, sensor):
            why = f"the fit gives values that no sensor has: {fault}"
        elif np.sum(linearised.residual[rows] ** 2) > np.mean(expected[rows]) * quantile:
            what = "poses" if sensor == "accelerometer" else "turns"
            why = (
                f"its {what} contradict each other by more than the data sheet's tolerance; were "
                "samples clipped or wrapped around, did scale, offset or axes change midway?"
            )
        # a change is the better reason, and is looked for if the residuals are large, too; without
        # degrees of freedom the reduced χ² is None
        if why or (calibration.reduced_chi2 or 0.0) > CONTRADICTORY:
            why = why_changed(sensor, recording.without_effects(calibrations)) or why
        if why:
            refused[sensor] = why
    return refused


def calibrate_device(
    *, device, gravity, sessions, noise, settings, six_path, multi_path, prior=None
):
    """Write two JSON files: the six-position and the multi-position calibration of a device.

    Turns by a known angle or at a known rate are part of the multi-position calibration. Exception:
    if neither the multi-position sessions nor those of known turns have a pose, the gyroscope in
    the multi-position file has no calibration but its bias, which is then measured in the static
    sessions.

    Parameters
    ----------
    device : str
        Name of the device.
    gravity : float
        Local gravity, m/s^2.
    sessions : dict of str to dict
        Each session by name: its ``kind`` and the paths of its ``samples`` and ``segments``.
    noise, six_path, multi_path : path
        The noise.json to read, and the files to write.
    settings : CalibrateSettings
        Settings of the calibration.
    prior : Prior, optional
        Prior of the parameters; by default the data sheet of a generic device.
    """
    model, units = NoiseModel.from_json(noise), dict(zip(SENSORS, raw_units(sessions), strict=True))

    def calibrate(recording, turns=None):
        """Return the calibrations, a dict by sensor, from a Recording and optional KnownTurns.

        `recording` is the Recording, and `turns` are the KnownTurns or None.
        """
        return calibrate_sensors(recording, model, gravity, units, settings, prior, turns)

    multi, six, turned = (read_recording(sessions, settings.longest_rotation, k) for k in GROUPS)
    # the rests of known turns serve as poses if no session of the multi-position method has one
    recording = multi if len(multi.poses) or not len(turned.poses) else turned
    by_six, by_multi = calibrate(six), calibrate(recording)
    # a known turn needs the direction of gravity at its start, from a calibrated accelerometer
    gravity_source = by_multi if by_multi["accelerometer"].names else by_six
    if turns := read_turns(sessions, gravity_source["accelerometer"]):
        by_multi = calibrate(recording, turns)
    static = read_poses(sessions, "static")
    if not len(recording.poses) and len(static):
        by_multi |= nominal_sensors(
            {"gyroscope": f"{recording.why_no_pose}; bias only"},
            recording=replace(recording, poses=static),
            noise=model,
            units=units,
            prior=prior or data_sheet(),
        )
    log, sha256 = layout(sessions), hashes(sessions)
    for path, sensors in ((six_path, by_six), (multi_path, by_multi)):
        Calibration(device, gravity, **sensors, log=log, sha256=sha256).to_json(path)
