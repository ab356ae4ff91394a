"""Advice is made of a device's own numbers, what gains most first."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from imuloop.core.samples import CHANNELS
from imuloop.core.sphere import fibonacci_lattice
from imuloop.report.advice import MOST, next_steps
from imuloop.report.recording import attitude_words, parameter_words, sigma_words
from imuloop.report.results import Device, Session

SENSORS = {"accelerometer": "m/s^2", "gyroscope": "rad/s"}


def poses(up, initial_s=50.0):
    """Return segments with a rest for each upward direction."""
    up = np.asarray(up, dtype=float)
    start = np.concatenate([[0.0], initial_s + 6.0 * np.arange(len(up) - 1)])[: len(up)]
    means = {f"{c}_mean": np.zeros(len(up)) for c in CHANNELS}
    means |= {f"a{axis}_mean": 9.8 * up[:, i] for i, axis in enumerate("xyz")}
    end = np.concatenate([[initial_s], start[1:] + 4.0])[: len(up)]
    kinds, counts = np.full(len(up), "static"), np.full(len(up), 400)
    pose = np.arange(len(up))
    columns = {"start_s": start, "end_s": end, "kind": kinds, "pose": pose, "n": counts}
    return pd.DataFrame(columns | means)


def session(name, kind, segments=None, status="ok", duration_s=300.0, path=None, reasons=()):
    segments = poses(np.empty((0, 3))) if segments is None else segments
    quality = {"status": status, "reasons": list(reasons), "duration_s": duration_s}
    return Session(name, kind, quality | {"rate_hz": 100.0}, {}, path, segments, {})


@pytest.fixture
def plain_samples(tmp_path):
    """Return a file of samples without a temperature."""
    path = tmp_path / "plain.parquet"
    pq.write_table(pa.table({"t": np.arange(3.0)}), path)
    return path


def coefficient(value=None, upper=None):
    return {"value": value, "ci95": None, "upper95": upper, "identifiable": value is not None}


def noise(**changed):
    axis = {k: coefficient(1e-5) for k in "QNBKR"} | {"gauss_markov": [], "sinusoid": []}
    axis |= {"N": coefficient(1e-3), "B": coefficient(1e-4)}
    return {"axes": {c: {**axis, **changed} for c in CHANNELS}}


def diagnosis(weight=0.5, gain=0.5, **changed):
    """Return a diagnosis whose 20 more poses lower every σ by a share."""
    content = {}
    for sensor, output in SENSORS.items():
        units = {"K": "1", "b": output, "T": "rad"}
        names = ["K0", "K1", "K2", "b0", "b1", "b2", "T01", "T02", "T12"]
        weights = {"K": weight, "T": weight, "b": 0.1}
        parameters = {
            n: {"unit": units[n[0]], "std": 3.1e-4, "weight": weights[n[0]]} for n in names
        }
        entry = {"name": "poses", "poses": 20, "turns": 0, "axis": None, "duration_s": 180.0}
        entry |= {"up": [0, 0, -1.0], "std": {n: 3.1e-4 * (1 - gain) for n in names}}
        content[sensor] = {"excess": 1.0, "parameters": parameters, "candidates": [entry]}
    turns = {"axis": "z", "std": 3.1e-4, "std_after": 3.1e-4, "level": 1e-3}
    turns |= {"poses": 12, "turns": 4}
    turns |= {"turned_deg": [900.0, 800.0, 200.0], "largest_deg": [170.0, 160.0, 40.0]}
    turns |= {"mean_deg_s": [40.0, 30.0, 12.0]}
    blocks = {"poses": {"verdict": "consistent"}, "static_record": {"verdict": "consistent"}}
    sensors = dict.fromkeys(SENSORS, blocks)
    return {"sensors": sensors, "next_recording": {"sensors": content, "turns": turns}} | changed


def device(path, **changed):
    """Return a device with nothing wrong."""
    up = fibonacci_lattice(40)
    sessions = (
        session("turns", "multi_position", poses(up), path=path),
        session("rest", "static", duration_s=7200.0, path=path),
    )
    values = {"noise": noise(), "diagnosis": diagnosis(), "sessions": sessions} | changed
    of_sessions = [s.segments.assign(session=s.name) for s in values["sessions"]]
    table = pd.concat(of_sessions).rename(columns={f"{c}_mean": c for c in CHANNELS})
    return Device("imu", "IMU", None, poses=table, **values)


def test_a_healthy_device_needs_nothing(plain_samples):
    (step,) = next_steps(device(plain_samples))
    assert step.startswith("Nothing needed. Enough poses and turns")
    assert "0.5" in step


def test_the_next_recording_is_said_with_the_error_before_and_after(plain_samples):
    (step,) = next_steps(device(plain_samples, diagnosis=diagnosis(weight=5.0)))
    assert "20 more poses" in step and "z axis down" in step
    assert "scale factor from 310 to 160\u202fppm" in step


def test_a_recording_that_gains_too_little_is_not_advised(plain_samples):
    (step,) = next_steps(device(plain_samples, diagnosis=diagnosis(weight=5.0, gain=0.05)))
    assert step.startswith("Nothing needed. No recording that was tried")


def test_a_hole_is_named_with_what_poses_there_gain(plain_samples):
    up = fibonacci_lattice(60)
    up = up[up[:, 0] > -0.3]
    sessions = (
        session("turns", "multi_position", poses(up), path=plain_samples),
        session("rest", "static", duration_s=7200.0, path=plain_samples),
    )
    steps = next_steps(device(plain_samples, sessions=sessions))
    assert "Add poses with x axis down: the nearest is" in steps[0]
    assert "from 310 to 160\u202fppm" in steps[0]


def test_turns_are_asked_for_about_the_axis_that_was_turned_least(plain_samples):
    content = diagnosis(weight=5.0, gain=0.0)
    content["next_recording"]["turns"] |= {"level": 1e-4, "std_after": 8e-5, "turns": 16}
    step = next_steps(device(plain_samples, diagnosis=content))[0]
    assert "The rotations about z are too small" in step
    assert "known to 310\u202fppm" in step and "200° in all, 40° in the largest" in step
    assert "12\u202f°/s in the mean" in step
    content["next_recording"]["turns"]["mean_deg_s"] = [40.0, 30.0, 5.0]
    assert "about z are too slow" in next_steps(device(plain_samples, diagnosis=content))[0]
    assert "16 turns of 360° about z" in step and "80\u202fppm" in step


def test_a_longer_record_is_asked_for_in_hours(plain_samples):
    known = noise(K=coefficient(upper=1e-4), B=coefficient(1e-5))
    step = next_steps(device(plain_samples, noise=known))[0]
    assert step.startswith("Record ") and "h at rest (2.0\u202fh now)" in step
    assert "K of all six axes" in step
    seen = noise(K=coefficient(upper=2e-6), B=coefficient(1e-5))
    assert next_steps(device(plain_samples, noise=seen))[0].startswith("Nothing needed")


def test_a_first_rest_is_long_enough_for_flicker_to_limit_it(plain_samples):
    content = diagnosis(gain=0.0)
    content["next_recording"]["sensors"]["gyroscope"]["parameters"]["b1"]["weight"] = 3.0
    # white noise of 1e-3 reaches flicker of 1e-4 after (1e-3 / 0.664e-4)^2 = 227 s
    steps = next_steps(device(plain_samples, diagnosis=content))
    assert "Begin session turns with 3.8\u202fmin at rest (now 50\u202fs)" in steps[0]
    short = device(plain_samples, diagnosis=content, noise=noise(B=coefficient(3e-4)))
    assert not any("Begin session" in step for step in next_steps(short))


def test_two_hours_are_asked_for_where_nothing_at_rest_was_recorded(plain_samples):
    turns = session("turns", "multi_position", poses(fibonacci_lattice(40)), path=plain_samples)
    # so near to its limit that a longer record would not lower it by half
    limited = noise(K=coefficient(upper=2e-6))
    (step,) = [
        s
        for s in next_steps(device(plain_samples, sessions=(turns,), noise=limited))
        if s.startswith("Record")
    ]
    assert "2\u202fh at rest: there is no static record" in step and "K of ax" in step


def test_a_first_session_is_as_long_as_the_readme_says(plain_samples, repository):
    lonely = device(plain_samples, sessions=(session("rest", "static", path=plain_samples),))
    step = next_steps(lonely)[0]
    assert "Record a multi_position session" in step
    readme = " ".join((repository / "README.md").read_text(encoding="utf-8").split())
    assert "alone for 50 s" in readme and "about 40 attitudes" in readme
    assert "50\u202fs at rest" in step and "about 40 rests" in step


def test_a_rejected_session_is_named_and_no_other_asked_for(plain_samples):
    gone = session("turns", "multi_position", status="rejected", reasons=["no rows"])
    steps = next_steps(device(plain_samples, sessions=(gone,), diagnosis={}))
    assert "session turns again" in steps[0] and "(no rows)" in steps[0]
    assert not any("Record a multi_position session" in step for step in steps)


def test_nothing_is_advised_before_a_wrong_declaration_is_mended(plain_samples):
    reason = "the specific force at rest is 1 m/s^2: taken as m/s^2, it looks like g"
    wrong = session("late", "static", status="rejected", reasons=[reason])
    wrong.quality["misdeclared"] = True
    good = device(plain_samples)
    for each in (good, device(plain_samples, diagnosis=diagnosis(weight=5.0))):
        steps = next_steps(replace(each, sessions=(*each.sessions, wrong)))
        words = "Correct what is declared of session late and run again, before anything else"
        assert steps == [f"{words}: {reason}."]


def test_short_rests_are_advised_with_what_settings_bring(plain_samples):
    content = diagnosis()
    brief = session("brief", "multi_position", poses(fibonacci_lattice(12)), path=plain_samples)
    found = {"window_s": 0.5, "shortest_rest_s": 0.25, "attitudes": 60, "now": 12}
    brief = replace(brief, segmentation={"shorter": found})
    [step] = [
        s
        for s in next_steps(device(plain_samples, sessions=(brief,), diagnosis=content))
        if "too short" in s
    ]
    assert "session brief" in step and "12 attitudes are left" in step
    assert "segment: {window_s: 0.5, shortest_rest_s: 0.25} there are 60" in step


def warm(path, course):
    t = np.linspace(0, 7200, 500)
    pq.write_table(pa.table({"t": t, "temperature": 20 + 15 * course(t / 7200)}), path)
    return path


def test_a_temperature_that_only_rose_asks_for_heating_and_cooling(plain_samples, tmp_path):
    good = device(plain_samples)
    path = warm(tmp_path / "warm.parquet", lambda u: u)
    step = next_steps(
        replace(
            good,
            sessions=(good.sessions[0], session("day", "static", duration_s=7200.0, path=path)),
        )
    )[0]
    assert step.startswith("Heat and cool: in session day the temperature only rose (20")
    assert "more than 20 times the σ" in step
    path = warm(tmp_path / "both.parquet", lambda u: 1 - abs(2 * u - 1))
    both = session("day", "static", duration_s=7200.0, path=path)
    steps = next_steps(replace(good, sessions=(good.sessions[0], both)))
    assert steps[0].startswith("Nothing needed")


def test_what_is_unexplained_is_said_with_its_floor(plain_samples):
    residual = {"unit": "rad", "n": 30, "floor": 1e-3, "before": 4e-3, "after": 4e-3}
    content = diagnosis()
    block = {"verdict": "unexplained", "residuals": {"rotation": residual}}
    content["sensors"] = content["sensors"] | {"gyroscope": {"poses": block}}
    step = next_steps(device(plain_samples, diagnosis=content))[0]
    assert "Held-out error 0.23°, floor 0.057°." in step


def test_a_rate_no_larger_than_that_of_the_earth_may_be_that(plain_samples):
    def said(after):
        residual = {"unit": "rad/s", "n": 30, "floor": 4e-5, "before": 2e-4, "after": after}
        block = {"verdict": "unexplained", "residuals": {"pose_rate": residual}}
        content = diagnosis()
        content["sensors"] = content["sensors"] | {"gyroscope": {"poses": block}}
        return next_steps(device(plain_samples, diagnosis=content))[0]

    assert "horizontal rate of the Earth" in said(8e-5)
    assert "Earth" not in said(9e-5)


def test_an_accelerometer_above_its_floor_is_mended_before_the_gyroscope(plain_samples):
    residual = {"unit": "rad", "n": 30, "floor": 1e-3, "before": 4e-3, "after": 4e-3}
    own = {"verdict": "unexplained", "residuals": {"rotation": residual}}
    force = {"unit": "m/s^2", "n": 30, "floor": 1e-3, "before": 4e-3, "after": 4e-3}
    other = {"verdict": "partly_explained", "residuals": {"pose_force": force}}
    content = diagnosis()
    content["sensors"] = {"accelerometer": {"poses": other}, "gyroscope": {"poses": own}}
    steps = next_steps(device(plain_samples, diagnosis=content))
    assert steps[0].startswith("Accelerometer, ")
    assert any(s.startswith("Gyroscope, ") and s.endswith("mend that first.") for s in steps)


def test_values_at_the_end_of_the_range_come_first(plain_samples):
    good = device(plain_samples)
    clipped = {"clipped": {"ax": 12, "gz": 0}, "faults": {"clipped_at": {}}}
    at = {"gz": {"rows": 7, "values": [4.36]}, "ax": {"rows": 12, "values": [39.2]}}
    for quality, words in (
        (clipped, "12 samples of ax lie"),
        (clipped | {"faults": {"clipped_at": at}}, "12 samples of ax and 7 samples of gz lie"),
    ):
        s = good.sessions[0]
        s = replace(s, quality=s.quality | quality)
        step = next_steps(replace(good, sessions=(s, good.sessions[1])))[0]
        assert step.startswith("Session turns: ") and words in step


def test_advice_is_short_and_ordered_by_gain(plain_samples):
    rejected = [session(f"s{k}", "static", status="rejected") for k in range(7)]
    good = device(plain_samples, diagnosis=diagnosis(weight=5.0))
    steps = next_steps(replace(good, sessions=(*good.sessions, *rejected)))
    assert len(steps) == MOST
    two = next_steps(replace(good, sessions=(*good.sessions, rejected[0])))
    assert "rejected" in two[0] and "20 more poses" in two[1]


@pytest.mark.parametrize(
    ("up", "words"),
    [
        ([0, 0, 1], "z axis up"),
        ([-np.cos(np.pi / 6), np.sin(np.pi / 6), 0], "x axis down, tilted 30° towards +y"),
        ([0.5, 0.5, -np.sqrt(0.5)], "z axis down, tilted 45° towards +x and +y"),
    ],
)
def test_attitudes_in_words(up, words):
    assert attitude_words(up) == words


def test_parameters_and_their_errors_in_words():
    assert parameter_words("gyroscope", "K2") == "the gyroscope's z scale factor"
    assert parameter_words("gyroscope", "g_sensitivity.G00") == "the gyroscope's g_sensitivity G00"
    assert sigma_words("1", 3.1e-4, 1.4e-4) == "310 to 140\u202fppm"
    assert sigma_words("rad", 4e-4) == "0.40\u202fmrad"


def test_a_limit_of_zero_asks_for_no_record(plain_samples):
    zero = noise(B=coefficient(None, 0.0), K=coefficient(None, 0.0))
    (step,) = next_steps(device(plain_samples, noise=zero))
    assert step.startswith("Nothing needed.")
