"""What is a device's own, what all see alike, and what nobody can say."""

import json

import numpy as np
import pytest
from scipy.stats import kstest

from board.boards import NAMES, calibrated, logs, slipped
from imuloop.board.agreement import Reading, mean, own_parts
from imuloop.board.board import relate
from imuloop.report.tables.board import board_part
from imuloop.simulate.truth import example_truth

TRUTH = example_truth(rate=50.0)


def verdicts(content, kind):
    return {name: device[kind]["verdict"] for name, device in content["devices"].items()}


@pytest.fixture
def devices(board):
    return board(1)[1]


@pytest.fixture
def wrong(devices):
    """Return a function: board.json of some devices, a sensor of the second of which is changed."""
    path = devices[1].file("calibration.json")
    sound = path.read_text()

    def of(some, sensor, scale=1.0, **other):
        content = json.loads(sound)
        content[sensor] |= {"K": [scale * k for k in content[sensor]["K"]], **other}
        path.write_text(json.dumps(content))
        return relate("wing", some)

    yield of
    path.write_text(sound)


@pytest.mark.parametrize(
    ("sensor", "factor", "kind", "other"),
    [("gyroscope", 1.01, "turn", "gravity_norm"), ("accelerometer", 1.002, "gravity_norm", "turn")],
)
def test_a_wrong_scale_is_that_devices_own(devices, wrong, sensor, factor, kind, other):
    content = wrong(devices, sensor, factor)
    found = verdicts(content, kind)
    assert found.pop("second") == "own"
    assert set(found.values()) <= {"consistent", "undecided"}
    assert "own" not in verdicts(content, other).values()
    # of a mean turn of 2 rad, and of g
    error, floor = (content["devices"]["second"][kind][name] for name in ("error", "floor"))
    assert error > 5 * floor
    assert {test["verdict"] for test in content["common"].values()} == {"consistent"}


def test_of_two_that_differ_nobody_can_say_which_is_wrong(devices, wrong):
    content = wrong(devices[:2], "gyroscope", 1.01)
    assert set(verdicts(content, "turn").values()) == {"undecided"}
    assert "third" in content["devices"]["first"]["turn"]["why"]
    # half of the error would pass for common
    assert content["common"]["closure"]["verdict"] == "undecided"


def test_a_sensor_that_is_not_calibrated_is_not_judged_nor_a_judge(devices, wrong):
    unknown = {"covariance": {"names": [], "matrix": []}, "not_testable": "too few"}
    found = wrong(devices, "gyroscope", **unknown)
    assert [*verdicts(found, "turn").values()] == ["consistent", "not_testable", "consistent"]
    assert found["devices"]["second"]["turn"]["why"] == "too few"
    rows = board_part(found, dict.fromkeys(NAMES, ""))["table"].rows
    assert rows[1][3] == "not testable: too few"
    # of the two others one alone
    alone = relate("wing", devices[:2])
    for test in (alone["devices"]["first"]["turn"], alone["common"]["closure"]):
        assert test["verdict"] == "not_testable"


def test_what_all_see_alike_is_no_sensors_fault(tmp_path):
    """A knock between two samples turns the board: no gyroscope sees it."""
    content = relate("wing", calibrated(tmp_path, logs(1, changed=slipped(TRUTH, 1, 0.3))))
    closure = content["common"]["closure"]
    assert closure["verdict"] == "common" and closure["error"] > 10 * closure["floor"]
    assert set(verdicts(content, "turn").values()) == {"consistent"}
    assert "own" not in verdicts(content, "gravity_norm").values()


def noisy(rng, n, size=1.0):
    """Return the reading of noise of a covariance."""
    root = rng.normal(size=(n, n))
    covariance = size**2 * (root @ root.T + n * np.eye(n))
    return Reading(rng.multivariate_normal(np.zeros(n), covariance), covariance, covariance)


def test_p_values_of_noise_are_even():
    rng, found = np.random.default_rng(0), []
    for _ in range(300):
        readings = {name: noisy(rng, 5, size) for name, size in zip(NAMES, (1, 2, 3), strict=True)}
        parts, _ = own_parts(readings, 0.0)
        found.append([parts[name].p_value for name in NAMES] + [mean(readings.values()).p_value])
    for p in np.transpose(found):
        assert kstest(p, "uniform").pvalue > 1e-3


def test_the_device_that_differs_is_left_out_of_the_others():
    rng = np.random.default_rng(1)
    readings = {name: noisy(rng, 5) for name in ("a", "b", "c", "d")}
    wrong = readings["c"]
    readings["c"] = Reading(wrong.values + 100, wrong.noise, wrong.covariance)
    parts, agreeing = own_parts(readings, 0.01)
    assert agreeing == ["a", "b", "d"]
    assert parts["c"].p_value < 1e-6 < min(parts[name].p_value for name in agreeing)


def test_an_error_of_the_calibration_is_no_error_beside_it():
    pattern = np.linspace(1, 2, 6)
    noise = 0.01 * np.eye(6)
    known = Reading(3 * pattern, noise, noise + 4 * np.outer(pattern, pattern))
    assert known.p_value > 0.1 and known.error < 0.1
    assert Reading(3 * pattern, noise, noise).p_value < 1e-6
