"""Kalibr's imu.yaml: noise densities of one inertial sensor."""

from imuloop.export.densities import (
    KALIBR,
    calibration_left_out,
    density_fields,
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
        + density_fields(device, KALIBR)
        + 'rostopic: "/imu0"  # not ours: the topic of the bag\n'
        + f"update_rate: {number(device.need_rate())}  # Hz, of the logs\n"
        + noise_left_out(device)
        + calibration_left_out(device)
    )
