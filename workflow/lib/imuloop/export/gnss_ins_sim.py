"""The sensor model of gnss-ins-sim: the dictionary that its class ``IMU`` takes."""

import numpy as np

from imuloop.core.samples import SENSORS
from imuloop.core.units import DEGREE, HOUR
from imuloop.export.exported import MODEL, ExportFormat, comment, numbers
from imuloop.export.per_axis import scale_and_offset

# floor of the Allan deviation of flicker, over B
FLOOR = np.sqrt(2 * np.log(2) / np.pi)
# largest Allan deviation of a Gauss-Markov process, at 1.89 of its time constant, over its
# standard deviation: sqrt(2 [1 - (3 - 4 exp(-u) + exp(-2u))/(2u)]/u), u = 1.89
PEAK = 0.6174
# s, the simulator's own choice for a flicker, which has no time constant
TIME_CONSTANT = 100.0
SQRT_HOUR = np.sqrt(HOUR)
# for each sensor: prefix of its keys, key of the white noise, unit of the bias and its name
KEYS = {
    "gyroscope": ("gyro", "arw", DEGREE / HOUR, "deg/h", DEGREE / SQRT_HOUR, "deg/sqrt(h)"),
    "accelerometer": ("accel", "vrw", 1.0, "m/s^2", 1.0 / SQRT_HOUR, "m/s/sqrt(h)"),
}


def text(device):
    """Return the Python file with the dictionary ``imu_err``.

    gnss-ins-sim: ``z = f + b + drift + white noise``; the standard deviation of the white noise is
    ``vrw sqrt(rate)``; the drift is a Gauss-Markov process of standard deviation `b_stability` and
    time constant `b_corr`. Ours: the strongest Gauss-Markov process of an axis; without one, one
    whose Allan deviation is at its peak as high as the floor of B.

    References
    ----------
    gnss-ins-sim, sim/imu_model.py (IMU.__init__: keys and units), pathgen/pathgen.py (acc_gen,
    gyro_gen, bias_drift).
    """
    device.need_calibration()
    # the first line of a Python file may name its encoding: no label there
    body = comment(
        "-*- coding: utf-8 -*-",
        f"{device.label} ({device.device}): a model of the sensor as it is, for gnss-ins-sim.",
        "Use: imu_model.IMU(accuracy=imu_err, axis=6, gps=False)",
        f"It is no correction of {MODEL}: truth in, logged value out, axis by axis.",
        "White noise is continuous, N of IEEE Std 952; the simulator makes it discrete. It is that",
        "of samples as logged, which the simulator makes.",
        "The drift: an axis' Gauss-Markov process; where none was seen, one whose Allan deviation",
        "is at its peak as high as the floor of flicker B, with the simulator's time constant.",
        "Not carried: scale factor K, quantisation Q, random walk K, ramp R, sinusoids.",
    )
    for name in SENSORS:
        body += comment(*device.left_out(name))
    body += "import numpy as np\n\nimu_err = {\n"
    for name, (prefix, white, bias_unit, bias_name, white_unit, white_name) in KEYS.items():
        offset = scale_and_offset(device.sensor(name))[1] / bias_unit
        densities = [device.density(axis, "N") for axis in SENSORS[name]]
        drifts = [drift(device, axis) for axis in SENSORS[name]]
        body += entry(f"{prefix}_b", offset, f"{bias_name}, bias b: added to the truth")
        value = [d.value / white_unit for d in densities]
        limits = [d.words for d in densities if d.limit]
        body += entry(f"{prefix}_{white}", value, f"{white_name}, white noise N", *limits)
        value = [sigma / bias_unit for sigma, _, _ in drifts]
        sources = (words for _, _, words in drifts)
        body += entry(f"{prefix}_b_stability", value, f"{bias_name}, standard deviation", *sources)
        value = [tau for _, tau, _ in drifts]
        body += entry(f"{prefix}_b_corr", value, "s, its time constant")
    return body + "}\n"


def entry(key, values, *words):
    """Return an entry of the dictionary below a comment."""
    return f'    {comment("; ".join(words))}    "{key}": np.array([{numbers(values)}]),\n'


def drift(device, axis):
    """Return standard deviation (SI) and time constant (s) of an axis' drift, and words on it."""
    found = [
        (p.q.value * np.sqrt(p.tc.value / 2), p.tc.value)
        for p in device.noise.axes[axis].gauss_markov
        if p.q.value is not None and p.tc.value is not None
    ]
    if found:
        return *max(found), f"{axis}: Gauss-Markov process"
    flicker = device.density(axis, "B")
    words = f"{axis}: flicker B{', its 95 % upper limit' * flicker.limit}"
    return flicker.value * FLOOR / PEAK, TIME_CONSTANT, words


# no module of the package's own name: it would hide the package beside it
GNSS_INS_SIM = ExportFormat(
    "gnss_ins_sim_model.py", "gnss-ins-sim, a model of the device for simulation", text
)
