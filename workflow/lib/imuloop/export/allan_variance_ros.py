"""The imu.yaml that allan_variance_ros writes, with our coefficients in it."""

from imuloop.core.samples import SENSORS
from imuloop.export.densities import (
    KALIBR,
    NAMES,
    UNITS,
    calibration_left_out,
    density_fields,
    heading,
    noise_left_out,
)
from imuloop.export.exported import comment, number

FILE = "allan_variance_ros_imu.yaml"
TITLE = "allan_variance_ros"


def text(device):
    """Return the file, keys and order as that tool's analysis writes them.

    It gives the worst axis as well. Its own random walk is a line of slope 1/2 laid through the
    whole curve, which finds one in white noise too; here it is an upper limit where none was seen.
    """
    each = [
        f"{axis}: {NAMES[term]}, {number(density.value)} {unit[term]}"
        + (" (95 % upper limit)" if density.limit else "")
        for sensor, unit in UNITS.items()
        for axis in SENSORS[sensor]
        for term in NAMES
        for density in [device.density(axis, term)]
    ]
    body = heading(device, TITLE, "in the form of its imu.yaml; all fields SI")
    for sensor in SENSORS:
        keys = {key: found for key, found in KALIBR.items() if found[0] == sensor}
        body += comment(sensor.capitalize()) + density_fields(device, keys) + "\n"
    return (
        body
        + "rostopic: '/imu0'  # not ours: the topic of the bag\n"
        + f"update_rate: {number(device.need_rate())}  # Hz, of the logs\n"
        + comment("Each axis, as estimated:", *each)
        + noise_left_out(device)
        + calibration_left_out(device)
    )
