"""Calibration files of any content: one clear line, or a right result, of every command."""

import copy
import json
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from calibrated import calibrated_device
from imuloop.__main__ import main
from imuloop.core.samples import CHANNELS
from imuloop.model.effect import FittedEffect, find_effect

MISSING = object()
SENSOR_KEYS = "raw_unit raw_scale raw_offset method T K b covariance effects".split()


@pytest.fixture(scope="module")
def device(tmp_path_factory):
    """A folder with the log of a simulated device and its calibration, an effect a sensor."""
    folder = tmp_path_factory.mktemp("device")
    made = calibrated_device(folder, 16, 10.0, 1)
    log = pd.read_csv(folder / "1.csv")
    log.assign(temperature=20.0 + 0.01 * log["t"]).to_csv(folder / "log.csv", index=False)
    effects = (effect_of("warm_up", tau=100.0), effect_of("bias_temperature"))
    replace(
        made,
        accelerometer=replace(made.accelerometer, effects=effects),
        gyroscope=replace(made.gyroscope, effects=(effect_of("g_sensitivity"),)),
    ).to_json(folder / "calibration.json")
    return folder


def effect_of(name, **constants):
    effect = find_effect(name)(**constants)
    values = dict.fromkeys(effect.parameters, 1e-5)
    return FittedEffect(effect, values, dict.fromkeys(values, 1e-6))


def put(path, value):
    *parents, last = [int(key) if key.isdigit() else key for key in path.split(".")]

    def change(content):
        part = content
        for key in parents:
            part = part[key]
        if value is MISSING:
            del part[last]
        else:
            part[last] = value(part[last]) if callable(value) else value

    return change


def every(*changes):
    def change(content):
        for each in changes:
            each(content)

    return change


def matrix(function):
    """Return a function that changes the gyroscope's covariance as an array."""
    return put("gyroscope.covariance.matrix", lambda rows: function(np.array(rows)).tolist())


def set_element(i, j, value):
    def change(C):
        C[i, j] = value
        return C

    return change


A, G = "accelerometer", "gyroscope"
TEMPERATURE, WARM = f"{A}.effects.1", f"{A}.effects.0"
NO_PATTERN = {"name": "lever_arm", "parameters": {f"r{i}{j}": 0.0 for i in "xyz" for j in "xyz"}}
SINGULAR = [[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]]

# changes of a calibration that have to be refused
WRONG = {
    **{f"no {key}": put(key, MISSING) for key in ("format", "device", "gravity", A, G)},
    **{f"no {key}": put(f"{A}.{key}", MISSING) for key in SENSOR_KEYS},
    "no covariance.names": put(f"{G}.covariance.names", MISSING),
    "format 2": put("format", 2),
    "unknown key": put("speed", 1.0),
    "gravity negative": put("gravity", -9.8),
    "unit of the other sensor": every(
        put(f"{A}.raw_unit", "deg/s"), put(f"{A}.raw_scale", np.pi / 180)
    ),
    "method unknown": put(f"{A}.method", "magic"),
    "T singular": put(f"{G}.T", SINGULAR),
    "T lower triangular": put(f"{A}.T.1.0", 0.01),
    "K a thousandfold": put(f"{A}.K.1", 1000.0),
    "b NaN": put(f"{G}.b.0", float("nan")),
    "matrix not symmetric": matrix(lambda C: C + np.triu(C, 1)),
    "matrix with a negative variance": matrix(set_element(4, 4, -1e-9)),
    "matrix of correlations above one": matrix(
        lambda C: np.diag(np.diag(C)) * 3 - 2 * np.sqrt(np.outer(np.diag(C), np.diag(C)))
    ),
    "effect unknown": put(f"{WARM}.name", "magic"),
    "effect of the other sensor": put(f"{G}.effects.0", effect_of("quadratic").to_dict()),
    "effect without pattern": put(f"{A}.effects", [NO_PATTERN]),
    "effect twice": put(f"{A}.effects", lambda effects: effects + effects[:1]),
    "effect tau negative": put(f"{WARM}.constants.tau", -100.0),
}
# what may be refused or give a right result, but nothing that is not finite
ODD = {
    "device that a terminal obeys": put("device", "\x1b[31m\r\x07"),
    "counts of a huge scale": every(
        put(f"{A}.raw_unit", "count"), put(f"{A}.raw_scale", 1e300), put(f"{A}.K", [1e300] * 3)
    ),
    "one covariance 1e300": matrix(lambda C: set_element(3, 2, 1e300)(set_element(2, 3, 1e300)(C))),
    "effect 1e300": put(f"{WARM}.parameters.Ax", 1e300),
    "T oblique": put(f"{G}.T.0.1", 2.0),
}
TEXT = b'{"format": 1, "device": "d", "gravity": 9.8, '
# files without any JSON of a calibration
FILES = {
    "empty": b"",
    "no JSON": b"{",
    "key twice": TEXT + b'"gravity": 1.0}',
    "NaN": TEXT + b'"x": NaN}',
    "10000 deep": TEXT + b'"x": ' + b"[" * 10_000 + b"]" * 10_000 + b"}",
    "3 MB of numbers": TEXT + b'"accelerometer": [' + b"1," * 1_500_000 + b'1], "gyroscope": 1}',
}


def outcome(arguments, capfd):
    """Run a command; return its status, after looking at its output."""
    status = main([str(a) for a in arguments])
    said = capfd.readouterr()
    text = said.out + said.err
    assert "Traceback" not in text and "Warning" not in text
    assert all(line.isprintable() for line in text.split("\n"))
    if status == 1:
        assert said.out == "" and said.err.startswith("imuloop: ")
        assert said.err.count("\n") == 1 and len(said.err) < 600
        assert "calibration.json: " in said.err or "log.csv: " in said.err
    else:
        assert said.err == "" and not re.search(r"\b(nan|inf)\b", said.out)
    return status


@pytest.fixture
def statuses(device, tmp_path, capfd):
    """Run all commands with a calibration; return their statuses."""

    def call(path):
        out, drift, log = tmp_path / "out.csv", tmp_path / "drift.json", device / "log.csv"
        applied = outcome(["apply", path, log, "-o", out], capfd)
        assert out.exists() == (applied == 0)
        if applied == 0:
            values = pd.read_csv(out)
            assert np.isfinite(values[list(CHANNELS)].to_numpy()).all()
        path.with_name("noise.json").write_bytes((device / "noise.json").read_bytes())
        checked = outcome(["check", path, log, "--json", drift], capfd)
        assert drift.exists() == (checked in (0, 3))
        return applied, checked, outcome(["info", path], capfd)

    return call


def test_the_calibration_is_good(device, statuses):
    assert statuses(device / "calibration.json") == (0, 0, 0)


def write_change(device, tmp_path, change):
    content = json.loads((device / "calibration.json").read_text())
    change(content := copy.deepcopy(content))
    path = tmp_path / "calibration.json"
    path.write_text(json.dumps(content))
    return path


@pytest.mark.parametrize("change", WRONG.values(), ids=WRONG.keys())
def test_what_is_no_calibration_is_refused(device, tmp_path, statuses, change):
    assert statuses(write_change(device, tmp_path, change)) == (1, 1, 1)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("change", ODD.values(), ids=ODD.keys())
def test_what_is_odd_gives_nothing_that_is_not_finite(device, tmp_path, statuses, change):
    assert {*statuses(write_change(device, tmp_path, change))} <= {0, 1, 3}


@pytest.mark.parametrize("content", FILES.values(), ids=FILES.keys())
def test_a_file_that_holds_none_is_refused(tmp_path, statuses, content):
    path = tmp_path / "calibration.json"
    path.write_bytes(content)
    assert statuses(path) == (1, 1, 1)


@pytest.mark.parametrize(
    "make",
    [Path.mkdir, os.mkfifo, lambda path: path.symlink_to("/dev/zero"), lambda path: None],
    ids=["folder", "pipe", "device", "gone"],
)
def test_what_is_no_file_is_refused(tmp_path, statuses, make):
    make(path := tmp_path / "calibration.json")
    assert statuses(path) == (1, 1, 1)
