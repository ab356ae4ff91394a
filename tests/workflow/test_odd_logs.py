"""Logs that are odd but can be read: each stage has a result, and every number is one."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bench.fuzz.chain.cases import Case
from bench.fuzz.chain.judge import judge
from imuloop.core.samples import ACCELERATION, CHANNELS
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import example_truth


@pytest.fixture(scope="module")
def logs():
    truth = example_truth(rate=50.0)
    plans = {
        "static": replace(truth.sessions["static"], duration_s=60.0),
        "multi_position": replace(
            truth.sessions["multi_position"], poses=12, initial_rest_s=10.0, rest_s=(2.0, 3.0)
        ),
    }
    truth = replace(truth, sessions=plans)
    return {kind: simulate_session(truth, kind) for kind in plans}


@pytest.fixture
def faults(tmp_path):
    """Return a function: the faults of the results of logs by name, of kinds by name."""

    def of(kinds, tables):
        sessions = {}
        for name, table in tables.items():
            path = tmp_path / f"{name}.parquet"
            table.to_parquet(path)
            sessions[name] = {"kind": kinds[name], "file": str(path)}
        return judge(Case(0, {"sessions": sessions}, ()), tmp_path / "results")[1]

    return of


def test_without_noise_there_is_no_allan_curve_to_draw(logs, faults):
    # means of a second, held
    log = logs["static"].copy()
    log[list(CHANNELS)] = log[list(CHANNELS)].mean().to_numpy()
    log.loc[len(log) // 2 :, "ax"] += 0.1
    assert faults({"a": "static"}, {"a": log}) == []


def test_an_axis_without_noise_is_drawn_beside_two_with(logs, faults):
    log = logs["static"].assign(gx=-0.0276)
    assert faults({"a": "static", "b": "six_position"}, {"a": log, "b": log}) == []


def test_padding_with_zeros_is_no_rest(logs, faults, tmp_path):
    log = logs["multi_position"].copy()
    third = len(log) // 3
    log.loc[third : third + 500, list(CHANNELS)] = 0.0
    assert faults({"a": "multi_position"}, {"a": log}) == []
    segments = pd.read_parquet(tmp_path / "results/imu/a/segments.parquet")
    rests = segments[segments["kind"] == "static"]
    force = np.linalg.norm(rests[[f"{axis}_mean" for axis in ACCELERATION]], axis=1)
    assert len(rests) > 8 and (force > 9).all()


def test_one_sample_far_too_large_costs_one_rest(logs, faults, tmp_path):
    log = logs["multi_position"].copy()
    log.loc[300, "ay"] = 1e9
    assert (
        faults(
            {"a": "multi_position", "b": "multi_position"}, {"a": log, "b": logs["multi_position"]}
        )
        == []
    )
    rests = [
        (
            pd.read_parquet(tmp_path / f"results/imu/{name}/segments.parquet")["kind"] == "static"
        ).sum()
        for name in "ab"
    ]
    assert rests[1] >= 12 and abs(rests[0] - rests[1]) <= 1


def test_a_column_of_temperature_without_a_value_has_no_range(logs, faults):
    log = logs["static"].assign(temperature=np.nan)
    assert faults({"a": "static"}, {"a": log}) == []


def test_an_axis_that_stays_at_zero_has_no_noise_to_wait_for(logs, faults):
    log = logs["static"].copy()
    log.loc[len(log) // 3 :, "gx"] = 0.0
    log["gy"] = 0.0
    assert faults({"a": "static"}, {"a": log}) == []
