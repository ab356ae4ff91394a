"""Parameters of PX4 and ArduPilot, which correct axis by axis, with a bias of the temperature."""

import numpy as np

from imuloop.core.samples import SENSORS
from imuloop.export.exported import MODEL, UNITS, ExportFormat, comment
from imuloop.export.per_axis import (
    BIAS,
    bias_polynomial,
    bias_reference,
    common_temperatures,
    range_lines,
    scale_and_offset,
)

# types of MAVLink
REAL32, INT32 = 9, 6
# names of each sensor: in PX4's calibration and its temperature calibration, and in ArduPilot's
NAMES = {"accelerometer": ("ACC", "A", "ACC"), "gyroscope": ("GYRO", "G", "GYR")}
# degC, about which ArduPilot's polynomial counts, and the scale of its coefficients
REFERENCE, SCALE = 35.0, 1e6
# ms, the range of PX4's EKF2_EV_DELAY
MOST_DELAY = 300
HELD = "INS_TCAL1 holds both sensors to what they have in common"
THERMOMETER = "The thermometer of the log must be the one of this sensor."


def px4_line(name, value, kind=REAL32):
    """Return a line: vehicle, component, name, value as the same float32, type; tabs between."""
    shown = f"{np.float32(value):.9g}" if kind == REAL32 else value
    return f"1\t1\t{name}\t{shown}\t{kind}\n"


def ardupilot_line(name, value):
    """Return a line ``NAME,VALUE``; the text reads back as the same float32, which is kept."""
    return f"{name},{np.float32(value):.9g}\n"


def triple(line, form, values, keys="XYZ"):
    """Return three lines, `form` with the key of each axis."""
    return "".join(line(form.format(key), v) for key, v in zip(keys, values, strict=True))


def offsets(device, name, line, forms, offset):
    """Return the lines of a sensor's offsets, SI, and scale factors, named by two `forms`."""
    scale, _ = scale_and_offset(device.sensor(name))
    unit = UNITS[name]["B"]
    lines = comment(f"Offset: bias b of the {name} in {unit}, subtracted before the scale")
    lines += triple(line, forms[0], offset)
    if name == "accelerometer":
        lines += comment("Scale: K over its nominal value, multiplies")
        return lines + triple(line, forms[1], scale)
    error = np.abs(scale - 1).max()
    words = f"Not carried of the gyroscope: scale factor K, up to {error:.2g} from 1"
    return lines + (comment(words) if error else "")


def not_calibrated(name):
    """Return the comment on a sensor of which nothing was determined."""
    return comment(
        f"The {name} has no calibration: its offsets and scale stay the vehicle's; calibrate it",
        "there after loading what follows.",
    )


def px4(device):
    """Return the parameter file of PX4, as QGroundControl reads it.

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
        "Not ours: CAL_*_PRIO, CAL_*_ROT; where no CAL_*_ID follows, slot 0 must be this sensor's.",
        "Values are float32, as PX4 keeps them. PX4 takes no noise from its parameters of sensors.",
        "Vehicle 1, component 1: QGroundControl loads the file only into a vehicle of that number.",
    )
    for name in SENSORS:
        sensor, (calibration, thermal, _) = device.sensor(name), NAMES[name]
        known = device.calibration.log.get("sensor_ids", {}).get(name, {})
        slot = known.get("slot", 0)
        calibration, thermal = f"CAL_{calibration}{slot}_", f"TC_{thermal}{slot}_"
        scale, offset = scale_and_offset(sensor)
        span = common_temperatures(device, name)
        body += "#\n" + comment(*device.left_out(name, (BIAS,) if span else ()))
        if sensor.method == "nominal":
            body += not_calibrated(name)
        else:
            if known:
                body += comment("Slot and device id are those of the log, of the sensor in it")
                body += px4_line(f"{calibration}ID", known["id"], INT32)
            forms = f"{calibration}{{}}OFF", f"{calibration}{{}}SCALE"
            body += offsets(device, name, px4_line, forms, offset)
        if span is None:
            continue
        reference = bias_reference(device, name)
        body += comment(
            f"Effect {BIAS}: Xk in {UNITS[name]['B']} per K^k before the scale, so c_k "
            "K_nominal/K; subtracted.",
            "TMIN, TMAX: where the effect was seen, degC; outside PX4 holds the value at the end.",
            THERMOMETER,
        )
        if known:
            body += px4_line(f"{thermal}ID", known["id"], INT32)
        else:
            words = f"To be set by hand, the number of this sensor as in {calibration}ID"
            body += comment(f"{words}: {thermal}ID")
        body += px4_line(f"TC_{NAMES[name][1]}_ENABLE", 1, INT32)
        for k, c in enumerate(bias_polynomial(device, name, reference)):
            body += triple(px4_line, f"{thermal}X{k}_{{}}", c / scale, "012")
        for end, value in zip(("TREF", "TMIN", "TMAX"), (reference, *span), strict=True):
            body += px4_line(thermal + end, value)
    return body + external_vision(device)


def external_vision(device):
    """Return PX4's parameters of a reference's clock and place, as it takes external vision.

    A pose with the stamp t counts for the IMU's ``t - EKF2_EV_DELAY``, and where the IMU is follows
    from ``p - R (EKF2_EV_POS - EKF2_IMU_POS)``: ours are t_reference = t_imu + shift, and r from
    the marker to the sensor, so that DELAY is the shift and EV_POS is IMU_POS - r.

    References
    ----------
    PX4, src/modules/ekf2: params_external_vision.yaml, EKF/estimator_interface.cpp
    (setExtVisionData), EKF/aid_sources/external_vision/ev_pos_control.cpp.
    """
    body = ""
    shift = 1e3 * device.beside.get(("gyroscope", "time_offset"), {}).get("dt", np.nan)
    if 0 <= shift <= MOST_DELAY:
        words = "The reference's stamps less the IMU's, ms, where PX4 gets the stamps of the log"
        body += comment(words) + px4_line("EKF2_EV_DELAY", shift)
    elif np.isfinite(shift):
        body += comment(
            f"Not carried: the reference's stamps less the IMU's, {shift:.4g} ms; EKF2_EV_DELAY is "
            f"from 0 to {MOST_DELAY} ms"
        )
    if arm := device.beside.get(("accelerometer", "lever_arm")):
        words = "From the IMU to the reference's marker, m; add EKF2_IMU_POS_* where it is not 0"
        values = [-arm[f"r{k}"] for k in "xyz"]
        body += comment(words) + triple(px4_line, "EKF2_EV_POS_{}", values)
    return "#\n" + body if body else ""


def ardupilot(device):
    """Return the parameter file of ArduPilot, as Mission Planner and MAVProxy read it.

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
    for name, (*_, short) in NAMES.items():
        body += "#\n" + comment(*device.left_out(name, (BIAS,) if span else ()))
        body += comment(*(f"{name}: {line}" for line in range_lines(device, name, BIAS, HELD)))
        if device.sensor(name).method == "nominal":
            body += not_calibrated(name)
            continue
        scale, offset = scale_and_offset(device.sensor(name))
        reference = bias_reference(device, name)
        if span and reference is not None:
            at = float(np.clip(reference, *span))
            offset = offset + bias_polynomial(device, name, at)[0] / scale
            body += comment(f"CALTEMP: temperature of the offsets of the {name}, degC")
            body += ardupilot_line(f"INS_{short}1_CALTEMP", at)
        forms = f"INS_{short}OFFS_{{}}", f"INS_{short}SCAL_{{}}"
        body += offsets(device, name, ardupilot_line, forms, offset)
    if span is None:
        return body
    body += comment(
        "",
        f"Effect {BIAS}: k-th coefficient about 35 degC, 1e6 times SI per K^k before the scale;",
        "subtracted. TMIN, TMAX: where it was seen, degC; outside the value at the end.",
        THERMOMETER,
    )
    for name, value in (("ENABLE", 1), ("TMIN", span[0]), ("TMAX", span[1])):
        body += ardupilot_line(f"INS_TCAL1_{name}", value)
    for name, (*_, short) in NAMES.items():
        scale, _ = scale_and_offset(device.sensor(name))
        c = SCALE * bias_polynomial(device, name, REFERENCE) / scale
        for k in (1, 2, 3):
            body += triple(ardupilot_line, f"INS_TCAL1_{short}{k}_{{}}", c[k])
    return body


PX4 = ExportFormat("px4.params", "PX4 parameters, text of QGroundControl", px4)
ARDUPILOT = ExportFormat(
    "ardupilot.param", "ArduPilot parameters, text of Mission Planner and MAVProxy", ardupilot
)
