"""Values of a sensor in the conventions of other tools.

Each function takes a sensor as the dict of `values.sensor_values`.
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
    """Return the coefficients c of the bias as a polynomial of the temperature, (4, 3).

    The rows are the orders k = 0 … 3, the columns the axes i. The effect `bias_temperature` on axis
    i at the temperature θ is ``Σ_k c_ki (θ - reference)^k``, with θ and `reference` in degC. c_ki
    is in the SI unit of the output ``K (raw - b)`` per K^k. All are 0 if the sensor has no such
    effect. `sensor` is the dict of the sensor's values.
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
    """Return Q and U, (3, 3) each, with ``T K = Q U``, for the model rpng of OpenVINS.

    T is the misalignment of the gyroscope, and K the diagonal matrix of its scale factors over the
    nominal scale; both are in the dict `gyroscope`. Q is a rotation, and U is upper triangular with
    a positive diagonal.
    """
    rotation, upper = np.linalg.qr(gyroscope["T"] * gyroscope["scale"])
    signs = np.sign(np.diag(upper))
    return rotation * signs, signs[:, None] * upper


def size_effect(accelerometer):
    """Return Kalibr's ``ry_i`` and ``rz_i``, m: the places of the y and z axes of an accelerometer.

    They are vectors from its x axis. The result is () if the `accelerometer`, a dict of its values,
    has no lever arm. Kalibr's model is as follows, with the specific force f and the angular rate w
    at the x axis, the matrix I_i that keeps component i only, and M = (T K)^-1::

        f_logged = M (f + Σ_i I_i (dw/dt × ri_i + w × (w × ri_i))) + b

    The model of this project differs from it by the product of misalignment and arm. Kalibr:
    IccSensors.py, IccScaledMisalignedSizeEffectImu; Rehder et al., ICRA 2016.
    """
    for fitted in (e for e in accelerometer["effects"] if e.name == "lever_arm"):
        rx, ry = fitted.vector.reshape(2, 3)
        return ry - rx, -rx
    return ()


def imu_sensor(sensor):
    """Return the values of MATLAB's imuSensor, a dict: bias, misalignment, and temperature terms.

    imuSensor computes ``reading = M u + ConstantBias + (θ - 25) TemperatureBias + noise`` with M =
    AxesMisalignment/100 and the temperature θ in degC. u is the true angular rate, or gravity less
    acceleration, which is minus the specific force; so the bias of the accelerometer changes its
    sign. The model of this project is x = T (K (raw - b) - e), with misalignment T, scale factors
    K, biases b and effects e. By it the logged SI value is ``z = (unit/K) (T⁻¹ x + e) + b`` with b
    in SI and unit, the nominal scale of the raw unit.

    `sensor` is the dict of the sensor's values. The keys of the result are ``bias`` (ConstantBias),
    ``misalignment`` (AxesMisalignment), ``slope`` (TemperatureBias), the slope of e at the
    reference temperature of the effect, and ``curvature``, (2, 3), the terms of e in θ² and θ³
    (rows) for each axis, which imuSensor does not take.
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
