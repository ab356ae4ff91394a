"""Polynomials of a sensor's own output, which make its scale factor depend on the output."""

import numpy as np

from imuloop.effects.axes import AXES, on_each_axis, per_axis
from imuloop.model.effect import Effect

# pairs of an axis i with an error and another axis j whose output causes it
PAIRS = tuple((i, j) for i in range(3) for j in range(3) if i != j)


class Quadratic(Effect):
    """``e_i = K2_i y_i²``: the scale factor of an axis grows with its output y.

    Leaves this trace at rest: the norm of gravity g, in direction u, is wrong by ``K2 g² u_i³``,
    that is ``K2 g² (3/5 P1 + 2/5 P3)(u_i)`` with Legendre polynomials P. The part with P1, 60 %,
    looks like a bias. Imitated by: `cross_coupling`, of which it is a special case, and
    `asymmetry`, if there are few poses. Under vibration the same nonlinearity is called
    `vibration_rectification`.
    """

    name = "quadratic"
    sensors = ("accelerometer",)
    parameters = per_axis({"K2": "m/s^2 per (m/s^2)^2"})
    reference = "IEEE Std 1293-1998, 8.3, model equation: K2"

    def design(self, channels):
        """Return the derivative of e with respect to K2, y² on each axis, SI², (n, 3, 3).

        e is the error of the class' equation, K2 are its parameters, and y is the output. The axes
        of the result are: n points of `channels`, axis of the sensor, parameter.
        """
        return on_each_axis(channels.output**2)


class Cubic(Effect):
    """``e_i = K3_i y_i³``: the scale factor of an axis differs between small and large outputs y.

    Leaves this trace at rest: the norm of gravity g, in direction u, is wrong by ``K3 g³ u_i⁴``,
    that is ``K3 g³ (1/5 P0 + 4/7 P2 + 8/35 P4)(u_i)`` with Legendre polynomials P. The parts with
    P0 and P2, 77 %, look like scale factors. Imitated by: the scale factor, in six positions
    completely.
    """

    name = "cubic"
    sensors = ("accelerometer",)
    parameters = per_axis({"K3": "m/s^2 per (m/s^2)^3"})
    reference = "IEEE Std 1293-1998, 8.3, model equation: K3"

    def design(self, channels):
        """Return the derivative of e with respect to K3, y³ on each axis, SI³, (n, 3, 3).

        e is the error of the class' equation, K3 are its parameters, and y is the output. The axes
        of the result are: n points of `channels`, axis of the sensor, parameter.
        """
        return on_each_axis(channels.output**3)


class Asymmetry(Effect):
    """``e_i = (Ka_i/2) abs(y_i)``: the scale factor of an axis differs with the sign of its output.

    y is the output. Leaves this trace at rest: the norm of gravity g in the direction u is wrong by
    ``(Ka/2) g u_i |u_i|``. In Legendre polynomials of u_i, its part of degree 1, with the factor
    3/4, looks like a bias; the other parts have the degrees 3, 5, 7 …. Imitated by: `quadratic`,
    which lacks only degree 5 and a kink at u_i = 0; more than 30 poses show them.
    """

    name = "asymmetry"
    sensors = ("accelerometer",)
    parameters = per_axis({"Ka": "1"})
    reference = "IEEE Std 1293-1998, 8.3, model equation: K1' (here Ka)"

    def design(self, channels):
        """Return the derivative of e with respect to Ka, |y|/2 on each axis, SI, (n, 3, 3).

        e is the error of the class' equation, Ka are its parameters, and y is the output. The axes
        of the result are: n points of `channels`, axis of the sensor, parameter.
        """
        return on_each_axis(np.abs(channels.output) / 2)


class CrossCoupling(Effect):
    """``e_i = Σ_j K_ij y_i y_j + Kxyz y_j y_k, j, k ≠ i``: products of the outputs of two axes.

    y is the output. Apart from y_i² on axis i, which is the `quadratic`, there are 15 terms, each a
    product of two outputs on one axis. At rest they leave only 7 different errors in the norm of
    gravity, whose direction is u: y_i y_j on axis i and y_i² on axis j both leave u_i² u_j, and y_j
    y_k on axis i leaves u_x u_y u_z for any i. A `quadratic` is a special case: it leaves u_i³,
    which equals u_i - u_j² u_i - u_k² u_i, a bias and two of the 7. The norm does not tell which
    product causes a trace. So the correction is right along gravity, and wrong across gravity by up
    to the residual.
    Leaves this trace: the norm of gravity has an error of degree 3 in the direction u. Imitated by:
    `quadratic`, `asymmetry`.
    """

    name = "cross_coupling"
    sensors = ("accelerometer",)
    parameters = dict.fromkeys(
        [*(f"K{AXES[i]}{AXES[j]}" for i, j in PAIRS), "Kxyz"], "m/s^2 per (m/s^2)^2"
    )
    reference = "IEEE Std 1293-1998, 8.3, model equation: Kip, Kio, Kpo"

    def design(self, channels):
        """Return the derivative of e with respect to the K_ij, then Kxyz, SI², (n, 3, 7).

        e is the error of the class' equation, which also has these 7 parameters. The derivative is
        the product of two outputs that the parameter multiplies. The axes of the result are: n
        points of `channels`, axis of the sensor, parameter.
        """
        y = channels.output
        columns = np.zeros((len(y), 3, 7))
        for k, (i, j) in enumerate(PAIRS):
            columns[:, i, k] = y[:, i] * y[:, j]
        columns[:, :, 6] = _product_of_others(y)
        return columns


class ScaleNonlinearity(Effect):
    """``e_i = s2_i y_i² + s3_i y_i³``: the scale factor of an axis changes with the rate.

    y is the output, an angular rate.
    Leaves this trace: the error of a turn grows with its speed; the error by s2 keeps its sign when
    the turn is reversed. At rest there is no error. Imitated by: the scale factor and, for s2,
    `scale_asymmetry`, if all turns are about equally fast.
    """

    name = "scale_nonlinearity"
    sensors = ("gyroscope",)
    parameters = per_axis({"s2": "rad/s per (rad/s)^2", "s3": "rad/s per (rad/s)^3"})
    reference = "IEEE Std 528-2001, nonlinearity"
    records = ("poses", "motion")

    def design(self, channels):
        """Return the derivative of e with respect to s2, then s3: y² and y³, SI, (n, 3, 6).

        e is the error of the class' equation, s2 and s3 are its parameters on each axis, and y is
        the output. The axes of the result are: n points of `channels`, axis of the sensor,
        parameter.
        """
        return on_each_axis(channels.output**2, channels.output**3)


class ScaleAsymmetry(Effect):
    """``e_i = sa_i abs(y_i)``: the scale factor of an axis differs between left and right turns.

    y is the output. The standard (see `reference`) defines the asymmetry as the difference between
    the scale factors of left and right turns, which is 2 sa.
    Leaves this trace: the error of a turn keeps its sign when the turn is reversed; at rest there
    is no error. Imitated by: the scale factor, if each axis is turned one way only; s2 of
    `scale_nonlinearity`, if all turns are equally fast.
    """

    name = "scale_asymmetry"
    sensors = ("gyroscope",)
    parameters = per_axis({"sa": "1"})
    reference = "IEEE Std 528-2001, asymmetry error"
    records = ("poses", "motion")

    def design(self, channels):
        """Return the derivative of e with respect to sa, |y| on each axis, SI, (n, 3, 3).

        e is the error of the class' equation, sa are its parameters, and y is the output. The axes
        of the result are: n points of `channels`, axis of the sensor, parameter.
        """
        return on_each_axis(np.abs(channels.output))


class Anisoinertia(Effect):
    """``e_i = a_i w_j w_k``: rates about both other axes at once appear as a rate about axis i.

    w is the angular rate, and j and k are the axes other than i.
    Leaves this trace: turns about directions between the axes of the sensor have an error; at rest
    there is none.
    """

    name = "anisoinertia"
    sensors = ("gyroscope",)
    parameters = per_axis({"a": "rad/s per (rad/s)^2"})
    reference = "Titterton and Weston, Strapdown Inertial Navigation Technology, anisoinertia"
    records = ("poses", "motion")
    limit = 0.05

    def design(self, channels):
        """Return the derivative of e with respect to a, w_j w_k on axis i, SI², (n, 3, 3).

        e is the error of the class' equation, a are its parameters, and w is the angular rate. The
        axes of the result are: n points of `channels`, axis of the sensor, parameter.
        """
        return on_each_axis(_product_of_others(channels.output))


def _product_of_others(y):
    """Return for each axis the product of the other two components of n vectors, (n, 3).

    `y`, (n, 3), are the vectors.
    """
    return np.roll(y, -1, axis=1) * np.roll(y, -2, axis=1)
