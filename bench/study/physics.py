"""What is put into the devices, in closed form and apart from the library's designs.

Each function takes values p of the parameters and constants c of the shape, by their names in the
library, and returns a function of `Channels` of a whole log, (n, 3), SI.
"""

import numpy as np
from scipy.special import eval_legendre

from imuloop.simulate.sensor import lagged


def of_axes(p, name):
    """Return the parameters of x, y and z of one name."""
    return np.array([p[name + axis] for axis in "xyz"])


def bias_temperature(p, c):
    """Follow the temperature on a straight line: every order of the library holds it."""
    return lambda now: np.outer(now.temperature - c["reference_temperature"], of_axes(p, "c1"))


def scale_temperature(p, c):
    def e(now):
        warmer = now.temperature - c["reference_temperature"]
        return warmer[:, None] * of_axes(p, "sT") * now.output

    return e


def bias_temperature_rate(p, c):
    def e(now):
        late = lagged(now.temperature, now.t[1] - now.t[0], c["tau"])
        return np.outer((now.temperature - late) / c["tau"], of_axes(p, "r"))

    return e


def thermal_hysteresis(p, c):
    def e(now):
        w, dragged = c["half_width"], np.empty_like(now.temperature)
        at = now.temperature[0]
        for k, theta in enumerate(now.temperature):
            at = min(max(at, theta - w), theta + w)
            dragged[k] = at
        return np.outer((now.temperature - dragged) / w, of_axes(p, "h"))

    return e


def warm_up(p, c):
    return lambda now: np.outer(np.exp(-now.t / c["tau"]), of_axes(p, "A"))


def bias_drift(p, c):
    return lambda now: np.outer(now.t, of_axes(p, "d"))


def quadratic(p, c):
    return lambda now: of_axes(p, "K2") * now.output * now.output


def cubic(p, c):
    return lambda now: of_axes(p, "K3") * now.output * now.output * now.output


def asymmetry(p, c):
    """Scale factor larger by K1' for positive output: half of it on either side."""
    return lambda now: of_axes(p, "Ka") / 2 * np.where(now.output > 0, now.output, -now.output)


def cross_coupling(p, c):
    def e(now):
        x, y, z = now.output.T
        return np.column_stack(
            [
                p["Kxy"] * x * y + p["Kxz"] * x * z + p["Kxyz"] * y * z,
                p["Kyx"] * y * x + p["Kyz"] * y * z + p["Kxyz"] * z * x,
                p["Kzx"] * z * x + p["Kzy"] * z * y + p["Kxyz"] * x * y,
            ]
        )

    return e


def reorientation(p, c):
    """Creep: the part k of the load is reached late."""

    def e(now):
        dt = now.t[1] - now.t[0]
        late = np.column_stack([lagged(y, dt, c["tau"]) for y in now.output.T])
        return of_axes(p, "k") * (late - now.output)

    return e


def vibration_rectification(p, c):
    """Shift each rest by what shakes it, without the noise: rest after rest, no windows."""

    def e(now):
        still = ~now.other.any(axis=1)
        edges = np.flatnonzero(np.diff(still, prepend=~still[0]))
        lengths = np.diff(edges, append=len(still))
        means = [np.add.reduceat(now.output**k, edges) / lengths[:, None] for k in (1, 2)]
        variance = np.repeat(means[1] - means[0] ** 2, lengths, axis=0)
        return of_axes(p, "v") * variance * still[:, None]

    return e


def g2_sensitivity(p, c):
    def e(now):
        x, y, z = now.other.T
        return np.column_stack(
            [
                p[f"D{i}xx"] * (x * x - z * z)
                + p[f"D{i}yy"] * (y * y - z * z)
                + p[f"D{i}xy"] * x * y
                + p[f"D{i}xz"] * x * z
                + p[f"D{i}yz"] * y * z
                for i in "xyz"
            ]
        )

    return e


def scale_nonlinearity(p, c):
    return lambda now: (of_axes(p, "s2") + of_axes(p, "s3") * now.output) * now.output**2


def scale_asymmetry(p, c):
    return lambda now: of_axes(p, "sa") * np.where(now.output > 0, now.output, -now.output)


def earth_rate(p, c):
    """Turn about the vertical, as at a pole, where no horizontal part is left."""
    return lambda now: p["w_up"] * now.other / np.linalg.norm(now.other, axis=1, keepdims=True)


# at rest the drift has a name of its own
ramp = bias_drift


def g_sensitivity(p, c):
    G = np.array([[p[f"G{i}{j}"] for j in range(3)] for i in range(3)])
    return lambda now: now.other @ G.T


def harmonic(degree, size, seed):
    """Return a pattern of attitude of one degree, outside the library.

    A Legendre polynomial about a random axis: on an accelerometer along gravity, the part that
    its norm shows; on a gyroscope about an axis of its own on each axis.
    """
    axes = np.random.default_rng(seed).standard_normal((3, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)

    def on_accelerometer(now):
        u = now.output / np.linalg.norm(now.output, axis=1, keepdims=True)
        return size * eval_legendre(degree, u @ axes[0])[:, None] * u

    def on_gyroscope(now):
        u = now.other / np.linalg.norm(now.other, axis=1, keepdims=True)
        return size * eval_legendre(degree, u @ axes.T)

    return {"accelerometer": on_accelerometer, "gyroscope": on_gyroscope}
