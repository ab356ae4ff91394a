"""Formats that take noise alone: parsed back, and put through the consumers' own formulas.

The formulas are written out here as the consumers' sources have them: what a filter expects of the
variance of velocity (angle) and bias after a second is N^2 and K^2.
"""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import yaml

from export.devices import (
    ALLAN_VARIANCE_ROS,
    HOSTILE,
    KALIBR,
    OPENVINS,
    ORB_SLAM3,
    RATE,
    ROS,
    VINS_FUSION,
    K,
    N,
    device,
    of_calibrated,
    turning_device,
    with_sensor,
    without_flicker,
)
from imuloop.core.errors import Lacking
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, SENSORS

LOGGED = {"acc_n": N["az"], "gyr_n": N["gy"], "acc_w": K["ax"], "gyr_w": K["gz"]}
OF_N, OF_K = of_calibrated(device(), N), of_calibrated(device(), K)
WORST = {"acc_n": OF_N["az"], "gyr_n": OF_N["gy"], "acc_w": OF_K["ax"], "gyr_w": OF_K["gz"]}
SENSOR = {"acc": "accelerometer", "gyr": "gyroscope"}
PARAMETER = {"n": "noise_density", "w": "random_walk"}
KALIBR_KEYS = {key: f"{SENSOR[key[:3]]}_{PARAMETER[key[-1]]}" for key in WORST}
ORB_KEYS = dict(zip(WORST, "NoiseAcc NoiseGyro AccWalk GyroWalk".split(), strict=True))
ORB_KEYS = {key: f"IMU.{name}" for key, name in ORB_KEYS.items()}
KEYS = {ORB_SLAM3: ORB_KEYS, VINS_FUSION: {key: key for key in WORST}}
FORMATS = pytest.mark.parametrize(
    "form", [KALIBR, ALLAN_VARIANCE_ROS, ORB_SLAM3, VINS_FUSION, OPENVINS]
)


def opencv(text):
    """Return what OpenCV's reader takes from a file: the first line names the type.

    A word without quotes would go on to the end of its line, with the comment.
    """
    first, rest = text.split("\n", 1)
    assert first == "%YAML:1.0"
    assert "\t" not in rest
    for line in rest.splitlines():
        value = line.partition(": ")[2].strip()
        assert line.startswith("#") or not value or value[0] in '#"[-.0123456789', line
    return yaml.safe_load(rest)


def read(form, board):
    """Return what a tool reads, and the continuous densities and walks in it."""
    text = form.text(board)
    content = opencv(text) if text.startswith("%") else yaml.safe_load(text)
    content = content.get("imu0", content)
    factor = RATE**-0.5 if form is VINS_FUSION else 1.0
    names = KEYS.get(form, KALIBR_KEYS)
    return content, {key: content[name] * factor for key, name in names.items()}


@FORMATS
def test_a_tool_reads_the_densities_of_the_worst_axes(form):
    content, densities = read(form, without_flicker(device()))
    assert densities == pytest.approx(LOGGED if form is OPENVINS else WORST, rel=1e-15)
    if form is not VINS_FUSION:
        assert content.get("update_rate", content.get("IMU.Frequency")) == RATE
    if form is ORB_SLAM3:
        # it ends where a number is an integer
        assert all(type(value) is float for value in content.values())


@pytest.mark.parametrize("turned", [False, True])
def test_exported_noise_is_that_of_the_samples_that_the_tool_gets(turned):
    """Densities in a file are those of its samples: calibrated ones have K and T in their noise.

    Protects them from being exported as logged, by which a filter of a device with 5 % of scale
    factor error trusts it wrongly. White noise as logged goes through the calibration itself; what
    a tool calibrates by itself, or simulates, takes as logged.
    """
    T = np.array([[1, 0.2, -0.1], [0, 1, 0.3], [0, 0, 1]]) if turned else np.eye(3)
    board = without_flicker(device(effects=()))
    for name in SENSORS:
        scale = 1.05 * np.full(3, board.sensor(name).raw_unit.scale)
        board = with_sensor(board, name, T=T, K=scale)
    n, rng = 100_000, np.random.default_rng(4)
    logged = pd.DataFrame({axis: N[axis] * RATE**0.5 * rng.standard_normal(n) for axis in N})
    logged.insert(0, "t", np.arange(n) / RATE)
    measured = board.calibration.apply(logged)[list(N)].std() * RATE**-0.5
    largest = {
        letter: max(measured[axis] for axis in SENSORS[sensor]) for letter, sensor in SENSOR.items()
    }
    for form in (KALIBR, ALLAN_VARIANCE_ROS, ORB_SLAM3, VINS_FUSION):
        _, densities = read(form, board)
        for letter, value in largest.items():
            assert densities[f"{letter}_n"] == pytest.approx(value, rel=0.01)
        if not turned:
            assert densities == pytest.approx({k: 1.05 * v for k, v in LOGGED.items()}, rel=1e-12)
    content = yaml.safe_load(ROS.text(board))
    for key, axes in (
        ("linear_acceleration_covariance", ACCELERATION),
        ("angular_velocity_covariance", ANGULAR_RATE),
    ):
        densities = np.diag(np.reshape(content[key], (3, 3))) ** 0.5 * RATE**-0.5
        np.testing.assert_allclose(densities, measured[list(axes)], rtol=0.01)
    assert read(OPENVINS, board)[1] == pytest.approx(LOGGED, rel=1e-15)


def kalibr_logs(force, f, w, change):
    """Return what Kalibr's IccScaledMisalignedSizeEffectImu expects to be logged, less its bias.

    Of specific force, angular rate and its change of the body, one sample each.
    """
    felt = np.array(f)
    for axis, name in enumerate("xyz"):
        pick, r = np.diag(np.eye(3)[axis]), np.array(force[f"r{name}_i"])
        felt = felt + pick @ (np.cross(change, r) + np.cross(w, np.cross(w, r)))
    return np.array(force["M"]) @ felt


@pytest.mark.parametrize("misaligned", [False, True])
def test_kalibr_expects_what_our_model_logs(misaligned):
    board = turning_device()
    if not misaligned:
        board = with_sensor(board, "accelerometer", T=np.eye(3))
    content = yaml.safe_load(KALIBR.text(board))
    assert content["model"] == "scale-misalignment-size-effect"
    # as its estimator has it, whose origin is where the x axis sits
    assert content["accelerometers"]["rx_i"] == [0.0, 0.0, 0.0]
    rng, f, w = np.random.default_rng(2), np.array([3.0, -5.0, 8.0]), np.array([2.0, -4.0, 3.0])
    change = rng.normal(0, 20, 3)
    arms, sensitivity = (e.vector for e in board.sensor("accelerometer").effects)
    added = [np.cross(change, r) + np.cross(w, np.cross(w, r)) for r in arms.reshape(2, 3)]
    e, (at_x, _) = np.array([added[0][0], added[1][1], 0.0]), added
    # specific force where the z axis sits, and where the x axis does
    logged = kalibr_logs(content["accelerometers"], f + at_x, w, change)
    force = board.sensor("accelerometer")
    ours = (np.linalg.solve(force.T, f) + e) * force.raw_unit.scale / force.K
    size = np.abs(e).max()
    assert size > 0.1 and len(sensitivity) == 9
    allowed = 1.1 * size * np.abs(force.T - np.eye(3)).sum(axis=1).max() + 1e-12
    np.testing.assert_allclose(logged, ours, rtol=0, atol=allowed)


def test_ros_knows_no_orientation_and_nothing_without_a_rate():
    content = yaml.safe_load(ROS.text(device()))
    assert content["orientation_covariance"] == [-1.0] + [0.0] * 8
    assert yaml.safe_load(ROS.text(device(HOSTILE))) == content
    with pytest.raises(Lacking, match="rate"):
        ROS.text(replace(device(), rate_hz=None))


@FORMATS
def test_what_a_tool_reads_bounds_the_allan_curve_of_every_axis(form):
    board, tau = device(), np.geomspace(0.1, 1000, 201)
    _, densities = read(form, board)
    deviations = {
        axis: noise.allan_variance(tau) ** 0.5 for axis, noise in board.noise.axes.items()
    }
    if form is not OPENVINS:
        deviations = of_calibrated(board, deviations)
    for letter, channels in zip(("acc", "gyr"), SENSORS.values(), strict=True):
        bound = densities[f"{letter}_n"] ** 2 / tau + densities[f"{letter}_w"] ** 2 * tau / 3
        for axis in channels:
            assert (bound >= (1 - 1e-9) * deviations[axis] ** 2).all(), axis
    # flicker stands far above white noise and walk of this gyroscope alone
    assert densities["gyr_n"] > 1.3 * WORST["gyr_n"]
