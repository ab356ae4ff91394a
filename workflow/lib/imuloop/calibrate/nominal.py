"""Calibrations of sensors that poses and rotations do not determine."""

from dataclasses import replace

import numpy as np

from imuloop.calibrate.contradictions import change_of_sensor
from imuloop.core.samples import ANGULAR_RATE
from imuloop.model.raw_units import in_raw_units
from imuloop.model.sensor_calibration import SensorCalibration

# standard deviations by which two equal biases may differ
SAME = 5.0


def nominal_sensors(reasons, recording, noise, units, prior):
    """Return the calibrations of sensors without a fit, a dict of SensorCalibration by sensor.

    Their misalignment T, scale factors K and bias b are the means of the prior. If there is a rest,
    the bias of the gyroscope is measured instead, unless this bias changed during the recording.

    Parameters
    ----------
    reasons : dict of str to str
        For each sensor, why it has no fit.
    recording : Recording
        Poses and rotations; the poses give the bias of the gyroscope.
    noise : NoiseModel
        Noise of the device.
    units : dict of str to RawUnit
        Raw unit of each sensor, its scale and offset by the data sheet.
    prior : Prior
        Prior of the parameters.

    Returns
    -------
    dict of str to SensorCalibration
        A calibration for each sensor in `reasons`.
    """
    calibrations = {}
    for sensor, reason in reasons.items():
        calibration = SensorCalibration.nominal(units[sensor], reason)
        if sensor == "gyroscope":
            time, words = change_of_sensor(sensor, recording) or (np.inf, "")
            # the reason may name the change already; without a change the words are empty
            reason = reason if words in reason else f"{reason}; {words}"
            calibration = rest_bias(recording.poses, noise, units[sensor], reason, time)
        x, covariance = prior.of(sensor)
        mean = in_raw_units(sensor, units[sensor], x=x, covariance=covariance, prior=prior)
        # a calibration with names of parameters has a measured bias
        b = calibration.b if calibration.names else mean.b
        calibrations[sensor] = replace(calibration, T=mean.T, K=mean.K, b=b, prior=mean.prior)
    return calibrations


def rest_bias(poses, noise, unit, reason, changed=np.inf):
    """Return the SensorCalibration of a gyroscope that only rested: only its bias is measured.

    The bias is the mean over the poses, weighted by the inverse covariance of their noise. If the
    bias varies more between n power cycles than the noise explains, the result is the mean over the
    power cycles, with the variance ``s²/n``, where s² is the variance between them.

    The bias is nominal if there is no rest, if the noise of an axis is not known, or if the biases
    before and after the time `changed` differ by more than `SAME` standard deviations.

    Parameters
    ----------
    poses, noise, unit : Poses, NoiseModel, RawUnit
        The rests, the noise of the device, and the raw unit of the gyroscope.
    reason : str
        Why the other parameters are not calibrated.
    changed : float, optional
        Time at which the gyroscope changed, s; by default never.
    """
    silent = poses.unknown_noise(noise, ANGULAR_RATE)
    if silent or not len(poses):
        reasons = dict.fromkeys(filter(None, (reason, silent)))
        return SensorCalibration.nominal(unit, "; ".join(reasons))
    nominal, covariance = SensorCalibration.nominal(unit, reason), poses.mean_covariance(noise)[3:]
    weights = np.linalg.solve(covariance, np.ones((3, len(poses), 1)))[..., 0]

    def means(group):
        """Return the share of each pose in the mean of its group, (g, 3, n), and the means, (g, 3).

        `group`, (n,), has a number for each of n poses; equal numbers are one of g groups.
        """
        shares = weights * (group == np.unique(group)[:, None])[:, None]
        shares /= shares.sum(axis=2, keepdims=True)
        return shares, np.einsum("gan,na->ga", shares, poses.w)

    # difference between the biases after and before the change, and the variance of the difference;
    # both are zero without a change
    shares, biases = means(poses.start_s > changed)
    contrast = shares[-1] - shares[0]
    variance = np.einsum("an,anm,am->a", contrast, covariance, contrast)
    if np.any((biases[-1] - biases[0]) ** 2 > SAME**2 * variance):
        return nominal
    _, (bias,) = means(np.zeros(len(poses)))
    # variance of the mean by the noise, and the mean of each power cycle
    variance, (_, biases) = 1 / weights.sum(axis=1), means(poses.power_cycle)
    if len(biases) > 1:
        between = biases.var(axis=0, ddof=1) / len(biases)
        bias = np.where(between > variance, biases.mean(axis=0), bias)
        variance = np.maximum(between, variance)
    covariance = np.diag(variance) / unit.scale**2
    measured = {"b": unit.from_si(bias), "names": ("b0", "b1", "b2"), "covariance": covariance}
    return replace(nominal, **measured, method="static")
