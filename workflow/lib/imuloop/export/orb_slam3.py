"""The inertial part of ORB-SLAM3's settings file."""

from imuloop.export.densities import (
    calibration_left_out,
    density_fields,
    heading,
    noise_left_out,
)
from imuloop.export.exported import comment, number

FILE = "orb_slam3_imu.yaml"
TITLE = "ORB-SLAM3"
KEYS = {
    "IMU.NoiseGyro": ("gyroscope", "N"),
    "IMU.NoiseAcc": ("accelerometer", "N"),
    "IMU.GyroWalk": ("gyroscope", "K"),
    "IMU.AccWalk": ("accelerometer", "K"),
}


def text(device):
    """Return the file, as OpenCV's reader takes it.

    ORB-SLAM3 makes the densities discrete itself: N sqrt(frequency), K / sqrt(frequency). Its
    reader ends the program where a number has no point.
    """
    return (
        "%YAML:1.0\n"
        + heading(device, f"{TITLE}: the lines of its settings on the sensor; all fields SI")
        + density_fields(device, KEYS)
        + f"IMU.Frequency: {number(device.need_rate())}  # Hz, of the logs\n"
        + comment("Not ours: IMU.T_b_c1, where the camera sits; body axes are the accelerometer's")
        + noise_left_out(device)
        + calibration_left_out(device)
    )
