"""The inertial part of ORB-SLAM3's settings file."""

from imuloop.export.densities import (
    calibration_left_out,
    density_field,
    heading,
    noise_left_out,
)
from imuloop.export.exported import comment, number

FILE = "orb_slam3_imu.yaml"
TITLE = "ORB-SLAM3"


def text(device):
    """Return the file, as OpenCV's reader takes it.

    ORB-SLAM3 makes the densities discrete itself: N sqrt(frequency), K / sqrt(frequency). Its
    reader ends the program where a number has no point.
    """
    return (
        "%YAML:1.0\n"
        + heading(device, f"{TITLE}: the lines of its settings on the sensor; all fields SI")
        + density_field(device, "IMU.NoiseGyro", "gyroscope", "N")
        + density_field(device, "IMU.NoiseAcc", "accelerometer", "N")
        + density_field(device, "IMU.GyroWalk", "gyroscope", "K")
        + density_field(device, "IMU.AccWalk", "accelerometer", "K")
        + f"IMU.Frequency: {number(device.need_rate())}  # Hz, of the logs\n"
        + comment("Not ours: IMU.T_b_c1, where the camera sits; body axes are the accelerometer's")
        + noise_left_out(device)
        + calibration_left_out(device)
    )
