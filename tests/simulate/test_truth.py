"""Reading a truth: what it holds, and what is said where it is wrong."""

from functools import reduce

import numpy as np
import pytest
import yaml

from imuloop.core.errors import ImuloopError
from imuloop.simulate.truth import read_truth


def content():
    sensor = {"T": np.eye(3).tolist(), "K": [1, 1, 1], "b": [0, 0, 0]}
    return {
        "name": "one",
        "accelerometer": {
            "raw_unit": "m/s^2",
            "noise": {"N": ["1e-3", 2e-3, 3e-3], "gauss_markov": [{"q": [1, 2, 3], "tc": 9}]},
            **sensor,
        },
        "gyroscope": {"raw_unit": "deg/s", **sensor},
        "thermometer": {"lag_s": 20, "step": 0.1},
        "sessions": {
            "poses": {
                "kind": "multi_position",
                "vibration": {"share": 0.5, "rms": [0.1, 0.2], "frequency": [20, 40]},
            },
            "rest": {"kind": "static", "disturbances": [{"kind": "tilt", "time_s": 1, "size": 2}]},
        },
    }


def read(tmp_path, truth):
    path = tmp_path / "truth.yaml"
    path.write_text(yaml.safe_dump(truth))
    return read_truth(path)


def test_reads_what_is_written(tmp_path):
    truth = read(tmp_path, content())
    # YAML takes 1e-3 for text
    assert truth.accelerometer.noise.N.tolist() == [1e-3, 2e-3, 3e-3]
    assert truth.accelerometer.noise.gauss_markov[0].tc == 9
    assert truth.gyroscope.raw_unit == "deg/s" and truth.gravity == 9.80665
    assert truth.sessions["rest"].disturbances[0].size == 2
    assert truth.sessions["poses"].vibration.rms == [0.1, 0.2]
    assert truth.thermometer.lag_s == 20


ONE = {"name": "g_sensitivity", "parameters": {"G00": 1}}


@pytest.mark.parametrize(
    ("where", "value", "message"),
    [
        ("gravitiy", 9.8, "gravitiy: no such key; did you mean 'gravity'"),
        ("sessions.rest.kind", "statik", "sessions.rest.kind: 'statik' is not one of"),
        ("thermometer.lag", 1, "thermometer.lag: no such key; did you mean 'lag_s'"),
        ("sessions.poses.vibration.part", 1, "sessions.poses.vibration.part: no such key"),
        ("gyroscope.raw_unit", "deg", "gyroscope.raw_unit: 'deg' is not one of"),
        ("gyroscope.K", [1, 1], r"gyroscope.K: shape \(2,\), needs \(3,\)"),
        ("gyroscope.noise", {"X": [1, 1, 1]}, "gyroscope.noise.X: no such key"),
        ("gyroscope.effects", [ONE | {"name": "g_sens"}], "'g_sens' is not an effect"),
        ("gyroscope.effects", [ONE], "effects: effect g_sensitivity: its parameters are"),
        ("sessions", None, "not a truth"),
    ],
)
def test_says_what_is_wrong(tmp_path, where, value, message):
    truth = content()
    *path, last = where.split(".")
    reduce(dict.get, path, truth)[last] = value
    with pytest.raises(ImuloopError, match=message) as caught:
        read(tmp_path, truth)
    assert "\n" not in str(caught.value)
