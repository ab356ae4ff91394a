"""What single tools compute otherwise than we do: each function takes values of a sensor."""

import numpy as np
from numpy.polynomial import Polynomial

from imuloop.core.units import DEGREE, HOUR
from imuloop.effects.axes import AXES
from imuloop.export.values import BIAS, known_processes

# orders of a bias' polynomial of the temperature, with the constant
TERMS = 4
# degC, about which imuSensor's temperature bias counts
STANDARD = 25.0
# floor of the Allan deviation of flicker, over B
FLOOR = np.sqrt(2 * np.log(2) / np.pi)
# largest Allan deviation of a Gauss-Markov process, at 1.89 of its time constant, over its
# standard deviation: sqrt(2 [1 - (3 - 4 exp(-u) + exp(-2u))/(2u)]/u), u = 1.89
PEAK = 0.6174
# s, gnss-ins-sim's own choice for a flicker, which has no time constant
TIME_CONSTANT = 100.0


def bias_polynomial(sensor, reference):
    """Return the bias that follows the temperature, about another temperature, degC, shape (4, 3).

    ``e_i = Σ_k c_ki (θ - reference)^k``, k = 0 … 3: the effect `bias_temperature`, exactly; SI of
    the output ``K (raw - b)`` per K^k, zeros where there is no such effect.
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
    """Return Q and U of the gyroscope's ``T K = Q U``, K over the nominal: OpenVINS' model rpng.

    Q is a rotation, U upper triangular with a positive diagonal; shape (3, 3) each.
    """
    rotation, upper = np.linalg.qr(gyroscope["T"] * gyroscope["scale"])
    signs = np.sign(np.diag(upper))
    return rotation * signs, signs[:, None] * upper


def size_effect(accelerometer):
    """Return Kalibr's ``ry_i`` and ``rz_i``, arms in m from where the x axis sits; () without.

    With f and w on our axes where the x axis sits, I_i to pick component i, M = (T K)^-1::

        f_logged = M (f + Σ_i I_i (dw/dt × ri_i + w × (w × ri_i))) + b

    Ours differs by misalignment times arm. Kalibr: IccSensors.py,
    IccScaledMisalignedSizeEffectImu; Rehder et al., ICRA 2016.
    """
    for fitted in (e for e in accelerometer["effects"] if e.name == "lever_arm"):
        rx, ry = fitted.vector.reshape(2, 3)
        return ry - rx, -rx
    return ()


def imu_sensor(sensor):
    """Return the values of MATLAB's imuSensor: bias, misalignment and slope of the temperature.

    ``reading = M u + ConstantBias + (θ - 25) TemperatureBias + noise`` with M =
    AxesMisalignment/100, u the true angular rate, or gravity less acceleration: -f, so that its
    bias has the other sign. From ours, x = T (K (raw - b) - e), the logged SI value is
    ``z = (unit/K) (T⁻¹ x + e) + b`` with b in SI. The slope is TemperatureBias, at the effect's own
    temperature; its ``curvature``, (2, 3), what is not carried of e.
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


def gnss_ins_sim(sensor):
    """Return the values of gnss-ins-sim's keys, in its units, and words on the drift.

    ``z = f + b + drift + white noise``; the standard deviation of the white noise is
    ``vrw sqrt(rate)``; the drift is a Gauss-Markov process of standard deviation `b_stability` and
    time constant `b_corr`. Ours: the strongest Gauss-Markov process of an axis; without one, one
    whose Allan deviation is at its peak as high as the floor of B.

    References
    ----------
    gnss-ins-sim, sim/imu_model.py (IMU.__init__: keys and units), pathgen/pathgen.py (acc_gen,
    gyro_gen, bias_drift).
    """
    gyroscope, root = sensor["name"] == "gyroscope", np.sqrt(HOUR)
    bias, white = (DEGREE / HOUR, DEGREE / root) if gyroscope else (1.0, 1.0 / root)
    drifts = []
    for axis, noise in enumerate(sensor["noise"]):
        name = sensor["logged"]["N"][axis].axis
        if found := known_processes(noise):
            drifts.append((*max(found), f"{name}: Gauss-Markov process"))
        else:
            flicker = noise.B.size * FLOOR / PEAK
            words = f"{name}: flicker B{', its 95 % upper limit' * (noise.B.value is None)}"
            drifts.append((flicker, TIME_CONSTANT, words))
    sigma, tau, words = zip(*drifts, strict=True)
    return {
        "bias": sensor["offset"] / bias,
        "white": [density.value / white for density in sensor["logged"]["N"]],
        "stability": [each / bias for each in sigma],
        "time_constants": tau,
        "words": "; ".join(words),
    }
