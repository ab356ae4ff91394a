"""The coach: from the first rest to done, with the σ that the calibration has at the end."""

import subprocess
import sys

import numpy as np
import pytest

from bench.study.chain import run_stages
from calibrate.devices import ACCELERATION_UNIT, RATE_UNIT, plan_session
from imuloop import chain
from imuloop.__main__ import main
from imuloop.core.rotation import shortest_turn
from imuloop.core.samples import SENSORS
from imuloop.model.calibration import Calibration
from imuloop.plan.coach import progress, rest_noise
from imuloop.plan.directions import largest_hole
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import example_truth
from plan.planned_log import simulate_plan

UNITS = ACCELERATION_UNIT, RATE_UNIT


@pytest.fixture(scope="module")
def samples():
    truth = plan_session(example_truth(rate=50.0), poses=16, initial_rest_s=60.0)
    return simulate_session(truth, "multi_position", 1)


def look(samples, seconds, **how):
    return progress(samples[samples["t"] < seconds], 9.80665, UNITS, **how)


def test_it_leads_from_the_first_rest_to_done(samples):
    assert look(samples, 10.0).advice == "leave it at rest, 40 s more"
    assert look(samples, 55.0).advice == "turn it to another attitude"
    few = look(samples, 100.0)
    assert 2 <= len(few.up) < 10 and not few.done
    assert few.advice.startswith("turn it until ") and few.advice.endswith("let go for 4 s")
    all_of_it = look(samples, 1e4, within=0.1)
    assert all_of_it.worst["accelerometer"] < few.worst["accelerometer"] < np.inf
    assert all_of_it.done and len(all_of_it.up) == 17


def read_advice(advice, now):
    """Return the turn that words ask for, its duration, s, and the side that is up after it."""
    if "360°" in advice:
        axis = np.eye(3)["xyz".index(advice.split("about ")[1][0])]
        level = np.roll(axis, 1)
        return [shortest_turn(now, level), 2 * np.pi * axis], [2.0, 5.0], level
    words = advice.removeprefix("turn it until ").split(" is up")[0].split("\u202f")
    up = sum((-1.0 if word[0] == "−" else 1.0) * np.eye(3)["xyz".index(word[1])] for word in words)
    return [shortest_turn(now, up)], [2.0], up / np.linalg.norm(up)


def test_whoever_follows_it_has_poses_enough_all_over_the_sphere():
    truth, up = example_truth(rate=50.0), np.array([0.0, 0.0, 1.0])
    turns, move_s, now = [[np.pi / 2, 0.0, 0.0]], [2.0], np.array([0.0, 1.0, 0.0])
    for _ in range(30):
        state = progress(simulate_plan(truth, up, turns, 1, 50.0, move_s), 9.80665, UNITS)
        if state.done:
            break
        more, seconds, now = read_advice(state.advice, now)
        turns, move_s = [*turns, *more], [*move_s, *seconds]
    assert state.done and len(state.up) >= 12
    assert np.degrees(largest_hole(state.up)[1]) < 55


def test_its_standard_errors_are_those_of_the_calibration(samples, tmp_path):
    device = chain.Device("device", tmp_path, {"poses": "multi_position"})
    samples.to_parquet(tmp_path / "log.parquet", index=False)
    chain.ingest(device, "poses", {}, [tmp_path / "log.parquet"])
    run_stages(device, (chain.segment, chain.noise, chain.calibrate))
    calibration = Calibration.from_json(tmp_path / "multi_position.json")
    state = look(samples, 1e4, noise=rest_noise(samples))
    for sensor in SENSORS:
        fitted = getattr(calibration, sensor)
        relative = [fitted.std[f"K{i}"] / fitted.K[i] for i in range(3)]
        relative += [std for name, std in fitted.std.items() if name[0] == "T"]
        assert state.worst[sensor] == pytest.approx(max(relative), rel=0.2)


def test_the_command_says_what_to_do_and_when_it_is_done(samples, tmp_path, capsys, monkeypatch):
    path = tmp_path / "log.csv"
    command = ["coach", str(path), "--every", "0.01", "--patience", "0.1"]
    samples[samples["t"] < 100].to_csv(path, index=False)
    assert main(command) == 3
    said = capsys.readouterr().out.splitlines()
    assert "9.80665" in said[0] and "Next: turn it until" in said[1] and "ended before" in said[-1]
    samples.to_csv(path, index=False)
    assert main([*command, "--within", "5"]) == 0
    assert capsys.readouterr().out.endswith("Done.\n")
    with open(path) as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        assert main(["coach", "-", *command[2:], "--within", "5"]) == 0
    assert main(["coach", str(tmp_path / "none.csv")]) == 1
    path.write_text("t,ax,ay,az,gx,gy,gz\n")
    assert main(command) == 1
    assert "log.csv: " in capsys.readouterr().err


def test_an_error_ends_it_while_standard_input_stays_open():
    command = [
        sys.executable,
        "-m",
        "imuloop",
        "coach",
        "-",
        "--every",
        "0.01",
        "--patience",
        "0.1",
    ]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as run:
        assert run.wait(60) == 1 and run.stderr.read().count(b"\n") == 1
