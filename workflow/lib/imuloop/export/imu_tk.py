"""The text calibrations of imu_tk, one per sensor."""

from functools import partial

import numpy as np

from imuloop.core.errors import Lacking
from imuloop.export.exported import UNITS, ExportFormat, comment, numbers
from imuloop.export.filters import heading


def text(sensor, device):
    """Return a sensor's file: T, K as a diagonal matrix, b; ``x = T K (raw - b)``.

    Comments stand below the numbers: its reader takes the first 21 and stops.
    """
    found, si = device.sensor(sensor), UNITS[sensor]["B"]
    if not found.measured:
        raise Lacking(f"no calibration ({found.not_testable})")
    parts = found.T, np.diag(found.K), found.b[:, None]
    return (
        "".join("".join(f"{numbers(row, ' ')}\n" for row in part) + "\n" for part in parts)
        + heading(device, f"imu_tk, {sensor}; comments are below, where its reader has stopped")
        + comment(
            "x = T K (raw - b), the same model, sign and matrices as in imu_tk:",
            f"rows 1 to 3: T, misalignment, no unit; x on the accelerometer's axes, in {si}",
            f"rows 4 to 6: K, scale factor, {si} per {found.raw_unit.name}",
            f"rows 7 to 9: b, bias, {found.raw_unit.name}, to subtract; raw as in the log",
            f"Calibrated by: {found.method}",
            *device.left_out(sensor, aligned=True),
            "Not carried: covariances, temperature, noise.",
        )
    )


ACCELEROMETER, GYROSCOPE = (
    ExportFormat(file, f"imu_tk, {sensor}", partial(text, sensor))
    for sensor, file in (("accelerometer", "imu_tk_acc.calib"), ("gyroscope", "imu_tk_gyro.calib"))
)
