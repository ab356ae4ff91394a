"""Parameters of ArduPilot: ``INS_ACC*``, ``INS_GYR*``, ``INS_TCAL1_*``."""

import numpy as np

from imuloop.core.samples import SENSORS
from imuloop.export.densities import UNITS
from imuloop.export.exported import MODEL, comment
from imuloop.export.per_axis import (
    BIAS,
    bias_polynomial,
    bias_reference,
    common_temperatures,
    left_out,
    range_lines,
    scale_and_offset,
    scale_left_out,
)

FILE = "ardupilot.param"
TITLE = "ArduPilot parameters, text of Mission Planner and MAVProxy"

# degC, about which ArduPilot's polynomial counts
REFERENCE = 35.0
# of the polynomial's coefficients
SCALE = 1e6
HELD = "INS_TCAL1 holds both sensors to what they have in common"
NAMES = {"accelerometer": "ACC", "gyroscope": "GYR"}


def parameter(name, value):
    """Return a line ``NAME,VALUE``; the text reads back as the same float32, which is kept."""
    return f"{name},{np.float32(value):.9g}\n"


def triple(name, values):
    """Return a line per axis."""
    return "".join(
        parameter(f"{name}_{axis}", value) for axis, value in zip("XYZ", values, strict=True)
    )


def text(device):
    """Return the parameter file.

    ``x = (z - P(θ) + P(θc) - OFFS) SCAL``, ``P(θ) = 1e-6 Σ_k Ck (clip(θ, TMIN, TMAX) - 35)^k``,
    k = 1 … 3, with z the SI value as logged and θc the temperature CALTEMP, clipped too, of the
    offsets; the gyroscope has no SCAL. That is K (raw - b) - e with SCAL = K/unit,
    P = (e(θ) - e(35))/SCAL, OFFS = b in SI + e(θc)/SCAL.

    References
    ----------
    ArduPilot, libraries/AP_InertialSensor: AP_InertialSensor_Backend.cpp
    (_rotate_and_correct_accel, _rotate_and_correct_gyro), AP_InertialSensor_tempcal.cpp
    (correct_sensor, polynomial_eval).
    """
    device.need_calibration()
    sensors = {name: device.sensor(name) for name in SENSORS}
    span = common_temperatures(device, *SENSORS)
    body = comment(
        f"{device.label} ({device.device}): calibration for ArduPilot, first IMU",
        f"Ours: {MODEL}, SI. ArduPilot: x = (z - P(temperature) + P(CALTEMP) - OFFS) SCAL,",
        "z as a driver gives it, m/s^2 and rad/s, forward, right, down, before AHRS_ORIENTATION.",
        "The axes are those of the log: valid where it was logged on these axes, uncorrected,",
        "that is with OFFS 0, SCAL 1, INS_TCAL1_ENABLE 0 and AHRS_ORIENTATION 0.",
        "Not ours: INS_ACC_ID, INS_GYR_ID; the first IMU must be this device. Values are float32.",
        "INS_GYR_CAL 1, the default, finds INS_GYROFFS anew at each start; 0 keeps this one.",
    )
    for name, sensor in sensors.items():
        body += "#\n" + comment(*left_out(device, name, (BIAS,) if span else ()))
        body += comment(*(f"{name}: {line}" for line in range_lines(sensor, BIAS, HELD)))
        body += offsets(name, sensor, span)
    if span is None:
        return body
    body += comment(
        "",
        f"Effect {BIAS}: k-th coefficient about 35 degC, 1e6 times SI per K^k before the scale;",
        "subtracted. TMIN, TMAX: where it was seen, degC; outside the value at the end.",
        "The thermometer of the log must be the one of this IMU.",
    )
    body += parameter("INS_TCAL1_ENABLE", 1)
    body += parameter("INS_TCAL1_TMIN", span[0]) + parameter("INS_TCAL1_TMAX", span[1])
    for name, sensor in sensors.items():
        c = SCALE * bias_polynomial(sensor, REFERENCE) / scale_and_offset(sensor)[0]
        for k in (1, 2, 3):
            body += triple(f"INS_TCAL1_{NAMES[name]}{k}", c[k])
    return body


def offsets(name, sensor, span):
    """Return the lines of a sensor's offsets, at CALTEMP where its bias follows the temperature."""
    if sensor.method == "nominal":
        lines = comment(f"The {name} has no calibration: {sensor.not_testable}")
        if span and bias_reference(sensor) is not None:
            lines += comment(
                "Offsets and CALTEMP stay the vehicle's: calibrate it there afterwards."
            )
        return lines
    short, unit = NAMES[name], UNITS[name]["B"]
    scale, offset = scale_and_offset(sensor)
    reference, lines = bias_reference(sensor), ""
    if span and reference is not None:
        at = float(np.clip(reference, *span))
        offset = offset + bias_polynomial(sensor, at)[0] / scale
        lines += comment(f"CALTEMP: temperature of the offsets of the {name}, degC")
        lines += parameter(f"INS_{short}1_CALTEMP", at)
    lines += comment(f"OFFS: bias b of the {name} in {unit}, subtracted before the scale")
    lines += triple(f"INS_{short}OFFS", offset)
    if name == "accelerometer":
        lines += comment("SCAL: K over its nominal value, multiplies")
        return lines + triple("INS_ACCSCAL", scale)
    return lines + comment(*scale_left_out(scale))
