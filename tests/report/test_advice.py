"""Advice is made of a device's own numbers: what is wrong first, then what gains most."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from imuloop.core.samples import CHANNELS
from imuloop.core.sphere import fibonacci_lattice
from imuloop.report.advice import MOST, next_steps
from imuloop.report.results import DeviceResults, SessionResults
from imuloop.report.verdict import UNTESTED

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
def first(good):
    """Return a function: the first step of a device in which something is changed."""
    return lambda up=None, more=(), **changed: next_steps(good(up, more, **changed))[0]


def test_a_healthy_device_needs_nothing(good):
    (step,) = next_steps(good())
    assert step.startswith("Nothing needed. The calibration is precise enough") and "0.5" in step


def test_the_limit_is_said_with_what_improves_it_and_by_how_much(first):
    step = first(diagnosis=diagnosis(ratio=5.0)).replace("\u202f", " ")
    for words in (
        "What limits a reading most is the accelerometer's z scale factor",
        "at 1 g its σ makes 0.31 mg, 5.0 times the noise",
        "turn it until −z is up: σ falls from 310 to 160 ppm.",
    ):
        assert words in step
    step = first(diagnosis=diagnosis(ratio=5.0, gain=0.001))
    assert step.startswith("Nothing needed. No rest and no turn lowers")


def test_a_hole_is_named(first):
    up = fibonacci_lattice(60)
    assert "Add poses with −x up: the nearest is" in first(up[up[:, 0] > -0.3])


def test_a_longer_record_is_asked_for_in_hours(good, first):
    limited = noise(K=coefficient(upper=2e-6))
    steps = next_steps(good(sessions=good().sessions[:1], noise=limited))
    assert any("Record 2.0\u202fh at rest (there is no static session now): K" in s for s in steps)
    # a longer record than two hours is not asked for
    assert first(noise=limited).startswith("Nothing needed")


def test_what_both_sensors_leave_beside_a_reference_is_one_step(good):
    content = diagnosis()
    for sensor, name, unit in (
        ("accelerometer", "reference_force", "m/s^2"),
        ("gyroscope", "reference_rotation", "rad"),
    ):
        sizes = {"before": 0.03, "after": 0.02, "floor": 0.001, "unit": unit, "n": 90}
        residual = sizes | {"chi2_before": 900.0, "chi2_after": 400.0}
        content["sensors"][sensor]["reference"] = {
            "verdict": "unexplained",
            "set_up": {},
            "residuals": {name: residual},
            **{k: [] for k in ("effects", "candidates", "confounded")},
        }
    steps = [s.replace("\u202f", " ") for s in next_steps(good(diagnosis=content))]
    [step] = [s for s in steps if "eside a reference" in s]
    assert "accelerometer 2.0 mg (0.10 mg), gyroscope 1.1° (0.057°)." in step
    assert "markers" in step


def test_a_first_session_is_as_long_as_the_readme_says(good, first, repository):
    step = first(sessions=good().sessions[1:])
    assert "Record a multi_position session" in step
    readme = " ".join((repository / "README.md").read_text(encoding="utf-8").split())
    assert "50 s" in readme and "about 40 attitudes" in readme
    assert "50\u202fs at rest" in step and "about 40 rests" in step


@pytest.mark.parametrize("count", [0, 11, 12])
def test_a_session_of_few_poses_is_no_first_session(good, count):
    # without a rest there is no noise, and without noise nothing is planned
    path, up = good().sessions[0].samples_path, fibonacci_lattice(40)[:count]
    moved = session("walk", "multi_position", path, up)
    steps = next_steps(good(sessions=(moved,), noise={}, diagnosis={}))
    assert steps[0].startswith("Record a multi_position session") == (count < 12)
    assert not any("Nothing needed" in step for step in steps)


def test_a_rejected_session_is_named_and_no_other_asked_for(good):
    gone = session("turns", "multi_position", status="rejected", reasons=["no rows"])
    steps = next_steps(good(sessions=(gone,), diagnosis={}))
    assert "Record session turns, which was rejected, again" in steps[0]
    assert not any("Record a multi_position session" in step for step in steps)


def test_nothing_is_advised_before_a_wrong_declaration_is_mended(good):
    reason = "the specific force at rest is 1 m/s^2: taken as m/s^2, it looks like g"
    wrong = {"status": "rejected", "reasons": [reason], "misdeclared": True}
    late = session("late", "static", **wrong)
    words = "Correct what is declared of session late, which was rejected, and run again, before"
    assert next_steps(good(more=[late], diagnosis=diagnosis(5.0))) == [f"{words} anything else."]


@pytest.mark.parametrize("both_ways", [False, True])
def test_a_temperature_that_only_rose_asks_for_heating_and_cooling(first, tmp_path, both_ways):
    u = np.linspace(0, 1, 500)
    course = 1 - abs(2 * u - 1) if both_ways else u
    path = tmp_path / "warm.parquet"
    pq.write_table(pa.table({"t": 7200 * u, "temperature": 20 + 15 * course}), path)
    step = first(more=[session("day", "static", path)])
    if both_ways:
        assert step.startswith("Nothing needed")
    else:
        assert step.startswith("Heat and cool: in session day the temperature only rose (20")


def test_what_is_unexplained_is_said_with_its_floor(first):
    block = above("rotation", "rad", 4e-3, 1e-3)
    assert "Held-out error 0.23°, floor 0.057°." in first(diagnosis=diagnosis(gyroscope=block))
    # no larger than the Earth's rate
    for after, earth in ((8e-5, True), (9e-5, False)):
        block = above("pose_rate", "rad/s", after, 4e-5)
        step = first(diagnosis=diagnosis(gyroscope=block))
        assert ("horizontal rate of the Earth" in step) == earth


def test_values_at_the_end_of_the_range_come_first(good, first):
    hard = session("hard", "static", good().sessions[0].samples_path, clipped={"ax": 12, "gz": 0})
    assert first(more=[hard]).startswith("Session hard: 12 samples of ax lie at the end")
    railed = replace(hard, segmentation={"railed_rests": 7})
    assert "range. 7 rests, and turns and moves with one are left out" in first(more=[railed])


def test_short_rests_are_told_with_the_settings_that_were_used_for_them(good):
    hasty = good().sessions[0]
    for shorter in (None, {"window_s": 1.0, "shortest_rest_s": 0.5}):
        hasty = replace(hasty, segmentation={"short_rests": 60, "shorter": shorter})
        [step] = [s for s in next_steps(good(sessions=(hasty,))) if "too short" in s]
        assert step.endswith("hold each for 4 s or more.")
        assert ("window_s 1 and shortest_rest_s 0.5 were used" in step) == bool(shorter)


def test_rests_in_the_hand_come_before_poses_and_hours_at_rest_come_last(good):
    """Protects the one step that is read first: 5 h at rest gain 99 % of a limit, and little."""
    turns, rest = good().sessions
    tilted = turns.segments.assign(tilt_rad=0.02)
    held = replace(turns, segments=tilted, segmentation={"tilted_rests": 5, "hand_held": True})
    limited = noise(K=coefficient(upper=1e-4))
    rest = replace(rest, quality=rest.quality | {"duration_s": 3600.0})
    plans = diagnosis(ratio=5.0, accelerometer=above("gravity_norm", "m/s^2", 2e-3, 1e-3))
    steps = next_steps(good(sessions=(held, rest), noise=limited, diagnosis=plans))
    assert "instead of holding it in the hand" in steps[0]
    kinds = "the device tilts", "σ falls from", "h at rest"
    places = [next(i for i, step in enumerate(steps) if words in step) for words in kinds]
    assert places == sorted(places) and places[-1] == len(steps) - 1


def test_advice_is_short_and_ordered_by_gain(good):
    rejected = [session(f"s{k}", "static", status="rejected") for k in range(7)]
    assert len(next_steps(good(more=rejected))) == MOST
    steps = next_steps(good(more=rejected[:1], diagnosis=diagnosis(ratio=5.0)))
    assert "rejected" in steps[0] and "σ falls from" in steps[1]


def test_an_accelerometer_above_its_floor_is_mended_before_the_gyroscope(good):
    blocks = {
        "gyroscope": above("rotation", "rad", 4e-3, 1e-3),
        "accelerometer": above("gravity_norm", "m/s^2", 4e-3, 1e-3, "partly_explained"),
    }
    steps = next_steps(good(diagnosis=diagnosis(**blocks)))
    assert steps[0].startswith("Accelerometer, ")
    assert any(s.startswith("Gyroscope, ") and s.endswith("mend that first.") for s in steps)
