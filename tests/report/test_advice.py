"""Advice is made of a device's own numbers: what is wrong first, then what gains most."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from imuloop.core.samples import CHANNELS
from imuloop.core.sphere import fibonacci_lattice
from imuloop.report.advice import next_step
from imuloop.report.findings import UNTESTED
from imuloop.report.results import DeviceResults, SessionResults

SENSORS = ("accelerometer", "gyroscope")
COUNTED = {"status": "ok", "rate_hz": 100.0, "misdeclared": False, "reasons": []}
COUNTED |= {"clipped": {}, "faults": {}, "warnings": []}


def poses(up):
    """Return segments with a rest for each upward direction, the first of 50 s."""
    up = np.asarray(up, dtype=float)
    count = len(up)
    start = np.concatenate([[0.0], 50.0 + 6.0 * np.arange(count)])[:count]
    columns = {f"{c}_mean": np.zeros(count) for c in CHANNELS}
    columns |= {f"a{axis}_mean": 9.8 * up[:, i] for i, axis in enumerate("xyz")}
    columns |= {"start_s": start, "end_s": np.where(start > 0, start + 4, 50.0)}
    return pd.DataFrame(columns | {"kind": "static", "pose": np.arange(count), "n": 400})


def session(name, kind, path=None, up=(), duration_s=300.0, **quality):
    segments = poses(np.reshape(up, (-1, 3)))
    quality = COUNTED | {"duration_s": duration_s} | quality
    return SessionResults(name, kind, quality, {}, path, segments, {})


@pytest.fixture
def good(tmp_path):
    """Return a function: a device with nothing wrong but for what is changed."""
    path = tmp_path / "samples.parquet"
    pq.write_table(pa.table({"t": np.arange(3.0)}), path)

    def build(up=None, more=(), **changed):
        up = fibonacci_lattice(40) if up is None else up
        turns = session("turns", "multi_position", path, up)
        rest = session("rest", "static", path, duration_s=7200.0)
        sessions = changed.pop("sessions", (turns, rest))
        tables = [s.segments.assign(session=s.name) for s in (*sessions, *more)]
        table = pd.concat(tables).rename(columns={f"{c}_mean": c for c in CHANNELS})
        content = {"noise": noise(), "diagnosis": diagnosis()} | changed
        return DeviceResults("imu", "IMU", tmp_path, (*sessions, *more), poses=table, **content)

    return build


def coefficient(value=None, upper=None):
    return {"value": value, "ci95": None, "upper95": upper, "identifiable": value is not None}


def noise(**changed):
    axis = {k: coefficient(1e-5) for k in "QNBKR"} | {"gauss_markov": [], "sinusoid": []}
    axis |= {"N": coefficient(1e-3), "B": coefficient(1e-4)}
    return {"axes": {c: {**axis, **changed} for c in CHANNELS}}


def diagnosis(ratio=0.5, gain=0.5, parameter="K2", sensor="accelerometer", **blocks):
    """Return a diagnosis of which a next step takes a share of σ; `blocks` of poses."""
    now = {"sensor": sensor, "parameter": parameter, "error": 3.04e-3, "ratio": ratio}
    now |= {"std": 3.1e-4, "std_after": 3.1e-4 * (1 - gain), "step": "turn it until −z is up"}
    fine = UNTESTED | {"verdict": "consistent"}
    sensors = {s: {"poses": blocks.get(s, fine), "static_record": fine} for s in SENSORS}
    return {"sensors": sensors, "next_step": now}


def above(name, unit, after, floor, verdict="unexplained"):
    residual = {"unit": unit, "n": 30, "floor": floor, "before": 4e-3, "after": after}
    residual |= {"chi2_before": None, "chi2_after": None}
    return UNTESTED | {"verdict": verdict, "residuals": {name: residual}}


@pytest.fixture
def step(good):
    """Return a function: the next step of a device in which something is changed."""
    return lambda *arguments, **changed: next_step(good(*arguments, **changed)).replace(
        "\u202f", " "
    )


def test_a_healthy_device_needs_nothing(step):
    said = step()
    assert said.startswith("Nothing needed. The calibration is precise enough") and "0.50" in said
    assert "lowers the σ that matters most" in step(diagnosis=diagnosis(ratio=5.0, gain=0.001))


def test_the_limit_is_said_with_its_improvement_and_the_gain(step):
    said = step(diagnosis=diagnosis(ratio=5.0))
    assert "What limits a reading most is the accelerometer's z scale factor" in said
    assert "at 1 g its σ makes an error of 0.31 mg, 5.0 times the noise" in said
    assert "turn it until −z is up: σ falls from 310 to 160 ppm." in said


def test_a_hole_is_named(step):
    up = fibonacci_lattice(60)
    assert "Add poses with −x up: the nearest pose is" in step(up[up[:, 0] > -0.3])


def test_a_longer_record_is_asked_for_in_hours(good, step):
    limited = noise(K=coefficient(upper=2e-6))
    said = step(sessions=good().sessions[:1], noise=limited)
    assert said.startswith("Record 2.0 h at rest (there is no static session): K of all six axes")
    # a longer record than two hours is not asked for
    assert step(noise=limited).startswith("Nothing needed")


def test_a_first_session_is_asked_for_as_the_readme_has_it(good, step):
    said = step(sessions=good().sessions[1:])
    assert said.startswith("Record a multi_position session: 50 s at rest, then about 40 rests")


def test_a_rejected_session_comes_first_and_a_wrong_declaration_before_all(step):
    gone = session("turns", "multi_position", status="rejected", reasons=["no rows"])
    assert "the rejected session turns again" in step(sessions=(gone,), diagnosis={})
    wrong = {"status": "rejected", "reasons": ["it looks like g"], "misdeclared": True}
    late = session("late", "static", **wrong)
    said = step(more=[late], diagnosis=diagnosis(5.0))
    assert said.startswith("Before anything else, correct the declaration of the")


@pytest.mark.parametrize("both_ways", [False, True])
def test_a_temperature_that_only_rose_asks_for_heating_and_cooling(step, tmp_path, both_ways):
    u = np.linspace(0, 1, 500)
    course = 1 - abs(2 * u - 1) if both_ways else u
    path = tmp_path / "warm.parquet"
    pq.write_table(pa.table({"t": 7200 * u, "temperature": 20 + 15 * course}), path)
    said = step(more=[session("day", "static", path)])
    start = "Nothing needed" if both_ways else "Heat and cool: in session day the temperature only"
    assert said.startswith(start)


def test_what_is_unexplained_is_said_with_its_floor(step):
    block = above("rotation", "rad", 4e-3, 1e-3)
    assert "error is 0.23°, its floor 0.057°." in step(diagnosis=diagnosis(gyroscope=block))
    # no larger than the Earth's rate
    block = above("pose_rate", "rad/s", 8e-5, 4e-5)
    assert "horizontal rate of the Earth" in step(diagnosis=diagnosis(gyroscope=block))


def test_an_error_of_the_poses_comes_before_its_trace_in_motion(step):
    poses = above("gravity_norm", "m/s^2", 1.3e-2, 4.5e-3)
    content = diagnosis(accelerometer=poses)
    for blocks in content["sensors"].values():
        blocks["motion"] = above("velocity_horizontal", "m/s", 2.5e-2, 7.9e-3)
    assert step(diagnosis=content).startswith("Accelerometer, poses: the model lacks something.")


def test_values_at_the_end_of_the_range_come_first(good, step):
    hard = session("hard", "static", good().sessions[0].samples_path, clipped={"ax": 12, "gz": 0})
    assert step(more=[hard]).startswith("Session hard: 12 samples of ax lie at the end")
    railed = replace(hard, segmentation={"railed_rests": 7})
    assert "range. 7 rests, and turns and moves with such a sample are" in step(more=[railed])
