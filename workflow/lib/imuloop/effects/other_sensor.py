"""Cross-sensitivity of one sensor to the quantity that the other measures."""

import numpy as np

from imuloop.core.units import EARTH_RATE
from imuloop.effects.axes import AXES, row_by_row
from imuloop.effects.delays import other_slope
from imuloop.model.effect import Effect

# products of specific force that depend on the attitude: xx is f_x² - f_z²
PRODUCTS = ("xx", "yy", "xy", "xz", "yz")


class GSensitivity(Effect):
    """``e = G f``: the gyroscope's bias follows the specific force in every attitude.

    f is the specific force. G_ij is the rate that axis i shows for 1 m/s^2 along axis j.
    Leaves this trace: the mean rate of a pose is linear in the direction of f. Imitated by: the
    `earth_rate`, if G is a multiple of the unit matrix.
    """

    name = "g_sensitivity"
    sensors = ("gyroscope",)
    parameters = {f"G{i}{j}": "rad/s per m/s^2" for i in range(3) for j in range(3)}
    reference = "IEEE Std 1431-2004, acceleration-sensitive drift rate"

    def design(self, channels):
        """Return the derivative of e with respect to G, row by row, m/s^2, (n, 3, 9).

        e is the error of the class' equation, ``e = G f``. The derivative of e_i with respect to
        row i of G is the specific force f, and zero with respect to the other rows. The axes of the
        result are: n points of `channels`, axis of the sensor, element of G.
        """
        return row_by_row(channels.other)


class G2Sensitivity(Effect):
    """``e_i = Σ_jk D_ijk f_j f_k``: the anisoelastic bias of a gyroscope.

    f is the specific force. Each axis i has five terms: D_ixx (f_x² - f_z²), D_iyy (f_y² - f_z²),
    D_ixy f_x f_y, D_ixz f_x f_z, D_iyz f_y f_z. There is no sixth term |f|²: at rest it is the same
    in all attitudes, like a bias.
    Leaves this trace: the mean rate of a pose is a polynomial of degree 2 in the direction of f (by
    `g_sensitivity`, of degree 1). Imitated by: nothing else of degree 2.
    """

    name = "g2_sensitivity"
    sensors = ("gyroscope",)
    parameters = {f"D{i}{jk}": "rad/s per (m/s^2)^2" for i in AXES for jk in PRODUCTS}
    reference = "IEEE Std 528-2001, 2.4, acceleration-squared-sensitive drift rate"

    def design(self, channels):
        """Return the derivative of e with respect to D, axis by axis, (m/s^2)², (n, 3, 15).

        e is the error of the class' equation, which also has the parameters D. The derivative of
        e_i with respect to the five parameters of axis i has the five products of specific forces;
        with respect to all other parameters it is zero. The axes of the result are: n points of
        `channels`, axis of the sensor, parameter.
        """
        x, y, z = channels.other.T
        return row_by_row(np.column_stack([x**2 - z**2, y**2 - z**2, x * y, x * z, y * z]))


class EarthRate(Effect):
    """``e = w_up u, u the direction of f``: the vertical part of the Earth's rate.

    f is the specific force, so u points up at rest, and w_up is 7.292115e-5 rad/s · sin(latitude).
    The horizontal part of the Earth's rate depends on the heading, which is not measured, and stays
    in the residual. While the device accelerates, f is not vertical.
    Leaves this trace: in every attitude the mean rate has a part along the vertical, 15 °/h at the
    pole, and the angle of a move is wrong in proportion to its duration. Imitated by: a
    `g_sensitivity` that is a multiple of the unit matrix, exactly.
    """

    name = "earth_rate"
    sensors = ("gyroscope",)
    parameters = {"w_up": "rad/s"}
    reference = "WGS 84, NIMA TR8350.2, table 3.1"
    limit = EARTH_RATE

    def design(self, channels):
        """Return the derivative of e with respect to w_up, which is the direction u, (n, 3, 1).

        e is the error of the class' equation, with the vertical rate w_up and the direction u of
        the specific force. In free fall the result is zero. Its axes are: n points of `channels`,
        axis of the sensor, the single parameter.
        """
        norm = np.linalg.norm(channels.other, axis=1, keepdims=True)
        return (channels.other / np.where(norm > 0, norm, 1.0))[:, :, None]


class RateSensitivity(Effect):
    """``e = M w``: the specific force depends on the angular rate w.

    M_ij is the specific force that axis i shows for a rate of 1 rad/s about axis j.
    Leaves this trace: after a move, the integrated velocity is wrong by M times the angle turned;
    at rest there is no error. Imitated by: `lever_arm`, in part, if all turns are equally fast.
    """

    name = "rate_sensitivity"
    sensors = ("accelerometer",)
    parameters = {f"M{i}{j}": "m/s^2 per rad/s" for i in range(3) for j in range(3)}
    reference = "Xsens MTi user manual, cross coupling of acceleration and angular rate"
    records = ("motion",)
    limit = 0.1  # 10 mg at 1 rad/s

    def design(self, channels):
        """Return the derivative of e with respect to M, row by row, rad/s, (n, 3, 9).

        e is the error of the class' equation, ``e = M w``. The derivative of e_i with respect to
        row i of M is the angular rate w, and zero with respect to the other rows. The axes of the
        result are: n points of `channels`, axis of the sensor, element of M.
        """
        return row_by_row(channels.other)


class LeverArm(Effect):
    """``e_i = (dw/dt × r_i + w × (w × r_i))_i, r_z = 0``: axis i of the accelerometer is at r_i.

    w is the angular rate. The centre of rotation is not known, so an arm that all axes have in
    common cannot be determined. The origin is therefore the place of the z axis, and r_x and r_y,
    m, are relative to it.
    Leaves this trace: after a move, the integrated velocity is wrong by an amount that depends on
    the angle turned and on the square of the rate: 1 cm at 5 rad/s gives 0.25 m/s². At rest there
    is no error. Imitated by: `rate_sensitivity`, in part.
    """

    name = "lever_arm"
    sensors = ("accelerometer",)
    parameters = {f"r{i}{j}": "m" for i in "xy" for j in AXES}
    reference = "Titterton and Weston, Strapdown Inertial Navigation Technology, size effect"
    records = ("motion",)
    limit = 0.1  # largest size of a sensor
    rate_of_change = True

    def design(self, channels):
        """Return the derivative of e with respect to r_x and r_y, rad²/s², (n, 3, 6).

        e is the error of the class' equation; r_x and r_y are the places of the x and y axes of the
        accelerometer. For each point there is a matrix A with ``dw/dt × r + w × (w × r) = A r``,
        where w is the angular rate. The derivative of e_x with respect to r_x is the first row of
        A, and the derivative of e_y with respect to r_y the second. The axes of the result are: n
        points of `channels`, axis of the sensor, component of r_x, then of r_y.
        """
        w, change = channels.other, channels.evaluate_memory(other_slope)
        # w × (w × r) = w (w·r) - r (w·w)
        outer, square = w[:, :, None] * w[:, None], np.sum(w**2, axis=1)[:, None, None]
        # the columns of this matrix are dw/dt × the unit vectors
        cross = np.cross(change[:, None], np.eye(3)).swapaxes(1, 2)
        A = outer - square * np.eye(3) + cross
        design = np.zeros((len(w), 3, 6))
        design[:, 0, :3], design[:, 1, 3:] = A[:, 0], A[:, 1]
        return design
