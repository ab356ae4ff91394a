"""A device with an effect that the library lacks: from its logs to calibration and effect file."""

import os
import shutil
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bench.study.chain import diagnosis_of
from bench.study.devices import motion_device, poses_device, record_device
from imuloop.core.errors import ImuloopError
from imuloop.core.model import Calibration
from imuloop.discover.propose import proposed
from imuloop.report.composed import words
from imuloop.simulate.simulate import simulate_session
from result_files import fault

SEED = 11030
# of f_y² f_z on x, 1/(m/s²)²: 1 mg at most
SIZE = 3e-5


def extra(channels):
    found = np.zeros((len(channels.t), 3))
    found[:, 0] = SIZE * channels.output[:, 1] ** 2 * channels.output[:, 2]
    return found


def known(channels):
    """Return what the library has: a cubic of the accelerometer's axes, SI."""
    return 4e-6 * channels.output**3


def leaning(channels):
    """Return what the library has: a gyroscope's sensitivity to specific force on x."""
    return channels.other * [2e-4, 0.0, 0.0]


def warm_and_leaning(channels):
    """Return (T - mean) f_y on z."""
    warm = channels.temperature - channels.temperature.mean()
    return (2e-5 * warm * channels.other[:, 1])[:, None] * [0.0, 0.0, 1.0]


def turned_and_pulled(channels):
    """Return f_y w_x on z."""
    return (0.02 * channels.output[:, 1] * channels.other[:, 0])[:, None] * [0.0, 0.0, 1.0]


def results(truth, sessions, folder):
    calibration = Calibration.from_json(folder / "calibration.json")
    faults = [fault(folder / f"{name}.json") for name in ("diagnosis", "calibration")]
    return calibration, faults


@pytest.fixture(scope="module")
def made():
    truth = poses_device("few")
    truth = replace(truth, accelerometer=replace(truth.accelerometer, extra=extra))
    diagnosis, (calibration, faults) = diagnosis_of(truth, SEED, results, limits=False)
    return SimpleNamespace(truth=truth, diagnosis=diagnosis, calibration=calibration, faults=faults)


def test_the_formula_is_in_diagnosis_and_calibration(made):
    block = made.diagnosis["sensors"]["accelerometer"]["poses"]
    search = block["discovered"]
    assert made.faults == [None, None]
    assert search["status"] == "named" and block["verdict"] == "explained"
    # at rest f_y² f_z on x, f_x f_y f_z on y and f_x f_y² on z are one; gravity's direction, which
    # the gyroscope carries along, tells them apart
    assert search["formula"] == "x: fy^2*fz"
    assert {name[0] for name in search["imitators"]} <= {"x"}
    effect = block["effects"][-1]
    assert effect["name"] == "discovered" and effect["ratio_ci95"][1] < 1
    ((key, value),) = effect["parameters"].items()
    assert abs(value - SIZE) < 4 * effect["std"][key]
    assert effect["heldout_after"] < 0.6 * effect["heldout_before"]
    (fitted,) = made.calibration.accelerometer.effects
    assert fitted.values == effect["parameters"] and set(fitted.ranges) == {key}
    # by gravity with the formula; and what is consistent is not searched
    block = made.diagnosis["sensors"]["gyroscope"]["poses"]
    assert block["verdict"] == "consistent" and "discovered" not in block


def test_apply_takes_the_effect_out_of_another_log(made):
    samples = simulate_session(made.truth, "multi_position", SEED + 1)
    left = []
    without = replace(
        made.calibration, accelerometer=replace(made.calibration.accelerometer, effects=())
    )
    still = np.linalg.norm(samples[["gx", "gy", "gz"]] - [0.011, -0.017, 0.006], axis=1) < 0.005
    for calibration in (without, made.calibration):
        found = calibration.apply(samples)[["ax", "ay", "az"]].to_numpy()[still]
        error = np.linalg.norm(found, axis=1) - made.truth.gravity
        # means of two seconds, in which the motor and white noise are small
        means = error[: len(error) // 200 * 200].reshape(-1, 200).mean(axis=1)
        left.append(np.sqrt(np.mean(means**2)))
    assert left[1] < 0.8 * left[0]


@pytest.mark.study
def test_at_rest_what_slow_noise_could_take_up_is_found_by_what_attitudes_differ_in():
    truth = record_device()
    truth = replace(truth, gyroscope=replace(truth.gyroscope, extra=warm_and_leaning))
    diagnosis, (calibration, faults) = diagnosis_of(truth, SEED, results, limits=False)
    block = diagnosis["sensors"]["gyroscope"]["static_record"]
    assert faults == [None, None]
    assert block["discovered"]["formula"] == "z: fy*T" and block["verdict"] == "explained"
    found = {e.name: e for e in calibration.gyroscope.effects}["discovered"]
    assert abs(found.values["c0z"] / 2e-5 - 1) < 0.05
    residual = block["residuals"]["bias"]
    assert residual["after"] < 0.2 * residual["before"]


@pytest.mark.study
def test_in_motion_a_formula_takes_the_place_of_what_stood_for_it():
    truth = motion_device()
    truth = replace(truth, accelerometer=replace(truth.accelerometer, extra=turned_and_pulled))
    diagnosis, (calibration, faults) = diagnosis_of(truth, SEED, results, limits=False, motion=True)
    block = diagnosis["sensors"]["accelerometer"]["motion"]
    assert faults == [None, None] and block["verdict"] == "explained"
    assert block["discovered"]["formula"] == "z: fy*wx"
    assert [e["name"] for e in block["effects"]] == ["discovered"]
    assert [c["status"] for c in block["candidates"] if c["status"] == "added"] == []
    (found,) = calibration.accelerometer.effects
    assert abs(found.values["c0z"] - 0.02) < 4 * found.std["c0z"]
    # the other sensor's words are of the same moves
    assert diagnosis["sensors"]["gyroscope"]["motion"]["verdict"] == "explained"


@pytest.mark.study
def test_what_the_library_has_gets_its_name_and_no_formula():
    truth = poses_device("few")
    sensors = {"accelerometer": known, "gyroscope": leaning}
    truth = replace(truth, **{s: replace(getattr(truth, s), extra=e) for s, e in sensors.items()})
    diagnosis = diagnosis_of(truth, SEED, limits=False)
    names = {
        sensor: [effect["name"] for effect in records["poses"]["effects"]]
        for sensor, records in diagnosis["sensors"].items()
    }
    assert names == {"accelerometer": ["cubic"], "gyroscope": ["g_sensitivity"]}


@pytest.mark.parametrize(("upper", "said"), [(0.9, True), (1.1, False)])
def test_what_is_predicted_is_said_to_be_no_noise(upper, said):
    own = {"ratio": 0.7, "ratio_ci95": [0.4, upper]}
    search = {"status": "structure", "searched": 616, "residuals": {"rotation": own}}
    block = {"discovered": search, "slow_noise": True}
    assert ("Noise cannot be predicted" in words(block)) == said
    assert "Noise cannot" not in words(block | {"slow_noise": False})


def test_the_file_that_is_proposed_joins_the_library(made, tmp_path, repository):
    shutil.copytree(repository / "workflow/lib/imuloop", tmp_path / "imuloop")
    text, test = proposed(made.diagnosis, "twisted_beam")
    (tmp_path / "imuloop/effects/twisted_beam.py").write_text(text)
    (tmp_path / "test_twisted_beam.py").write_text("import imuloop.effects\n" + test)
    # as a job has it: nothing of this process
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir"]
    done = subprocess.run(
        [*command, tmp_path, "test_twisted_beam.py"],
        cwd=tmp_path, env=environment, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0 and "2 passed" in done.stdout, done.stdout + done.stderr
    places = "workflow/lib/imuloop/effects/twisted_beam.py", "tests/diagnose/test_twisted_beam.py"
    for place, content in zip(places, (text, test), strict=True):
        lint = [sys.executable, "-m", "ruff", "check", "-", "--stdin-filename", place]
        done = subprocess.run(lint, cwd=repository, input=content, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout


def test_without_a_formula_nothing_is_proposed(made):
    gyroscope = {"gyroscope": made.diagnosis["sensors"]["gyroscope"]}
    with pytest.raises(ImuloopError, match="no formula was found"):
        proposed({"device": "study", "sensors": gyroscope}, "name")
    with pytest.raises(ImuloopError, match="no name of an effect"):
        proposed(made.diagnosis, "Not a name")
