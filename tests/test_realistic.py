"""bench/realistic: closed forms of the generator, the plain fit, the judge.

A study is as good as its truth: each test compares one part of it with the expected value.
"""

import ast

import numpy as np
import pytest

import imuloop
from bench.realistic.device import CHANNELS, record
from bench.realistic.judge import errors, outcome
from bench.realistic.plain import fit
from quick import hurry

# a short log of few samples
FEW = 46


def sense(log):
    f, w = (
        np.column_stack([log.columns[n] for n in names]) for names in (CHANNELS[:3], CHANNELS[3:])
    )
    return log.columns["t"], f, w


# the study is blind only as long as neither knows imuloop
@pytest.mark.parametrize("name", ["device", "plain"])
def test_generator_and_plain_fit_share_no_code_with_imuloop(repository, name):
    tree = ast.parse((repository / f"bench/realistic/{name}.py").read_text())
    froms = [n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]
    names = [a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names]
    allowed = ("numpy", "scipy", "bench.realistic.device", *"json dataclasses functools".split())
    assert froms and all(n.startswith(allowed) for n in froms + names)


# the truth must not come from the plain fit
def test_plain_fit_of_a_log_without_noise_gives_the_truth():
    log = record(FEW, noise=False)
    t, f, w = sense(log)
    accelerometer, gyroscope = fit(t, f, w, log.rests)
    for fitted, true, near in (
        (accelerometer, log.accelerometer, 1e-7),
        (gyroscope, log.gyroscope, 1e-5),
    ):
        for name in "TKb":
            assert getattr(fitted, name) == pytest.approx(getattr(true, name), abs=near), name
    error = errors(log, lambda f, w, t, _: (accelerometer.corrected(f), gyroscope.corrected(w)))
    assert error["accelerometer"] < 1e-6 and error["gyroscope"] < 2e-5
    # three rests do not determine nine parameters
    assert fit(t, f, w, log.rests[:3]) == (None, None)


def test_what_a_device_leaves_that_moves_at_rest_is_no_effect(tmp_path):
    """With another error of the angular rate, rad/s, in each move it cannot be told from this."""
    log, rng = record(14, "settle"), np.random.default_rng(1)
    t = log.columns["t"]
    for (_, start), (end, _) in zip(log.rests, log.rests[1:], strict=False):
        for name in CHANNELS[3:]:
            log.columns[name][(t > start) & (t < end)] += 3e-3 * rng.normal()
    log.write(tmp_path / "log.csv")
    with hurry("imu"):
        result = imuloop.calibrate(tmp_path / "log.csv", name="imu", progress=False)
    poses = result.diagnosis["sensors"]["gyroscope"]["poses"]
    assert poses["verdict"] == "not_testable" and "the device moved in 1" in poses["why"]
    # nothing is said of the first half minute at rest: it is not a static record
    still = result.diagnosis["sensors"]["accelerometer"]["static_record"]
    assert still["verdict"] == "not_testable" and "no rest of 10 minutes" in still["why"]


# nine parameters of gravity's norm they determine badly; with the turns between them well
@pytest.mark.parametrize("case", ["faces", "lossy"])
def test_a_calibration_is_as_good_as_the_plain_fit(tmp_path, case):
    log = record(FEW, case)
    log.write(tmp_path / "log.csv")
    with hurry("imu"):
        result = imuloop.calibrate(tmp_path / "log.csv", name="imu", progress=False)
    figures = outcome(log, result)
    assert max(figures["ratios"].values()) < (0.5 if case == "faces" else 1.5)
    pulled = [abs(pull) for sensor in figures["pulls"].values() for pull in sensor.values()]
    assert len(pulled) == 21 and max(pulled) < 4
    motion = result.diagnosis["sensors"]["gyroscope"]["motion"]
    assert motion["verdict"] == ("consistent" if case == "faces" else "not_testable")
    assert ("log every sample" in motion.get("why", "")) == (case == "lossy")
    # rows that are lost make no rate too small
    assert not [note for note in figures["notes"] if "off by as much" in note]
