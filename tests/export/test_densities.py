"""Formats that take noise alone: parsed back, and put through the consumers' own formulas.

The formulas are written out here as the consumers' sources have them: what a filter expects of the
variance of velocity (angle) and bias after a second is N^2 and K^2.
"""

import pytest
import yaml

from export.devices import HOSTILE, RATE, K, N, device, unknown, warm_bias
from imuloop.core.errors import Lacking
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


@pytest.mark.parametrize("module", [kalibr, allan_variance_ros])
def test_kalibr_reads_the_same_densities(module):
    content = yaml.safe_load(module.text(device()))
    assert {key: content[name] for key, name in KALIBR_KEYS.items()} == WORST
    assert content["update_rate"] == RATE
    assert isinstance(content["rostopic"], str)
    # its discrete value, as getAccelerometerStatistics has it
    discrete = content["accelerometer_noise_density"] / (1 / content["update_rate"]) ** 0.5
    assert discrete == pytest.approx(N["az"] * RATE**0.5, rel=1e-15)


def test_openvins_reads_the_same_densities():
    imu = opencv(openvins.text(device()))["imu0"]
    assert {key: imu[name] for key, name in KALIBR_KEYS.items()} == WORST
    assert imu["update_rate"] == RATE


def test_orb_slam3_expects_the_variance_of_our_noise():
    content = opencv(orb_slam3.text(device()))
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
    content = opencv(vins_fusion.text(device()))
    steps, dt = RATE, 1 / RATE
    # V noise V^T: 0.5 dt of each of two samples, as if they were others in the next step
    velocity = steps * 2 * (0.5 * dt * content["acc_n"]) ** 2
    angle = steps * 2 * (0.5 * dt * content["gyr_n"]) ** 2
    assert 2 * velocity == pytest.approx(N["az"] ** 2, rel=1e-12)
    assert 2 * angle == pytest.approx(N["gy"] ** 2, rel=1e-12)
    assert steps * (dt * content["acc_w"]) ** 2 == pytest.approx(K["ax"] ** 2, rel=1e-12)
    assert steps * (dt * content["gyr_w"]) ** 2 == pytest.approx(K["gz"] ** 2, rel=1e-12)
    assert content["g_norm"] == 9.8072


def test_a_walk_that_was_not_seen_is_said_to_be_a_limit():
    for module, key in ((kalibr, "gyroscope_random_walk"), (orb_slam3, "IMU.GyroWalk")):
        line = next(x for x in module.text(device()).splitlines() if x.startswith(key))
        assert line.endswith("worst axis: gz, not seen: its 95 % upper limit")


def test_each_axis_is_in_the_comments_of_allan_variance_ros():
    text = allan_variance_ros.text(device())
    assert "#   ax: K" not in text
    assert f"# gx: N, white noise, {N['gx']!r} rad/s/sqrt(Hz)\n" in text
    assert "# ay: K, random walk of the bias, 3.0e-05 m/s^3/sqrt(Hz) (95 % upper limit)\n" in text


@pytest.mark.parametrize("module", FORMATS)
def test_what_is_not_carried_is_said(module):
    text = module.text(device(effects=(warm_bias(),)))
    assert "bias_temperature: e_i = " in text
    assert "B = 3e-05 rad/s" in text
    assert "Q" in text and "Gauss-Markov" in text and "temperature" in text


@pytest.mark.parametrize("module", FORMATS)
def test_a_label_adds_nothing(module):
    def read(label):
        return yaml.safe_load(module.text(device(label)).replace("%YAML:1.0\n", "", 1))

    assert read(HOSTILE) == read("Board A")


@pytest.mark.parametrize("module", FORMATS)
def test_no_file_without_noise(module):
    with pytest.raises(Lacking):
        module.text(unknown())
