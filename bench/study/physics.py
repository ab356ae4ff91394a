"""What is put into the devices, in closed form and apart from the library's designs.

`EFFECTS` by name: functions of `Channels` of a whole log, of the values p of the parameters and of
the constants c of the variant, by their names in the library; they return (n, 3), SI.
"""

import numpy as np
from scipy.interpolate import CubicSpline

from imuloop.effects.temperature import SMOOTHED
from imuloop.simulate.sensor import lagged


def of_axes(p, name):
    """Return the parameters of x, y and z of one name."""
    return np.array([p[name + axis] for axis in "xyz"])


def _warmer(now, c):
    warm, lag = now.temperature, c.get("lag", 0.0)
    if lag:
        # the temperature that a late thermometer follows, smoothed by a share of its lag
        late = lagged(warm, now.t[1] - now.t[0], SMOOTHED * lag)
        warm = late + (warm - late) / SMOOTHED
    return warm - c["reference_temperature"]


def _rate(now, p, c):
    late = lagged(now.temperature, now.t[1] - now.t[0], c["tau"])
    return np.outer((now.temperature - late) / c["tau"], of_axes(p, "r"))


def _hysteresis(now, p, c):
    w, dragged = c["half_width"], np.empty_like(now.temperature)
    at = now.temperature[0]
    for k, theta in enumerate(now.temperature):
        at = min(max(at, theta - w), theta + w)
        dragged[k] = at
    return np.outer((now.temperature - dragged) / w, of_axes(p, "h"))


def _cross_coupling(now, p, c):
    x, y, z = now.output.T
    return np.column_stack(
        [
            p["Kxy"] * x * y + p["Kxz"] * x * z + p["Kxyz"] * y * z,
            p["Kyx"] * y * x + p["Kyz"] * y * z + p["Kxyz"] * z * x,
            p["Kzx"] * z * x + p["Kzy"] * z * y + p["Kxyz"] * x * y,
        ]
    )


def _creep(now, p, c):
    """The part k of the load is reached late."""
    dt = now.t[1] - now.t[0]
    late = np.column_stack([lagged(y, dt, c["tau"]) for y in now.output.T])
    return of_axes(p, "k") * (late - now.output)


def _vibration(now, p, c):
    """Shift each rest by what shakes it, without the noise: rest after rest, no windows."""
    still = ~now.other.any(axis=1)
    edges = np.flatnonzero(np.diff(still, prepend=~still[0]))
    lengths = np.diff(edges, append=len(still))
    means = [np.add.reduceat(now.output**k, edges) / lengths[:, None] for k in (1, 2)]
    variance = np.repeat(means[1] - means[0] ** 2, lengths, axis=0)
    return of_axes(p, "v") * variance * still[:, None]


def _g2(now, p, c):
    x, y, z = now.other.T
    terms = {"xx": x * x - z * z, "yy": y * y - z * z, "xy": x * y, "xz": x * z, "yz": y * z}
    return sum(np.outer(v, [p[f"D{axis}{name}"] for axis in "xyz"]) for name, v in terms.items())


def _change(values, t):
    """Rate of change of values, by a spline through the samples."""
    return CubicSpline(t, values)(t, 1)


def _after(values, t, seconds):
    """Values some seconds later, by a spline through the samples."""
    return CubicSpline(t, values)(t + seconds)


def _lever_arm(now, p, c):
    w, change = now.other, _change(now.other, now.t)
    arms = [np.array([p[f"r{i}{j}"] for j in "xyz"]) for i in "xy"]
    forces = [np.cross(change, r) + np.cross(w, np.cross(w, r)) for r in arms]
    return np.column_stack([forces[0][:, 0], forces[1][:, 1], np.zeros(len(w))])


def _axis_delay(now, p, c):
    shifts = (p["dtx"], p["dty"], 0.0)
    then = [_after(y, now.t, s) for y, s in zip(now.output.T, shifts, strict=True)]
    return now.output - np.column_stack(then)


def _drift(now, p, c):
    return np.outer(now.t, of_axes(p, "d"))


EFFECTS = {
    # every order of the library holds a straight line
    "bias_temperature": lambda now, p, c: np.outer(_warmer(now, c), of_axes(p, "c1")),
    "scale_temperature": lambda now, p, c: _warmer(now, c)[:, None] * of_axes(p, "sT") * now.output,
    "bias_temperature_rate": _rate,
    "thermal_hysteresis": _hysteresis,
    "warm_up": lambda now, p, c: np.outer(np.exp(-now.t / c["tau"]), of_axes(p, "A")),
    "bias_drift": _drift,
    # the bias is that after the step
    "steps": lambda now, p, c: -np.outer(now.t < c["times"][0], of_axes(p, "h1")),
    # at rest the drift has its own name
    "ramp": _drift,
    "quadratic": lambda now, p, c: of_axes(p, "K2") * now.output * now.output,
    "cubic": lambda now, p, c: of_axes(p, "K3") * now.output * now.output * now.output,
    # scale factor larger by K1' for positive output: half of it on either side
    "asymmetry": lambda now, p, c: of_axes(p, "Ka") / 2 * np.abs(now.output),
    "cross_coupling": _cross_coupling,
    "reorientation": _creep,
    "vibration_rectification": _vibration,
    "g_sensitivity": lambda now, p, c: (
        now.other @ np.array([[p[f"G{i}{j}"] for j in range(3)] for i in range(3)]).T
    ),
    "g2_sensitivity": _g2,
    "scale_nonlinearity": lambda now, p, c: (
        (of_axes(p, "s2") + of_axes(p, "s3") * now.output) * now.output**2
    ),
    "lever_arm": _lever_arm,
    "time_offset": lambda now, p, c: now.output - _after(now.output, now.t, -p["dt"]),
    "rate_sensitivity": lambda now, p, c: (
        now.other @ np.array([[p[f"M{i}{j}"] for j in range(3)] for i in range(3)]).T
    ),
    "gyro_axis_delay": _axis_delay,
    "anisoinertia": lambda now, p, c: (
        of_axes(p, "a") * now.output[:, [1, 2, 0]] * now.output[:, [2, 0, 1]]
    ),
    "scale_asymmetry": lambda now, p, c: of_axes(p, "sa") * np.abs(now.output),
    # a turn about the vertical, as at a pole, where no horizontal part is left
    "earth_rate": lambda now, p, c: (
        p["w_up"] * now.other / np.linalg.norm(now.other, axis=1, keepdims=True)
    ),
}


# no effect of the library: sensor, axis and what its coefficient multiplies, by formula
PRODUCTS = {
    "f_y² f_z": ("accelerometer", "x", lambda now: now.output[:, 1] ** 2 * now.output[:, 2]),
    "f_x f_y f_z": ("accelerometer", "x", lambda now: now.output.prod(axis=1)),
    "θ f_x": ("accelerometer", "y", lambda now: (now.temperature - 29.0) * now.output[:, 0]),
    "w_x f_y": ("gyroscope", "z", lambda now: now.output[:, 0] * now.other[:, 1]),
    "w_x w_z f_y": (
        "gyroscope",
        "x",
        lambda now: now.output[:, 0] * now.output[:, 2] * now.other[:, 1],
    ),
}


def product(formula, size):
    """Return a function of `Channels`: one of `PRODUCTS` with its coefficient, SI."""
    _, axis, values = PRODUCTS[formula]
    return lambda now: np.outer(size * values(now), np.eye(3)["xyz".index(axis)])
