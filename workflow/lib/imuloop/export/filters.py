"""Files for filters, which take a noise density and a bias random walk: text of YAML."""

from math import sqrt

import numpy as np
import yaml

from imuloop.core.samples import SENSORS
from imuloop.effects.turn_on_bias import TurnOnBias
from imuloop.export.exported import UNITS, ExportFormat, comment, number, numbers
from imuloop.export.per_axis import scale_and_offset
from imuloop.noise.filters import RANGE

NAMES = {"N": "N, white noise", "K": "K, random walk of the bias"}
# keys of Kalibr's imu.yaml, which others have taken over, with sensor and coefficient
KALIBR_KEYS = {
    f"{sensor}_{name}": (sensor, term)
    for sensor in SENSORS
    for name, term in (("noise_density", "N"), ("random_walk", "K"))
}
ORB_KEYS = {
    "IMU.NoiseGyro": ("gyroscope", "N"),
    "IMU.NoiseAcc": ("accelerometer", "N"),
    "IMU.GyroWalk": ("gyroscope", "K"),
    "IMU.AccWalk": ("accelerometer", "K"),
}
VINS_KEYS = {
    "acc_n": ("accelerometer", "N", "m/s^2"),
    "gyr_n": ("gyroscope", "N", "rad/s"),
    "acc_w": ("accelerometer", "K", "m/s^3"),
    "gyr_w": ("gyroscope", "K", "rad/s^2"),
}
ROS_KEYS = {
    "angular_velocity_covariance": ("gyroscope", "(rad/s)^2"),
    "linear_acceleration_covariance": ("accelerometer", "(m/s^2)^2"),
}
# the effect that Kalibr has a place for
ARMS = "lever_arm"
# the first line of what OpenCV's reader takes
OPENCV = "%YAML:1.0\n"


def heading(device, tool, *lines):
    """Return the comments that a file begins with."""
    return comment(
        f"{device.label} ({device.device}) for {tool}; from imuloop's calibration.json, noise.json",
        *lines,
    )


def density_fields(device, keys, indent="", logged=False):
    """Return a line per key with the worst axis' continuous density, what it is in a comment.

    Of keys the sensor and coefficient, ``N`` or ``K``; `logged` as of `Exported.worst`.
    """
    lines = ""
    for key, (sensor, term) in keys.items():
        density = device.worst(sensor, term, logged)
        words = f"{NAMES[term]}, {UNITS[sensor][term]}, continuous; worst axis: {density.words}"
        lines += f"{indent}{key}: {number(density.value)}  {comment(words)}"
    return lines


def noise_left_out(device):
    """Return comments on what N and K of the worst axis stand for, and on a filter's first bias."""
    turn_on = []
    for sensor, units in UNITS.items():
        for fitted in device.effects(sensor, TurnOnBias.name):
            std, _ = fitted.effect.run_to_run(fitted.values)
            sizes = ", ".join(f"{each:.3g}" for each in std)
            turn_on.append(
                f"{sensor}: turn-on bias, run to run {sizes} {units['B']} (1 sigma of x, y, z; "
                f"{fitted.effect.runs} runs): start a filter's bias with this standard deviation"
            )
    return comment(
        f"From {RANGE}, N^2/tau + K^2 tau/3 is nowhere below the Allan variance of any axis,",
        "lines left out; N and K are raised for flicker, Gauss-Markov processes, Q and R.",
        "Not carried: lines, the other axes' own noise, the intervals of all, dependence on",
        "temperature; see noise.json.",
        *turn_on,
    )


def calibration_left_out(device, carried=()):
    """Return comments on the calibration where a format takes calibrated samples."""
    about = ["No calibration: the noise is that of samples as logged."]
    if device.calibration.measured:
        about = [
            "The noise is that of calibrated samples: bias, scale factor, misalignment and effects",
            "are not carried. First: python -m imuloop apply calibration.json LOG -o OUT",
        ]
    return comment(
        *about,
        *(line for sensor in SENSORS for line in device.left_out(sensor, carried, aligned=True)),
    )


def size_effect(device):
    """Return the arms as Kalibr's result has them; empty without any.

    With f and w on our axes where the x axis sits, and I_i to pick component i::

        f_logged = M (f + Σ_i I_i (dw/dt × ri_i + w × (w × ri_i))) + b

    M is (T K)^-1; ours differs by misalignment times arm. Kalibr: IccSensors.py,
    IccScaledMisalignedSizeEffectImu; Rehder et al., ICRA 2016.
    """
    found, force = device.effects("accelerometer", ARMS), device.sensor("accelerometer")
    if not found:
        return ""
    rx, ry = found[0].vector.reshape(2, 3)
    M = np.linalg.inv(force.T * scale_and_offset(force)[0])
    fields = {"M": M, "rx_i": np.zeros(3), "ry_i": ry - rx, "rz_i": -rx}
    fields = {"accelerometers": {key: value.tolist() for key, value in fields.items()}}
    words = (
        "As in Kalibr's result, which it does not read: for samples in SI as logged, arms in m from"
    )
    return (
        comment(words, "where the x axis sits. Calibrated ones have M 1 and arms 0.")
        + "model: scale-misalignment-size-effect\n"
        + yaml.safe_dump(fields, default_flow_style=None, sort_keys=False)
    )


def kalibr(device):
    """Return Kalibr's imu.yaml.

    Its reader takes the densities as continuous and divides by sqrt(1/update_rate) itself; it
    refuses what is not positive.
    """
    return (
        heading(device, "Kalibr", "(kalibr_calibrate_imu_camera --imu); all fields SI")
        + density_fields(device, KALIBR_KEYS)
        + 'rostopic: "/imu0"  # not ours: the topic of the bag\n'
        + f"update_rate: {number(device.need_rate())}  # Hz, of the logs\n"
        + noise_left_out(device)
        + calibration_left_out(device, (ARMS,))
        + comment(*device.reference_lines())
        + size_effect(device)
    )


def allan_variance_ros(device):
    """Return the imu.yaml that allan_variance_ros writes, keys and order as its analysis has them.

    It gives the worst axis as well. Its own random walk is a line of slope 1/2 laid through the
    whole curve, which finds one in white noise too; here it is an upper limit where none was seen.
    """
    each = [
        f"{density.axis}: {NAMES[term]}, {number(density.value)} {unit[term]}"
        + (" (95 % upper limit)" if density.limit else "")
        for sensor, unit in UNITS.items()
        for of_axis in zip(*(device.calibrated(sensor, term) for term in NAMES), strict=True)
        for term, density in zip(NAMES, of_axis, strict=True)
    ]
    body = heading(device, "allan_variance_ros", "in the form of its imu.yaml; all fields SI")
    for sensor in SENSORS:
        keys = {key: found for key, found in KALIBR_KEYS.items() if found[0] == sensor}
        body += comment(sensor.capitalize()) + density_fields(device, keys) + "\n"
    return (
        body
        + "rostopic: '/imu0'  # not ours: the topic of the bag\n"
        + f"update_rate: {number(device.need_rate())}  # Hz, of the logs\n"
        + comment("Each axis, as estimated:", *each)
        + noise_left_out(device)
        + calibration_left_out(device)
    )


def orb_slam3(device):
    """Return the inertial part of ORB-SLAM3's settings, as OpenCV's reader takes it.

    ORB-SLAM3 makes the densities discrete itself: N sqrt(frequency), K / sqrt(frequency). Its
    reader ends the program where a number has no point.
    """
    return (
        OPENCV
        + heading(device, "ORB-SLAM3: the lines of its settings on the sensor; all fields SI")
        + density_fields(device, ORB_KEYS)
        + f"IMU.Frequency: {number(device.need_rate())}  # Hz, of the logs\n"
        + comment("Not ours: IMU.T_b_c1, where the camera sits; body axes are the accelerometer's")
        + noise_left_out(device)
        + calibration_left_out(device)
    )


def vins_fusion(device):
    r"""Return the inertial part of VINS-Fusion's config, as OpenCV's reader takes it: discrete.

    The propagation over a step dt adds (dt^2/4) n^2 for each of the two samples that it averages to
    the variance of velocity or angle, and dt^2 w^2 to that of the bias, and scales neither by the
    rate. So n is the standard deviation of a sample, :math:`N \sqrt{r}`, and w that of the bias'
    rate of change held over a step, :math:`K \sqrt{r}`: :math:`dt^2 K^2 r = K^2 dt`.
    """
    rate, lines = device.need_rate(), ""
    for key, (sensor, term, unit) in VINS_KEYS.items():
        density = device.worst(sensor, term).times(sqrt(rate))
        words = f"{NAMES[term]}: {term} sqrt(rate), {unit}, discrete; worst axis: {density.words}"
        lines += f"{key}: {number(density.value)}  {comment(words)}"
    gravity = number(device.calibration.gravity)
    return (
        OPENCV
        + heading(device, "VINS-Fusion: the lines of its config on the sensor; all fields SI")
        + comment(
            f"Discrete, for samples at {number(rate)} Hz: at another rate r multiply the four by",
            f"sqrt(r/{number(rate)}). The propagation scales nothing by the rate, so densities",
            "(as for Kalibr) do not belong here.",
        )
        + lines
        + f"g_norm: {gravity}  # m/s^2, that the accelerometer was calibrated to\n"
        + comment(
            "Every sample enters two steps of the propagation, each time as if it were another,",
            "with half its weight: it expects half of the white noise's variance. Its authors'",
            "configs give larger values than the sensor has; acc_n, gyr_n times sqrt(2) is exact.",
        )
        + noise_left_out(device)
        + calibration_left_out(device)
    )


def ros(device):
    r"""Return the covariances of ROS' message, row by row; a sample's is :math:`N^2 r`."""
    rate, fields = device.need_rate(), ""
    for key, (sensor, unit) in ROS_KEYS.items():
        densities = device.calibrated(sensor, "N")
        words = "; ".join([unit, *(density.words for density in densities if density.limit)])
        covariance = np.diag([density.value**2 * rate for density in densities])
        fields += f"{key}: [{numbers(covariance)}]  {comment(words)}"
    about = "the covariance fields of ROS sensor_msgs/Imu; row by row, axes x, y, z; SI"
    return (
        heading(device, about)
        + comment(
            f"Discrete: N^2 rate, the variance of one sample at {number(rate)} Hz where the sensor",
            "passes the whole band; at another rate r multiply by r/rate.",
        )
        + "orientation_covariance: [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]"
        + "  # -1 first: the message has no orientation\n"
        + fields
        + comment(
            "Not carried: noise that is correlated in time (random walk K, flicker B, quantisation",
            "Q, Gauss-Markov processes, lines), bias and its uncertainty; temperature.",
        )
        + calibration_left_out(device)
    )


KALIBR = ExportFormat("kalibr_imu.yaml", "Kalibr", kalibr)
VINS_FUSION = ExportFormat("vins_fusion_imu.yaml", "VINS-Fusion", vins_fusion)
ORB_SLAM3 = ExportFormat("orb_slam3_imu.yaml", "ORB-SLAM3", orb_slam3)
ALLAN_VARIANCE_ROS = ExportFormat(
    "allan_variance_ros_imu.yaml", "allan_variance_ros", allan_variance_ros
)
ROS = ExportFormat("ros_imu_covariance.yaml", "ROS sensor_msgs/Imu", ros)
