"""Values in the conventions of single tools.

Each function takes the values of a sensor, the dict of `values.sensor_values`.
"""

import numpy as np
from numpy.polynomial import Polynomial

from imuloop.effects.axes import AXES
from imuloop.export.values import BIAS

# orders of a bias' polynomial of the temperature, with the constant
TERMS = 4
# degC: reference temperature of the temperature bias of imuSensor
STANDARD = 25.0


def bias_polynomial(sensor, reference):
    """Return the coefficients of the bias over temperature about `reference`, degC, (4, 3).

    ``e_i = Σ_k c_ki (θ - reference)^k``, k = 0 … 3, equals the effect `bias_temperature`. c_ki is
    in SI units of the output ``K (raw - b)`` per K^k. All are 0 if the sensor has no such effect.
    """
    total = np.zeros((TERMS, 3))
    for fitted in sensor[BIAS]:
        warmer = Polynomial([reference - fitted.effect.reference_temperature, 1.0])
        orders = range(1, fitted.effect.order + 1)
        for axis, letter in enumerate(AXES):
            c = Polynomial([0.0, *(fitted.values[f"c{k}{letter}"] for k in orders)])(warmer).coef
            total[: len(c), axis] += c
    return total


def rotation_and_upper(gyroscope):
    """Return Q and U, (3, 3) each, of the gyroscope's ``T K = Q U``, for OpenVINS' model rpng.

    K is divided by the nominal scale. Q is a rotation, and U is upper triangular with a positive
    diagonal.
    """
    rotation, upper = np.linalg.qr(gyroscope["T"] * gyroscope["scale"])
    signs = np.sign(np.diag(upper))
    return rotation * signs, signs[:, None] * upper


def size_effect(accelerometer):
    """Return Kalibr's ``ry_i`` and ``rz_i``, m, or () without a lever arm.

    They are the vectors from the x axis of the accelerometer to its y and z axes. With specific
    force f and angular rate w at the x axis, I_i that picks component i, and M = (T K)^-1::

        f_logged = M (f + Σ_i I_i (dw/dt × ri_i + w × (w × ri_i))) + b

    Our model differs from this by misalignment times arm. Kalibr: IccSensors.py,
    IccScaledMisalignedSizeEffectImu; Rehder et al., ICRA 2016.
    """
    for fitted in (e for e in accelerometer["effects"] if e.name == "lever_arm"):
        rx, ry = fitted.vector.reshape(2, 3)
        return ry - rx, -rx
    return ()


def imu_sensor(sensor):
    """Return the values of MATLAB's imuSensor: bias, misalignment and slope of the temperature.

    ``reading = M u + ConstantBias + (θ - 25) TemperatureBias + noise`` with M =
    AxesMisalignment/100. u is the true angular rate, or gravity less acceleration, which is minus
    the specific force, so that the accelerometer's bias changes its sign. From our model,
    x = T (K (raw - b) - e), the logged SI value is
    ``z = (unit/K) (T⁻¹ x + e) + b`` with b in SI. ``slope`` is TemperatureBias, the
    slope of e at the effect's reference temperature; ``curvature``, (2, 3), are the terms of e in
    θ² and θ³, which imuSensor does not take.
    """
    scale, bias = sensor["scale"], sensor["offset"]
    sign = -1.0 if sensor["name"] == "accelerometer" else 1.0
    c = np.zeros((TERMS, 3))
    if sensor[BIAS]:
        c = bias_polynomial(sensor, sensor["reference"])
        bias = bias + c[0] / scale + c[1] / scale * (STANDARD - sensor["reference"])
    return {
        "bias": sign * bias,
        "misalignment": 100 * np.linalg.inv(sensor["T"]) / scale[:, None],
        "slope": sign * c[1] / scale,
        "curvature": c[2:],
    }
