"""Beside a reference: what nobody declared is found, with its size, and nothing else."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from bench.study.reference import base, diagnosed
from imuloop.calibrate.accelerometer import NAMES
from imuloop.calibrate.least_squares import FitResult, Solution
from imuloop.calibrate.reference.sensors import Accelerometer
from imuloop.core.effect import Channels, find_effect
from imuloop.core.model import Calibration, SensorCalibration
from imuloop.core.units import RawUnit
from imuloop.diagnose.records.one_solution import with_reference
from imuloop.diagnose.records.reference import ReferenceResult
from imuloop.simulate.reference import Beside, simulate_beside

SEED = 12170
QUATERNION = ["qw", "qx", "qy", "qz"]


def found(diagnosis):
    return {
        sensor: {e["name"]: e for e in parts["reference"]["effects"]}
        for sensor, parts in diagnosis["sensors"].items()
    }


def off(effect, truth):
    pairs = zip(effect["parameters"].values(), effect["std"].values(), truth, strict=True)
    return [abs(value - true) / std for value, std, true in pairs]


def errors(of, truth, sensor):
    """Return how far T and K of a calibration are from the truth, in standard errors."""
    true = {f"T{i}{j}": truth.T[sensor][i, j] for i in range(3) for j in range(3) if i != j}
    own = {name: of.T[int(name[1]), int(name[2])] for name in true}
    true |= {f"K{k}": truth.K[sensor][k] for k in range(3)}
    own |= {f"K{k}": of.K[k] for k in range(3)}
    return [(own[name] - true[name]) / of.std[name] for name in true if name in of.std]


def test_offset_drift_and_arm_are_found_alone_and_in_size():
    # late all along: an offset that drift takes through zero is no offset, alone
    own = {"gyroscope": -0.009, "accelerometer": 0.003}
    truth = replace(base(SEED), dt=own, drift=1e-4, arm=(0.02, -0.015, 0.03))
    diagnosis, _, calibration = diagnosed(truth, SEED, limits=False)
    effects = found(diagnosis)
    assert set(effects["gyroscope"]) == {"time_offset", "clock_drift"}
    assert set(effects["accelerometer"]) == {"time_offset", "lever_arm"}
    assert max(off(effects["gyroscope"]["time_offset"], [-0.009])) < 3
    assert max(off(effects["gyroscope"]["clock_drift"], [1e-4])) < 3
    assert max(off(effects["accelerometer"]["time_offset"], [0.003])) < 3
    assert max(off(effects["accelerometer"]["lever_arm"], truth.arm)) < 3.5
    # where a marker sits is nothing of the sensor's
    assert not calibration.effects
    for sensor in effects:
        of = getattr(calibration, sensor)
        assert of.method == "reference_motion"
        assert np.abs(errors(of, truth, sensor)).max() < 3.5
    # over longer times errors grow, and effects make them less
    table = diagnosis["sensors"]["gyroscope"]["reference"]["by_duration"]
    assert [row["seconds"] for row in table] == [0.1, 0.3, 1.0, 3.0, 10.0]
    for row in table[2:]:
        sizes = [row[k]["rotation"] for k in ("logged", "calibrated", "final", "floor")]
        assert sizes == sorted(sizes, reverse=True)
        assert row["final"]["vertical"] < row["final"]["rotation"]
    series = diagnosis["sensors"]["gyroscope"]["reference"]["series"]
    assert series["t_s"][-1] - series["t_s"][0] == pytest.approx(10.0, abs=0.1)
    for vertical in ("reference", "sensor"):
        np.testing.assert_allclose(np.linalg.norm(series[vertical], axis=1), 1, atol=1e-5)
    apart = np.linalg.norm(np.subtract(series["reference"], series["sensor"]), axis=1)
    assert (apart <= np.array(series["final"]) + 1e-5).all()
    means = [np.mean(np.square(series[k])) for k in ("logged", "calibrated", "final")]
    assert means == sorted(means, reverse=True)


def test_arm_and_offset_are_fitted_together_each_in_its_session():
    """Protects T and K from a set-up whose parts do not pass alone: what belongs to it is fitted.

    One session turns and shows the arm, the other is carried and shows the offset. Tried one after
    the other, the arm was not found here, and T and K took it up.
    """

    def by_session(truth, seed):
        k = len(np.atleast_1d(seed)) - 1
        sizes = {"TURNS": (2.0, 0.5)[k], "PLACES": (0.03, 0.2)[k]}
        with patch.multiple("imuloop.simulate.reference", **sizes):
            return simulate_beside(truth, seed)

    seed, arm, late = 4, (0.002, -0.001, 0.006), {"accelerometer": -0.0015}
    truth = replace(base(seed), duration_s=16.0, dt=late, arm=arm, place_noise=3e-4)
    with (
        patch("imuloop.discover.search.search_formulas", return_value=None),
        patch("bench.study.reference.simulate_beside", by_session),
    ):
        diagnosis, _, calibration = diagnosed(truth, seed, limits=False, sessions=2)
    effects = found(diagnosis)["accelerometer"]
    assert set(effects) == {"time_offset", "lever_arm"}
    assert max(off(effects["time_offset"], late.values())) < 3.5
    assert max(off(effects["lever_arm"], arm)) < 3.5
    for effect in effects.values():
        assert effect["heldout_after"] < effect["heldout_before"]
        assert effect["ratio_ci95"][1] < 1
    assert np.abs(errors(calibration.accelerometer, truth, "accelerometer")).max() < 3


def test_axes_that_predict_nothing_better_stay_nominal():
    """Protects parameters that are as the data sheet has them: fitted, they were always written.

    An offset and an arm are found all the same, and a bias that data show is written.
    """
    arm, late = (0.02, -0.015, 0.03), {"gyroscope": -0.009, "accelerometer": 0.003}
    truth = Beside(duration_s=30.0, dt=late, arm=arm)
    with patch("imuloop.discover.search.search_formulas", return_value=None):
        diagnosis, _, calibration = diagnosed(truth, SEED, limits=False)
    effects = found(diagnosis)
    assert set(effects["accelerometer"]) == {"time_offset", "lever_arm"}
    assert set(effects["gyroscope"]) == {"time_offset"}
    for sensor in effects:
        of = getattr(calibration, sensor)
        np.testing.assert_array_equal(of.T, np.eye(3))
        np.testing.assert_array_equal(of.K, 1.0)
        assert "do not lower the error of held-out data" in of.not_testable
        assert of.names == ("b0", "b1", "b2")
        assert (np.abs(of.b) > 3 * np.sqrt(np.diag(of.covariance))).any()


@pytest.mark.parametrize("axes", [None, "T and K predict nothing better"])
@pytest.mark.parametrize(("sigmas", "written"), [(1.2, False), (4.0, True)])
def test_a_bias_that_chance_gives_is_not_written(axes, sigmas, written):
    """Protects the bias as it is known otherwise from one of 1.2 standard errors."""
    std, x = 0.01, np.array([0.001, 0.0, 0.0, 1.002, 1.0, 1.0, 0.0, 0.0, 0.0])
    fit = FitResult(x, np.eye(9) * 1e-8, 0.0, 1, np.zeros((0, 9)), np.zeros(0))
    known = SensorCalibration.nominal(RawUnit("g", 9.81, 0.0), "nothing else was recorded")
    result = ReferenceResult(
        {"verdict": "explained"},
        sensor=Accelerometer(None, 9.81, known),
        solution=Solution((), fit),
        covariance=fit.covariance,
        no_axes=axes,
        sessions=np.array([[sigmas * std, 0.0, 0.0, 0.0, 0.0, 0.0]]),
        variance=np.full(6, std**2),
    )
    calibration = Calibration("imu", 9.81, known, known)
    own = with_reference(calibration, {"accelerometer": result}).accelerometer
    assert own.b[0] == pytest.approx(written * sigmas * std / 9.81, abs=1e-12)
    assert own.not_testable == axes
    assert own.K[0] == pytest.approx(9.81 * (1.0 if axes else 1.002))
    names = ("b0", "b1", "b2") if written else ()
    assert own.names == (names if axes else (*NAMES[:6], "b0", "b1", "b2"))


def test_an_unexplained_accelerometer_is_not_written_and_turns_no_gyroscope():
    """Protects what is written: a fit that leaves what nothing explains is no calibration.

    The marker's mount sags with attitude, by 1 cm, which no effect describes. The accelerometer
    that fits best then absorbs some of it, and its axes are no frame for the gyroscope.
    """

    def harm(columns):
        q = np.column_stack([columns[k] for k in ("qx", "qy", "qz", "qw")])
        known = np.isfinite(q[:, 0])
        attitude = Rotation.from_quat(q[known])
        x, y, z = attitude.inv().apply([0.0, 0.0, 1.0]).T
        sag = np.full((len(q), 3), np.nan)
        sag[known] = attitude.apply(0.01 * np.column_stack([abs(x) * y, z**3, 2 * x * y * z]))
        return columns | {f"p{k}": columns[f"p{k}"] + sag[:, i] for i, k in enumerate("xyz")}

    truth = replace(base(SEED), duration_s=40.0)
    with patch("imuloop.discover.search.search_formulas", return_value=None):
        diagnosis, _, calibration = diagnosed(truth, SEED, limits=False, change=harm)
    # the diagnosis says what it found
    block = diagnosis["sensors"]["accelerometer"]["reference"]
    assert block["verdict"] == "unexplained"
    left = block["residuals"]["reference_force"]
    assert left["after"] > left["floor"]
    force, turn = calibration.accelerometer, calibration.gyroscope
    assert (force.method, force.names, force.effects) == ("nominal", (), ())
    assert f"{left['after']:.3g} m/s^2" in force.not_testable
    np.testing.assert_array_equal(force.T, np.eye(3))
    np.testing.assert_array_equal(force.aligned(np.eye(3)), np.eye(3))
    # of the gyroscope's axes the reference shows all but how they lie in the accelerometer's
    assert turn.method == "reference_motion"
    assert np.abs(errors(turn, truth, "gyroscope")).max() < 3
    np.testing.assert_allclose(turn.T, turn.T.T, atol=1e-12)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        mean = np.array([n in (f"T{i}{j}", f"T{j}{i}") for n in turn.names]) / 2
        std = np.sqrt(mean @ turn.covariance @ mean)
        true = (truth.T["gyroscope"] + truth.T["gyroscope"].T)[i, j] / 2
        assert abs(turn.T[i, j] - true) < 3 * std < 0.01


# from -4 to 4 ms within the log, and from -4 to 8: neither alone lowers the error of all parts
@pytest.mark.study
@pytest.mark.parametrize(
    "truth",
    [{"clock_drift": 6.7e-5}, {"clock_drift": 1e-4, "time_offset": 2e-3}],
)
def test_offset_that_drifts_through_zero_is_named(truth):
    late = {"gyroscope": truth.get("time_offset", 0.0)}
    device = replace(base(SEED), dt=late, drift=truth["clock_drift"])
    effects = found(diagnosed(device, SEED, limits=False)[0])["gyroscope"]
    assert set(effects) == set(truth)
    for name, true in truth.items():
        assert max(off(effects[name], [true])) < 3


def test_what_a_reference_gets_wrong_with_attitude_is_no_effect():
    def harm(columns):
        q = np.column_stack([columns[k] for k in ("qx", "qy", "qz", "qw")])
        known = np.isfinite(q[:, 0])
        attitude = Rotation.from_quat(q[known])
        u = attitude.as_matrix().reshape(-1, 9)
        # half a degree that goes with the attitude, as where other markers are seen
        pattern = np.random.default_rng(5).normal(size=(9, 3))
        error = np.radians(0.5) * np.sin(2.5 * u @ pattern)
        q[known] = (attitude * Rotation.from_rotvec(error)).as_quat()
        return columns | dict(zip(("qx", "qy", "qz", "qw"), q.T, strict=True))

    truth = replace(base(SEED), duration_s=40.0)
    diagnosis, *_ = diagnosed(truth, SEED, limits=False, change=harm)
    effects = found(diagnosis)
    assert effects == {"accelerometer": {}, "gyroscope": {}}
    verdict = diagnosis["sensors"]["gyroscope"]["reference"]["verdict"]
    assert verdict == "unexplained"


# by 500 ppm
@pytest.mark.study
@pytest.mark.parametrize(
    ("clock", "drift"),
    [((3.0, 0.0), 0.0), ((0.0, 5e-4), 5e-4)],
)
def test_clock_of_its_own_is_handled_or_named(clock, drift):
    diagnosis, quality, _ = diagnosed(replace(base(SEED), clock=clock), SEED, limits=False)
    effects = found(diagnosis)["gyroscope"]
    assert quality["reference"]["clock"]["own"] == bool(clock[0])
    assert ("clock_drift" in effects) == bool(drift)
    if drift:
        assert max(off(effects["clock_drift"], [drift])) < 3


@pytest.mark.study
def test_rests_beside_a_reference_are_poses_of_one_solution():
    truth = replace(base(SEED), rests=16, duration_s=240.0)
    diagnosis, _, calibration = diagnosed(truth, SEED, limits=False)
    for sensor, parts in diagnosis["sensors"].items():
        of = getattr(calibration, sensor)
        assert of.method == "multi_position"
        assert parts["motion"]["verdict"] == parts["reference"]["verdict"] == "consistent", sensor
        assert np.abs(errors(of, truth, sensor)).max() < 3.5
    # better known than by motion alone, in which nothing is found either
    alone, _, by_motion = diagnosed(replace(truth, rests=0), SEED, limits=False)
    assert "1 pose found" in alone["sensors"]["accelerometer"]["poses"]["why"]
    for sensor, parts in alone["sensors"].items():
        assert parts["reference"]["verdict"] == "consistent", sensor
    assert by_motion.gyroscope.method == "reference_motion"
    for name in ("K0", "K1", "K2"):
        assert calibration.gyroscope.std[name] < by_motion.gyroscope.std[name]


@pytest.mark.study
def test_arm_of_each_axis_is_found_and_applied():
    arm = np.array([[0.05, 0.0, 0.01], [0.0, 0.04, -0.01], [0.01, 0.0, -0.02]])
    truth = replace(base(SEED), arm=arm, duration_s=40.0)
    diagnosis, _, calibration = diagnosed(truth, SEED, limits=False, sessions=3)
    effects = found(diagnosis)["accelerometer"]
    assert set(effects) == {"lever_arm", "size_effect"}
    # from the marker to the z axis, and from there
    assert max(off(effects["lever_arm"], arm[2])) < 3.5
    assert max(off(effects["size_effect"], (arm[:2] - arm[2]).ravel())) < 3.5
    (own,) = calibration.accelerometer.effects
    assert own.effect == find_effect("lever_arm")()
    assert own.values == effects["size_effect"]["parameters"]
    # as a calibration is applied
    t = np.arange(0, 2, 0.01)
    turning = np.column_stack([np.sin(3 * t), np.cos(2 * t), 0.3 * t])
    samples = {"t": t} | dict.fromkeys(("ax", "ay", "az"), 0.0 * t)
    samples |= dict(zip(("gx", "gy", "gz"), turning.T, strict=True))
    still = replace(calibration.accelerometer, effects=())
    parts = (calibration, replace(calibration, accelerometer=still))
    with_arms, without = (
        np.column_stack([c.apply(pd.DataFrame(samples))[k] for k in ("ax", "ay", "az")])
        for c in parts
    )
    w = calibration.gyroscope.aligned(turning)
    e = own.output(Channels(t, 0 * w, w))
    np.testing.assert_allclose(without - with_arms, e @ still.T.T, atol=1e-9)
