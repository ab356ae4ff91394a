"""The inertial part of VINS-Fusion's config file."""

from math import sqrt

from imuloop.export.densities import NAMES, calibration_left_out, heading, noise_left_out
from imuloop.export.exported import comment, number

FILE = "vins_fusion_imu.yaml"
TITLE = "VINS-Fusion"
# key, sensor, coefficient, unit
KEYS = (
    ("acc_n", "accelerometer", "N", "m/s^2"),
    ("gyr_n", "gyroscope", "N", "rad/s"),
    ("acc_w", "accelerometer", "K", "m/s^3"),
    ("gyr_w", "gyroscope", "K", "rad/s^2"),
)


def text(device):
    r"""Return the file, as OpenCV's reader takes it: discrete values.

    The propagation over a step dt adds (dt^2/4) n^2 for each of the two samples that it averages to
    the variance of velocity or angle, and dt^2 w^2 to that of the bias, and scales neither by the
    rate. So n is the standard deviation of a sample, :math:`N \sqrt{r}`, and w that of the bias'
    rate of change held over a step, :math:`K \sqrt{r}`: :math:`dt^2 K^2 r = K^2 dt`.
    """
    rate, gravity = device.need_rate(), device.calibration.gravity
    lines = []
    for key, sensor, term, unit in KEYS:
        density = device.worst(sensor, term).times(sqrt(rate))
        words = f"{NAMES[term]}: {term} sqrt(rate), {unit}, discrete; worst axis: {density.words}"
        lines.append(f"{key}: {number(density.value)}  {comment(words)}")
    return (
        "%YAML:1.0\n"
        + heading(device, f"{TITLE}: the lines of its config on the sensor; all fields SI")
        + comment(
            f"Discrete, for samples at {number(rate)} Hz: at another rate r multiply the four by",
            f"sqrt(r/{number(rate)}). The propagation scales nothing by the rate, so densities",
            "(as for Kalibr) do not belong here.",
        )
        + "".join(lines)
        + f"g_norm: {number(gravity)}  # m/s^2, that the accelerometer was calibrated to\n"
        + comment(
            "Every sample enters two steps of the propagation, each time as if it were another,",
            "with half its weight: it expects half of the white noise's variance. Its authors'",
            "configs give larger values than the sensor has; acc_n, gyr_n times sqrt(2) is exact.",
        )
        + noise_left_out(device)
        + calibration_left_out(device)
    )
