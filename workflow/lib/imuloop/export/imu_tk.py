"""The text calibrations of imu_tk, one a sensor."""

from types import SimpleNamespace

import numpy as np

from imuloop.core.errors import Lacking
from imuloop.export.densities import heading
from imuloop.export.exported import comment, numbers


def calibration_text(device, sensor):
    """Return a sensor's file: T, K as a diagonal matrix, b; ``x = T K (raw - b)``.

    Comments stand below the numbers: its reader takes the first 21 and stops.

    Raises
    ------
    Lacking
        If nothing of the sensor was measured.
    """
    found = device.sensor(sensor)
    if found.method == "nominal":
        raise Lacking(f"no calibration ({found.not_testable})")
    rows = [*found.T, None, *np.diag(found.K), None, *([each] for each in found.b), None]
    body = "".join("\n" if row is None else numbers(row, " ") + "\n" for row in rows)
    si = "m/s^2" if sensor == "accelerometer" else "rad/s"
    return (
        body
        + heading(device, f"imu_tk, {sensor}; comments are below, where its reader has stopped")
        + comment(
            "x = T K (raw - b), the same model, sign and matrices as in imu_tk:",
            f"rows 1 to 3: T, misalignment, no unit; x on the accelerometer's axes, in {si}",
            f"rows 4 to 6: K, scale factor, {si} per {found.raw_unit.name}",
            f"rows 7 to 9: b, bias, {found.raw_unit.name}, to subtract; raw as in the log",
            f"Calibrated by: {found.method}",
            *([found.not_testable] if found.not_testable else []),
            *(f"Effect not carried: {line}" for line in device.effects(sensor)),
            "Not carried: covariances, temperature, noise.",
        )
    )


def _format(sensor, file):
    return SimpleNamespace(
        FILE=file, TITLE=f"imu_tk, {sensor}", text=lambda device: calibration_text(device, sensor)
    )


ACCELEROMETER = _format("accelerometer", "imu_tk_acc.calib")
GYROSCOPE = _format("gyroscope", "imu_tk_gyro.calib")
