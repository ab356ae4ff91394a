"""The coach: from the first rest to done, with the σ that the calibration has at the end."""

import numpy as np
import pytest

from bench.study.chain import through
from calibrate.devices import ACCELERATION_UNIT, RATE_UNIT, planned
from imuloop import chain
from imuloop.__main__ import main
from imuloop.core.model import Calibration
from imuloop.core.samples import SENSORS
from imuloop.core.sphere import direction_words, largest_hole
from imuloop.plan.coach import progress, rest_noise
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import example_truth

UNITS = ACCELERATION_UNIT, RATE_UNIT


@pytest.fixture(scope="module")
def samples():
    truth = planned(example_truth(rate=50.0), poses=30, initial_rest_s=60.0)
    return simulate_session(truth, "multi_position", 1)


def look(samples, seconds, **how):
    return progress(samples[samples["t"] < seconds], 9.80665, UNITS, **how)


def test_it_leads_from_the_first_rest_to_done(samples):
    assert look(samples, 10.0).advice == "leave it at rest, 40 s more"
    assert look(samples, 55.0).advice == "turn it to another attitude"
    few = look(samples, 100.0)
    assert 2 <= len(few.up) < 10
    # the attitude that is farthest from all so far, with the side that is up
    words = direction_words(largest_hole(few.up)[0])
    assert few.advice == f"turn it until {words} is up, and let go for 4 s"
    worst = [look(samples, seconds).worst["accelerometer"] for seconds in (180.0, 1e4)]
    assert worst[1] < worst[0] < np.inf
    done = look(samples, 1e4, within=0.1)
    assert done.done and done.advice == "" and len(done.up) == 31
    # the accelerometer is as good as asked for, the gyroscope is not
    least = done.worst["accelerometer"]
    assert "by 360° about" in look(samples, 1e4, within=1.01 * least).advice


def test_its_standard_errors_are_those_of_the_calibration(samples, tmp_path):
    device = chain.Device("device", tmp_path, {"poses": "multi_position"})
    samples.to_parquet(tmp_path / "log.parquet", index=False)
    chain.ingest(device, "poses", {}, [tmp_path / "log.parquet"])
    through(device, (chain.segment, chain.noise, chain.calibrate))
    made = Calibration.from_json(tmp_path / "multi_position.json")
    found = look(samples, 1e4, noise=rest_noise(samples))
    for sensor in SENSORS:
        expected = getattr(made, sensor).std
        assert found.std[sensor] == pytest.approx(expected, rel=0.2)


def test_the_command_says_what_to_do_and_when_it_is_done(samples, tmp_path, capsys):
    path = tmp_path / "log.csv"
    page = tmp_path / "coach.html"
    command = ["coach", str(path), "--every", "0.01", "--patience", "0.1", "--page", str(page)]
    samples[samples["t"] < 100].to_csv(path, index=False)
    assert main(command) == 3
    said = capsys.readouterr().out.splitlines()
    assert "9.80665" in said[0] and "Next: turn it until" in said[1] and "ended before" in said[-1]
    first = page.read_text()
    assert "Next: turn it until" in first and "<svg" in first and "refresh" in first
    samples.to_csv(path, index=False)
    assert main([*command, "--within", "5"]) == 0
    assert "Done." in page.read_text() and "refresh" not in page.read_text()
    assert capsys.readouterr().out.endswith("Done.\n")
    assert main(["coach", str(tmp_path / "none.csv")]) == 1
    path.write_text("t,ax,ay,az,gx,gy,gz\n")
    assert main(command) == 1
    assert "log.csv: " in capsys.readouterr().err
