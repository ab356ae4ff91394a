"""The loop on measured recordings: effects missing in each device's model, on held-out data."""

import numpy as np
import pytest

import imuloop.effects  # noqa: F401  loads the library
from imuloop.core.samples import read_columns
from published.conftest import BOARDS

GRAVITY = 9.81744
# polynomial terms that a floor of white noise alone would find everywhere
POLYNOMIAL = {"quadratic", "cubic", "asymmetry", "cross_coupling"}


def part(measured, device, sensor, record="poses"):
    return measured.json(device, "diagnosis")["sensors"][sensor][record]


def names(block):
    return [effect["name"] for effect in block["effects"]]


def candidates(block):
    return {candidate["name"]: candidate for candidate in block["candidates"]}


def sizes(candidate):
    return np.array([v / candidate["std"][k] for k, v in candidate["parameters"].items()])


def test_xsens_accelerometer_needs_no_polynomial(measured_results):
    block = part(measured_results, "xsens_mti", "accelerometer")
    assert names(block) == []
    residual = block["residuals"]["gravity_norm"]
    assert residual["after"] / GRAVITY <= 0.165e-3
    for name in POLYNOMIAL:
        candidate = candidates(block)[name]
        assert candidate["status"] in ("rejected", "not_observable")
        # against a white floor they would look significant, and make held-out poses worse
        assert (candidate["heldout_after"] or np.inf) > residual["before"]


def test_xsens_gyroscope_is_g_sensitive(measured_results):
    block = part(measured_results, "xsens_mti", "gyroscope")
    assert names(block)[:1] == ["g_sensitivity"]
    poses = read_columns(measured_results.of("xsens_mti") / "poses.parquet")
    error = {
        when: np.degrees(np.column_stack([poses[f"pose_rate_{when}_{axis}"] for axis in "xyz"]))
        for when in ("before", "after")
    }
    # the mean over poses and axes of the absolute error
    absolute = {when: np.abs(e).mean() for when, e in error.items()}
    assert absolute["before"] > 0.055
    assert absolute["after"] <= 0.015
    # the root mean square falls by as much: 0.055 to 0.015
    rms = {when: np.sqrt((e**2).mean(axis=0)).mean() for when, e in error.items()}
    assert rms["after"] / rms["before"] <= 0.015 / 0.055
    assert np.degrees(block["residuals"]["rotation"]["after"]) <= 0.155
    G = np.array(list(block["effects"][0]["parameters"].values())).reshape(3, 3)
    # what rotations cannot show is as small as the rest, and known as well
    assert abs(np.trace(G)) / 3 < np.abs(G).max()
    assert block["effects"][0]["std"]["G00"] < 3 * block["effects"][0]["std"]["G01"]


@pytest.mark.parametrize("board", BOARDS)
@pytest.mark.parametrize("sensor", ["accelerometer", "gyroscope"])
def test_mpu9150_has_no_g_sensitivity_and_no_polynomial_term(measured_results, board, sensor):
    block = part(measured_results, f"mpu9150_{board}", sensor)
    assert not {"g_sensitivity", "g2_sensitivity", *POLYNOMIAL} & set(names(block))
    for name in POLYNOMIAL & set(candidates(block)):
        assert np.all(np.abs(sizes(candidates(block)[name])) < 3)
    # a drift, if declared, stands the held-out test
    assert all(effect["ratio_ci95"][1] < 1 for effect in block["effects"])


@pytest.mark.study
def test_climate_chamber_is_temperature_and_its_past(measured_results):
    block = part(measured_results, "thermal_chamber", "accelerometer", "static_record")
    assert names(block)[0] == "bias_temperature"
    assert {"bias_temperature_rate", "thermal_hysteresis"} & set(names(block)[1:])
    z = block["residuals"]["bias"]["sessions"]["static"]["az"]
    assert z["before"] > 0.15
    assert z["after"] <= 0.035


def test_the_error_of_the_vertical_over_a_rotation_falls_three_fold(measured_results):
    attitude = measured_results.json("xsens_mti", "attitude")
    rotation = attitude["methods"]["rotation"]
    assert rotation["n"] == 37
    assert all(effects["gyroscope"][:1] == ["g_sensitivity"] for effects in attitude["effects"])
    assert rotation["base_over_final"] >= 3
    assert rotation["ratio_ci95"][0] > 2.5
    # the remainder is little more than the noise
    assert rotation["models"]["final"]["rms_deg"] < 1.5 * rotation["floor_deg"]
    # a filter that estimates a bias itself does not make up for the effect
    filtered = attitude["methods"]["filter"]
    assert filtered["n"] == rotation["n"] and filtered["ratio_ci95"][0] > 2
