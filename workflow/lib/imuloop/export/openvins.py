"""OpenVINS' kalibr_imu_chain.yaml: noise densities, intrinsics and g-sensitivity."""

import numpy as np

from imuloop.core.samples import SENSORS
from imuloop.export.exported import ExportFormat, comment, number, numbers
from imuloop.export.filters import KALIBR_KEYS, OPENCV, density_fields, heading, noise_left_out
from imuloop.export.per_axis import range_lines, scale_and_offset

# the effect that it takes
G = "g_sensitivity"


def text(device):
    """Return the file, as OpenCV's reader takes it.

    OpenVINS takes samples am, wm in SI, as logged, and its filter's biases ba, bg::

        a = R_ACCtoIMU Da (am - ba)
        w = R_GYROtoIMU Dw (wm - bg - Tg a)

    with Da = Ta^-1, Dw = Tw^-1 and each R the transpose of that in the file. Its model "rpng" keeps
    the upper triangles of Da and Dw. Ours of the accelerometer is upper triangular; the
    gyroscope's M = T K is Q U, a rotation and an upper triangular matrix. From
    ``T (K (raw - b) - G f) = M (raw - b - K^-1 G f)``, Tg = K^-1 G.
    """
    device.need_calibration()
    force, turn = device.sensor("accelerometer"), device.sensor("gyroscope")
    (scale_a, bias_a), (scale_g, bias_g) = scale_and_offset(force), scale_and_offset(turn)
    rotation, upper = np.linalg.qr(turn.T * scale_g)
    signs = np.sign(np.diag(upper))
    rotation, upper = rotation * signs, signs[:, None] * upper
    Tg = np.zeros((3, 3))
    for fitted in device.effects("gyroscope", G):
        Tg = fitted.vector.reshape(3, 3) / scale_g[:, None]
    found = device.beside.get(("gyroscope", "time_offset"))
    shift = found["dt"] if found else 0.0
    words = "s, t_reference = t_imu + time_offset; no camera" if found else "not ours"
    return (
        OPENCV
        + heading(device, "OpenVINS: relative_config_imu of its estimator_config.yaml; all SI")
        + comment(
            "For samples in SI as logged, not calibrated ones, and N and K are of these: OpenVINS",
            "takes the noise through the matrices below. Biases belong to the filter's state and",
            "not into this file; to start it at ours, put into estimator_config.yaml:",
            f"init_dyn_bias_g: [{numbers(bias_g)}] (rad/s)",
            f"init_dyn_bias_a: [{numbers(bias_a)}] (m/s^2)",
            f"gravity_mag: {number(device.calibration.gravity)}",
        )
        + "imu0:\n"
        + matrix("T_i_b", np.eye(4), "identity: body axes are the accelerometer's")
        + density_fields(device, KALIBR_KEYS, "  ", logged=True)
        + '  rostopic: "/imu0"  # not ours: the topic\n'
        + f"  time_offset: {number(shift)}  # {words}\n"
        + f"  update_rate: {number(device.need_rate())}  # Hz, of the logs\n"
        + '  model: "rpng"  # upper triangular Da and Dw, which ours are\n'
        + matrix("Tw", np.linalg.inv(upper), "inverse of Dw; gyroscope's M = T K = R_GYROtoIMU Dw")
        + matrix("R_IMUtoGYRO", rotation.T, "from the accelerometer's axes to the gyroscope's")
        + matrix(
            "Ta", np.linalg.inv(force.T * scale_a), "inverse of Da, the accelerometer's M = T K"
        )
        + matrix("R_IMUtoACC", np.eye(3), "identity: body axes are the accelerometer's")
        + matrix("Tg", Tg, "K^-1 G, rad/s per m/s^2; zero where none was found")
        + comment(
            *range_lines(device, "gyroscope", G, "OpenVINS holds it to no range"),
            *(line for each in SENSORS for line in device.left_out(each, (G,), aligned=True)),
            *device.reference_lines(),
            "Not carried: covariances of all these, temperature.",
        )
        + noise_left_out(device)
    )


def matrix(key, values, words):
    """Return a matrix as a list of rows."""
    rows = "".join(f"    - [{numbers(row)}]\n" for row in values)
    return f"  {key}:  {comment(words)}{rows}"


OPENVINS = ExportFormat("openvins_kalibr_imu_chain.yaml", "OpenVINS", text)
