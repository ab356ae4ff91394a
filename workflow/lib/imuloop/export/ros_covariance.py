"""The covariances of ROS' message sensor_msgs/Imu."""

import numpy as np

from imuloop.core.samples import SENSORS
from imuloop.export.densities import calibration_left_out, heading
from imuloop.export.exported import comment, number, numbers

FILE = "ros_imu_covariance.yaml"
TITLE = "ROS sensor_msgs/Imu"
KEYS = {
    "angular_velocity_covariance": ("gyroscope", "(rad/s)^2"),
    "linear_acceleration_covariance": ("accelerometer", "(m/s^2)^2"),
}


def text(device):
    r"""Return the file: the message's fields, row by row; a sample's variance is :math:`N^2 r`."""
    rate, fields = device.need_rate(), ""
    for key, (sensor, unit) in KEYS.items():
        densities = [device.density(axis, "N") for axis in SENSORS[sensor]]
        words = "; ".join([unit, *(density.words for density in densities if density.limit)])
        covariance = np.diag([density.value**2 * rate for density in densities])
        fields += f"{key}: [{numbers(covariance)}]  {comment(words)}"
    return (
        heading(device, f"the covariance fields of {TITLE}; row by row, axes x, y, z; SI")
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
