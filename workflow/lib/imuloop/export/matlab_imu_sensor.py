"""A script and a file of parameters that make MATLAB's ``imuSensor`` measure as the device does."""

import json
from functools import partial

import numpy as np

from imuloop.core.samples import SENSORS
from imuloop.export.exported import MODEL, UNITS, ExportFormat, comment, number, numbers
from imuloop.export.per_axis import (
    BIAS,
    bias_polynomial,
    bias_reference,
    range_lines,
    scale_and_offset,
)

# degC, about which imuSensor's temperature bias counts
STANDARD = 25.0
# of the filter that makes flicker: it holds for periods up to as many samples
POLES = 1000
# effects: of the first the slope, of the other a matrix to apply by hand
CARRIED = (BIAS, "g_sensitivity")
# name of the variable, and sign: imuSensor's accelerometer reads gravity less acceleration
VARIABLES = {"accelerometer": ("accel", -1.0), "gyroscope": ("gyro", 1.0)}
DENSITIES = {"NoiseDensity": "N", "RandomWalk": "K", "BiasInstability": "B"}
HELD = "imuSensor holds it to no range"
remark = partial(comment, mark="%")


def text(device):
    """Return the script.

    imuSensor: ``reading = M u + ConstantBias + (θ - 25) TemperatureBias + noise`` with
    M = AxesMisalignment/100, u the true angular rate, or gravity less acceleration: -f. From ours,
    x = T (K (raw - b) - e), the logged SI value is ``z = (unit/K) (T⁻¹ x + e) + b`` with b in SI.

    White noise has the standard deviation ``NoiseDensity sqrt(rate)``, a random walk steps by
    ``RandomWalk/sqrt(rate)`` where NoiseType is single-sided; BiasInstability drives Kasdin's
    filter for 1/f: our N, K and B.

    References
    ----------
    MathWorks, imuSensor, accelparams, gyroparams, fractalcoef: reference pages, "Algorithms".
    Kasdin, Proc. IEEE 83 (1995) 802, equation 116.
    """
    device.need_calibration()
    rate = device.need_rate()
    body = remark(
        f"{device.label} ({device.device}): a model of the sensor, for imuSensor, R2023b on.",
        f"It is no correction. Ours, {MODEL}, SI, is turned round: truth in, logged value out.",
        "NoiseDensity, RandomWalk, BiasInstability: N, K, B of IEEE Std 952, continuous; imuSensor",
        "makes them discrete at SampleRate. BiasInstability is B, not the floor 0.664 B.",
        "All are of samples as logged: imuSensor adds its noise to the reading.",
        "imuSensor's accelerometer reads gravity less acceleration: the log is its negative.",
        "Not carried of the noise: quantisation Q, ramp R, Gauss-Markov processes, sinusoids.",
        "Not measured, left as they are: MeasurementRange, Resolution.",
        "TemperatureScaleFactor is left: no negative one is allowed, and it scales the bias too.",
    )
    for name in SENSORS:
        body += "\n" + sensor_text(device, name)
    return body + (
        f"\nimu = imuSensor('accel-gyro', 'SampleRate', {number(rate)}, ...\n"
        "    'Accelerometer', accel, 'Gyroscope', gyro);\n"
        + remark("[a, w] = imu(acceleration, angularVelocity, orientation); logged: -a, w; SI")
    )


def fields(device, name):
    """Return the properties that a sensor of imuSensor gets: name, values, and what they are."""
    sensor, (_, sign) = device.sensor(name), VARIABLES[name]
    unit = UNITS[name]["B"]
    scale, bias = scale_and_offset(sensor)
    reference, warm = bias_reference(device, name), []
    negated = ", negated with the reading" if sign < 0 else ""
    if reference is not None:
        c = bias_polynomial(device, name, reference)
        slope = c[1] / scale
        bias = bias + (c[0] / scale) + slope * (STANDARD - reference)
        words = f"{unit}/K: slope of {BIAS} at {reference:g} degC, times unit/K{negated}"
        warm = [("TemperatureBias", sign * slope, words)]
    words = "per cent: 100 (unit/K) inverse of T, scale factor included"
    found = [
        ("ConstantBias", sign * bias, f"{unit}: b in SI, at {STANDARD:g} degC{negated}"),
        ("AxesMisalignment", 100 * np.linalg.inv(sensor.T) / scale[:, None], words),
    ]
    for key, term in DENSITIES.items():
        densities = [device.density(axis, term) for axis in SENSORS[name]]
        words = [f"{UNITS[name][term]}: {term}", *(d.words for d in densities if d.limit)]
        found.append((key, [d.value for d in densities], "; ".join(words)))
    return found + warm


def sensor_text(device, name):
    """Return the lines of one sensor."""
    sensor, (variable, _) = device.sensor(name), VARIABLES[name]
    scale, _ = scale_and_offset(sensor)
    lines = remark(*device.left_out(name, CARRIED, aligned=True))
    lines += f"{variable} = {variable}params;\n"
    for key, values, what in fields(device, name):
        rows = "; ".join(numbers(row, " ") for row in np.atleast_2d(values))
        lines += f"{variable}.{key} = [{rows}]; {remark(what)}"
    lines += f"{variable}.NoiseType = 'single-sided'; "
    lines += remark("of imuSensor: so that N and K are what the samples show")
    lines += f"{variable}.BiasInstabilityCoefficients = fractalcoef({POLES}); "
    lines += remark(f"flicker, for periods up to {POLES} samples")
    reference = bias_reference(device, name)
    if reference is not None:
        unit, c = UNITS[name]["B"], bias_polynomial(device, name, reference)
        lines += remark(*range_lines(device, name, BIAS, HELD))
        if c[2:].any():
            curve = ", ".join(f"{np.abs(c[k]).max():.2g} {unit}/K^{k}" for k in (2, 3))
            lines += remark(f"Not carried of {BIAS}: its curvature, up to {curve}")
    for fitted in device.effects(name, "g_sensitivity"):
        G = fitted.vector.reshape(3, 3) / scale[:, None]
        rows = "; ".join(numbers(row, " ") for row in G)
        lines += f"gSensitivity = [{rows}]; "
        lines += remark(
            "(rad/s)/(m/s^2): g_sensitivity, times unit/K",
            "Not carried by AccelerationBias, which takes the acceleration without gravity and on",
            "navigation axes. Add by hand: w + f*gSensitivity', f the specific force on body axes.",
            *range_lines(device, name, fitted.name, HELD),
        )
    return lines


def parameters(device):
    """Return the file that imuSensor's ``loadparams(imu, FILE, PART)`` reads.

    A part by its name, of ``Accelerometer`` and ``Gyroscope``, each with properties of accelparams
    and gyroparams: numbers only, so that what is text or a struct is set by the script alone.

    References
    ----------
    MathWorks, reference page of loadparams (imuSensor), and its help text.
    """
    device.need_calibration()
    # a name of MATLAB, of at most 63 letters
    part = device.device.replace("-", "_")[:63]
    both = {name: fields(device, name) for name in SENSORS}
    known = {
        name.capitalize(): {key: np.asarray(values).tolist() for key, values, _ in found}
        for name, found in both.items()
    }
    notes = [
        "As matlab_imu_sensor.m, which says what each value is and what is not carried. After",
        f"loadparams(imu, FILE, '{part}'), R2023b on, what is no number, for Accelerometer and",
        "Gyroscope alike: imu.Gyroscope.NoiseType = 'single-sided';",
        f"imu.Gyroscope.BiasInstabilityCoefficients = fractalcoef({POLES});",
        *device.calibration.limits(),
    ]
    return json.dumps({part: known, "Notes": notes}, indent=1, allow_nan=False) + "\n"


MATLAB_PARAMETERS = ExportFormat(
    "matlab_imu_sensor.json", "MATLAB imuSensor, parameters for its loadparams", parameters
)
MATLAB_IMU_SENSOR = ExportFormat(
    "matlab_imu_sensor.m", "MATLAB imuSensor, a model of the device for simulation", text
)
