"""Formats that take noise alone: parsed back, and put through the consumers' own formulas.

The formulas are written out here as the consumers' sources have them: what a filter expects of the
variance of velocity (angle) and bias after a second is N^2 and K^2.
"""

import numpy as np
import pytest
import yaml

from export.devices import (
    HOSTILE,
    RATE,
    K,
    N,
    device,
    power_cycled,
    unknown,
    warm_bias,
    without_flicker,
)
from imuloop.core.errors import Lacking
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.export import allan_variance_ros, kalibr, openvins, orb_slam3, vins_fusion

WORST = {"acc_n": N["az"], "gyr_n": N["gy"], "acc_w": K["ax"], "gyr_w": K["gz"]}
KALIBR_KEYS = {
    "acc_n": "accelerometer_noise_density",
    "gyr_n": "gyroscope_noise_density",
    "acc_w": "accelerometer_random_walk",
    "gyr_w": "gyroscope_random_walk",
}
ORB_KEYS = {
    "acc_n": "IMU.NoiseAcc",
    "gyr_n": "IMU.NoiseGyro",
    "acc_w": "IMU.AccWalk",
    "gyr_w": "IMU.GyroWalk",
}
FORMATS = (kalibr, allan_variance_ros, orb_slam3, vins_fusion, openvins)
RAISED = "so that N and K bound its Allan curve from 0.1 s to 1000 s"


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


def read(module, text):
    """Return the continuous densities and walks that a tool takes from its file."""
    content = yaml.safe_load(text.replace("%YAML:1.0\n", "", 1))
    if module is vins_fusion:
        return {key: content[key] / RATE**0.5 for key in WORST}
    names = ORB_KEYS if module is orb_slam3 else KALIBR_KEYS
    return {key: content.get("imu0", content)[name] for key, name in names.items()}


@pytest.mark.parametrize("module", [kalibr, allan_variance_ros])
def test_kalibr_reads_the_same_densities(module):
    content = yaml.safe_load(module.text(without_flicker(device())))
    assert {key: content[name] for key, name in KALIBR_KEYS.items()} == WORST
    assert content["update_rate"] == RATE
    assert isinstance(content["rostopic"], str)
    # its discrete value, as getAccelerometerStatistics has it
    discrete = content["accelerometer_noise_density"] / (1 / content["update_rate"]) ** 0.5
    assert discrete == pytest.approx(N["az"] * RATE**0.5, rel=1e-15)


def test_openvins_reads_the_same_densities():
    imu = opencv(openvins.text(without_flicker(device())))["imu0"]
    assert {key: imu[name] for key, name in KALIBR_KEYS.items()} == WORST
    assert imu["update_rate"] == RATE


def test_orb_slam3_expects_the_variance_of_our_noise():
    content = opencv(orb_slam3.text(without_flicker(device())))
    assert {key: content[name] for key, name in ORB_KEYS.items()} == WORST
    # new IMU::Calib(Tbc, Ng*sf, Na*sf, Ngw/sf, Naw/sf); a step adds dt^2 Na^2 and Naw^2
    root, steps = content["IMU.Frequency"] ** 0.5, RATE
    velocity = steps * (content["IMU.NoiseAcc"] * root / RATE) ** 2
    bias = steps * (content["IMU.GyroWalk"] / root) ** 2
    assert velocity == pytest.approx(N["az"] ** 2, rel=1e-12)
    assert bias == pytest.approx(K["gz"] ** 2, rel=1e-12)


def test_orb_slam3_ends_where_a_number_is_an_integer():
    assert all(type(value) is float for value in opencv(orb_slam3.text(device())).values())


def test_vins_fusion_expects_the_variance_of_our_noise():
    content = opencv(vins_fusion.text(without_flicker(device())))
    steps, dt = RATE, 1 / RATE
    # V noise V^T: 0.5 dt of each of two samples, as if they were others in the next step
    velocity = steps * 2 * (0.5 * dt * content["acc_n"]) ** 2
    angle = steps * 2 * (0.5 * dt * content["gyr_n"]) ** 2
    assert 2 * velocity == pytest.approx(N["az"] ** 2, rel=1e-12)
    assert 2 * angle == pytest.approx(N["gy"] ** 2, rel=1e-12)
    assert steps * (dt * content["acc_w"]) ** 2 == pytest.approx(K["ax"] ** 2, rel=1e-12)
    assert steps * (dt * content["gyr_w"]) ** 2 == pytest.approx(K["gz"] ** 2, rel=1e-12)
    assert content["g_norm"] == 9.8072


@pytest.mark.parametrize("module", FORMATS)
def test_what_a_tool_reads_bounds_the_allan_curve_of_every_axis(module):
    board, tau = device(), np.geomspace(0.1, 1000, 201)
    found = read(module, module.text(board))
    for letter, channels in (("acc", ACCELERATION), ("gyr", ANGULAR_RATE)):
        bound = found[f"{letter}_n"] ** 2 / tau + found[f"{letter}_w"] ** 2 * tau / 3
        for axis in channels:
            curve = board.noise.axes[axis].allan_variance(tau)
            assert (bound >= (1 - 1e-9) * curve).all(), axis
    # flicker stands far above white noise and walk of this gyroscope alone
    assert found["gyr_n"] > 1.3 * WORST["gyr_n"]
    assert all(found[key] >= (1 - 1e-12) * least for key, least in WORST.items())


@pytest.mark.parametrize("module", FORMATS)
def test_a_number_that_was_raised_says_from_what(module):
    lines = module.text(device()).splitlines()
    unit = RATE**0.5 if module is vins_fusion else 1.0
    (line,) = [x for x in lines if x.strip().startswith(("gyr_n:", "IMU.NoiseGyro", "gyroscope_n"))]
    assert line.endswith(f"worst axis: gy; raised from {N['gy'] * unit:.3g} {RAISED}")
    assert "raised from" not in module.text(without_flicker(device()))


@pytest.mark.parametrize("module", FORMATS)
def test_a_bias_that_moves_from_run_to_run_says_where_a_filter_begins(module):
    begin = "3 runs): start a filter's bias with this standard deviation"
    sizes = "0.01, 0, 0.002"
    text = module.text(power_cycled(device()))
    for sensor, unit in (("accelerometer", "m/s^2"), ("gyroscope", "rad/s")):
        line = f"# {sensor}: turn-on bias, run to run {sizes} {unit} (1 sigma of x, y, z; {begin}\n"
        assert text.count(line) == 1
    assert module.text(power_cycled(device(), ["gyroscope"])).count("turn-on bias") == 1
    assert "turn-on bias" not in module.text(device())


def test_a_walk_that_was_not_seen_is_said_to_be_a_limit():
    for module, key in ((kalibr, "gyroscope_random_walk"), (orb_slam3, "IMU.GyroWalk")):
        line = next(x for x in module.text(device()).splitlines() if x.startswith(key))
        assert line.endswith("worst axis: gz, not seen: its 95 % upper limit")


def test_each_axis_is_in_the_comments_of_allan_variance_ros():
    text = allan_variance_ros.text(device())
    assert "# Each axis, as estimated:\n# ax: N" in text
    assert "#   ax: K" not in text
    assert f"# gx: N, white noise, {N['gx']!r} rad/s/sqrt(Hz)\n" in text
    assert "# ay: K, random walk of the bias, 3.0e-05 m/s^3/sqrt(Hz) (95 % upper limit)\n" in text


@pytest.mark.parametrize("module", FORMATS)
def test_what_is_not_carried_is_said(module):
    text = module.text(device(effects=(warm_bias(),)))
    assert "bias_temperature: e_i = " in text
    assert "raised for flicker, Gauss-Markov processes, Q and R" in text
    left_out = text.partition("# Not carried: lines, the other axes' own noise, ")[2]
    assert "intervals" in left_out and "temperature" in left_out


@pytest.mark.parametrize("module", FORMATS)
def test_a_label_adds_nothing(module):
    def read(label):
        return yaml.safe_load(module.text(device(label)).replace("%YAML:1.0\n", "", 1))

    assert read(HOSTILE) == read("Board A")


@pytest.mark.parametrize("module", FORMATS)
def test_no_file_without_noise(module):
    with pytest.raises(Lacking):
        module.text(unknown())
