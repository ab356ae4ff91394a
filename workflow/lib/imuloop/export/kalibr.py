"""Kalibr's imu.yaml: noise densities of one inertial sensor."""

from imuloop.export.densities import (
    calibration_left_out,
    density_field,
    heading,
    noise_left_out,
)
from imuloop.export.exported import number

FILE = "kalibr_imu.yaml"
TITLE = "Kalibr"


def text(device):
    """Return the file.

    Kalibr's reader takes the densities as continuous and divides by sqrt(1/update_rate) itself; it
    refuses what is not positive.
    """
    return (
        heading(device, TITLE, "(kalibr_calibrate_imu_camera --imu); all fields SI")
        + density_field(device, "accelerometer_noise_density", "accelerometer", "N")
        + density_field(device, "accelerometer_random_walk", "accelerometer", "K")
        + density_field(device, "gyroscope_noise_density", "gyroscope", "N")
        + density_field(device, "gyroscope_random_walk", "gyroscope", "K")
        + 'rostopic: "/imu0"  # not ours: the topic of the bag\n'
        + f"update_rate: {number(device.need_rate())}  # Hz, of the logs\n"
        + noise_left_out(device)
        + calibration_left_out(device)
    )
