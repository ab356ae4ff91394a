"""Parameters of PX4: ``CAL_ACC0_*``, ``CAL_GYRO0_*``, ``TC_A0_*``, ``TC_G0_*``."""

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
    scale_and_offset,
    scale_left_out,
)

FILE = "px4.params"
TITLE = "PX4 parameters, text of QGroundControl"

# types of MAVLink
REAL32, INT32 = 9, 6
# names of each sensor in the calibration and in the temperature calibration
NAMES = {"accelerometer": ("ACC", "A"), "gyroscope": ("GYRO", "G")}


def parameter(name, value, kind=REAL32):
    """Return a line: vehicle, component, name, value as the same float32, type; tabs between."""
    shown = f"{np.float32(value):.9g}" if kind == REAL32 else value
    return f"1\t1\t{name}\t{shown}\t{kind}\n"


def triple(form, keys, values):
    """Return three lines, `form` with the key of each axis."""
    return "".join(parameter(form.format(*each), v) for *each, v in zip(keys, values, strict=True))


def text(device):
    """Return the parameter file.

    ``x = (z - thermal - OFF) SCALE``, ``thermal = Σ_k Xk (clip(θ, TMIN, TMAX) - TREF)^k`` with z
    the SI value as logged; the gyroscope has no SCALE. That is K (raw - b) - e with
    SCALE = K/unit, OFF = b in SI, Xk = c_k/SCALE.

    References
    ----------
    PX4, src/lib/sensor_calibration (Accelerometer.hpp, Gyroscope.hpp: Correct) and
    src/modules/temperature_compensation (calc_thermal_offsets_3D). QGroundControl,
    ParameterManager: a line that begins with # is skipped.
    """
    device.need_calibration()
    body = comment(
        f"{device.label} ({device.device}): calibration for PX4, first accelerometer and gyroscope",
        f"Ours: {MODEL}, SI. PX4: x = (z - thermal - OFF) SCALE, z as a driver publishes it",
        "(topics sensor_accel, sensor_gyro), m/s^2 and rad/s, forward, right, down.",
        "The axes are those of the log: valid where it was logged on these axes, uncorrected.",
        "Not ours: CAL_ACC0_ID, CAL_GYRO0_ID, CAL_*_PRIO, CAL_*_ROT; slot 0 must be this sensor's.",
        "Values are float32, as PX4 keeps them. PX4 takes no noise from its parameters of sensors.",
        "Vehicle 1, component 1: QGroundControl loads the file only into a vehicle of that number.",
    )
    for name in SENSORS:
        body += "#\n" + sensor_text(device, name)
    return body


def sensor_text(device, name):
    """Return the lines of one sensor."""
    sensor, (calibration, thermal) = device.sensor(name), NAMES[name]
    unit = UNITS[name]["B"]
    scale, offset = scale_and_offset(sensor)
    span = common_temperatures(device, name)
    lines = comment(*left_out(device, name, (BIAS,) if span else ()))
    if sensor.method == "nominal":
        lines += comment(
            f"The {name} has no calibration: {sensor.not_testable}",
            "Its OFF and SCALE stay the vehicle's; calibrate it there after loading what follows.",
        )
    else:
        lines += comment(f"OFF: bias b of the {name} in {unit}, subtracted before the scale")
        lines += triple(f"CAL_{calibration}0_{{}}OFF", "XYZ", offset)
        if name == "accelerometer":
            lines += comment("SCALE: K over its nominal value, multiplies")
            lines += triple("CAL_ACC0_{}SCALE", "XYZ", scale)
        else:
            lines += comment(*scale_left_out(scale))
    if span is None:
        return lines
    reference, tc = bias_reference(sensor), f"TC_{thermal}0_"
    lines += comment(
        f"Effect {BIAS}: Xk in {unit} per K^k before the scale, so c_k K_nominal/K; subtracted.",
        "TMIN, TMAX: where the effect was seen, degC; outside PX4 holds the value at the end.",
        "The thermometer of the log must be the one of this sensor.",
        f"To be set by hand, the number of this sensor as in CAL_{calibration}0_ID: {tc}ID",
    )
    lines += parameter(f"TC_{thermal}_ENABLE", 1, INT32)
    for k, c in enumerate(bias_polynomial(sensor, reference)):
        lines += triple(f"{tc}X{k}_{{}}", "012", c / scale)
    for end, value in zip(("TREF", "TMIN", "TMAX"), (reference, *span), strict=True):
        lines += parameter(tc + end, value)
    return lines
