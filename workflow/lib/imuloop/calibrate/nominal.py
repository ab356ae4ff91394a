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
    """Return the calibrations of sensors that were not fitted, a dict of SensorCalibration by name.

    Their misalignment T, scale factors K and bias b are the means of the prior. The bias of the
    gyroscope is its mean over the rests instead, if there is a rest and if this bias did not change
    during the recording.

    Parameters
    ----------
    reasons : dict of str to str
        For each sensor without a fit, why it has none.
    recording : Recording
        Poses and rotations; the poses give the bias of the gyroscope.
    noise : NoiseModel
        Noise of the device.
    units : dict of str to RawUnit
        Raw unit of each sensor, its scale and offset by the data sheet.
    prior : Prior
        Prior of the parameters.
    """
    calibrations = {}
    for sensor, reason in reasons.items():
        unit, (x, covariance) = units[sensor], prior.of(sensor)
        mean = in_raw_units(sensor, unit, x=x, covariance=covariance, prior=prior)
        calibration = replace(SensorCalibration.nominal(unit, reason), b=mean.b)
        if sensor == "gyroscope":
            changed, sentence = change_of_sensor(sensor, recording) or (np.inf, "")
            # the reason may name the change already; without a change the sentence is empty
            reason = reason if sentence in reason else f"{reason}; {sentence}"
            measured = rest_bias(recording.poses, noise, unit, reason, changed)
            calibration = measured if measured.names else replace(measured, b=mean.b)
        calibrations[sensor] = replace(calibration, T=mean.T, K=mean.K, prior=mean.prior)
    return calibrations


def rest_bias(poses, noise, unit, reason, changed=np.inf):
    """Return the SensorCalibration of a gyroscope of which only the bias is measured, at rest.

    The bias is the mean over the poses, weighted by the inverse covariance of their noise. This
    mean has a variance by the noise. The biases of c power cycles scatter with the sample variance
    s². If ``s²/c`` is larger than the variance by the noise, the bias is the mean over the power
    cycles instead, and its variance is ``s²/c``.

    Exception: the bias is not measured, and the result has the values of the data sheet, if there
    are no rests, if the noise of an axis is not known, or if the biases before and after the time
    `changed` differ by more than `SAME` standard deviations.

    Parameters
    ----------
    poses, noise, unit : Poses, NoiseModel, RawUnit
        The n rests, the noise of the device, and the raw unit of the gyroscope.
    reason : str
        Why misalignment and scale factors are not calibrated.
    changed : float, optional
        Time at which the gyroscope changed, s; by default never.
    """
    silent = poses.unknown_noise(noise, ANGULAR_RATE)
    if silent or not len(poses):
        reasons = dict.fromkeys(filter(None, (reason, silent)))
        return SensorCalibration.nominal(unit, "; ".join(reasons))
    nominal, covariance = SensorCalibration.nominal(unit, reason), poses.mean_covariance(noise)[3:]
    weights = np.linalg.solve(covariance, np.ones((3, len(poses), 1)))[..., 0]

    def mean_over(rows):
        """Return the mean rate over some poses, (3,), and the weights of all n poses, (3, n).

        The mask `rows`, (n,), chooses the poses; the weights of all others are zero. Each axis has
        its own weights.
        """
        shares = weights * rows
        shares /= shares.sum(axis=1, keepdims=True)
        return np.sum(shares * poses.w.T, axis=1), shares

    before = poses.start_s <= changed
    if before.any() and not before.all():
        (old, old_shares), (new, new_shares) = mean_over(before), mean_over(~before)
        contrast = new_shares - old_shares
        variance = np.einsum("an,anm,am->a", contrast, covariance, contrast)
        if np.any((new - old) ** 2 > SAME**2 * variance):
            return nominal
    # the mean over all poses and its variance by the noise, and the mean of each power cycle
    (bias, _), variance = mean_over(np.ones(len(poses))), 1 / weights.sum(axis=1)
    cycles = np.unique(poses.power_cycle)
    biases = np.array([mean_over(poses.power_cycle == cycle)[0] for cycle in cycles])
    if len(cycles) > 1:
        between = biases.var(axis=0, ddof=1) / len(cycles)
        bias = np.where(between > variance, biases.mean(axis=0), bias)
        variance = np.maximum(between, variance)
    names, b, covariance = ("b0", "b1", "b2"), unit.from_si(bias), np.diag(variance / unit.scale**2)
    return replace(nominal, b=b, names=names, covariance=covariance, method="static")
