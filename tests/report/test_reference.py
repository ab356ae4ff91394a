"""What the report shows of a sensor beside a reference: its numbers, and what they do not say."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from imuloop.report.figures.reference import duration_table, reference_pictures
from imuloop.report.tables.calibration import reasons
from imuloop.report.verdict import UNTESTED, answers, blocks, sentence
from report.plausible_diagnosis import residual

RESIDUAL = residual("m/s^2", 0.06, 0.02, 0.01, 4)
ARM = {
    "name": "lever_arm",
    "constants": {"marker": 1},
    "parameters": {"rx": 0.001, "ry": -0.002, "rz": 0.008},
    "std": {"rx": 1e-4, "ry": 2e-4, "rz": 3e-4},
}


def block(**more):
    residuals = {"reference_force": RESIDUAL}
    kept = {"verdict": "partly_explained", "residuals": residuals, "effects": [ARM], "sessions": 1}
    return {key: [] for key in ("candidates", "confounded", "correlates")} | kept | more


def pictures(tmp_path, content):
    start = np.array([0.0, 1.0, 0.0, 1.0])
    columns = {"session": [*"aabb"], "residual": "reference_force"}
    columns |= {"start_s": start, "end_s": start + 0.4}
    for when in ("before", "after", "floor"):
        columns[f"reference_force_{when}"] = [0.05, 0.06, 0.07, 0.06]
    table = pd.DataFrame(columns)
    cut = {"lost": [[0.1, 0.3], [1.0, 1.1]], "swapped": [], "leaps": [[1.5, 2.0]]}
    sessions = [
        SimpleNamespace(name="a", quality={}),
        SimpleNamespace(name="b", quality={"reference": {"cut": cut}}),
    ]
    device = SimpleNamespace(name="d", figures=tmp_path, reference=table, sessions=sessions)
    return reference_pictures(device, "accelerometer", content)


def test_pictures_show_every_window_and_the_arm(tmp_path):
    over_time, arm = pictures(tmp_path, block())
    for picture in (over_time, arm):
        assert picture.svg.startswith("<svg")
    assert "falls from 6.12 mg to 2.04 mg" in over_time.caption.replace("\u202f", " ")
    assert "(1.0, −2.0, 8.0)" in arm.caption
    columns = pd.read_csv(tmp_path / "accelerometer_reference_force.csv")
    assert columns["cut"].dropna().tolist() == ["lost", "lost", "leaps"]
    assert len(columns) == 4 + 3 and columns["after"].notna().sum() == 4


def test_why_the_final_calibration_lacks_a_sensor_is_said_once():
    """Protects the reason that the diagnosis gives and no method before it: it was left out."""

    def calibration(force):
        own = (SimpleNamespace(not_testable=why) for why in (force, "two poses"))
        return SimpleNamespace(**dict(zip(("accelerometer", "gyroscope"), own, strict=True)))

    calibrations = {"multi_position": calibration("two poses"), "final": calibration("it lacks")}
    assert reasons(SimpleNamespace(calibrations=calibrations, diagnosis={})) == [
        ("Multi-position", "accelerometer", "two poses"),
        ("Multi-position", "gyroscope", "two poses"),
        ("Final", "accelerometer", "it lacks"),
    ]


def test_what_was_cut_of_a_reference_is_drawn_by_reason_and_counted(tmp_path):
    over_time, _ = pictures(tmp_path, block())
    said = "lost 0.300 s in 2 stretches and leaps of place 0.500 s in 1 stretch."
    assert said in over_time.caption.replace("\u202f", " ")
    [area] = over_time.figure().axes
    strips = {c.get_label(): c.get_paths() for c in area.collections}
    assert {label: len(paths) for label, paths in strips.items()} == {
        "lost": 2,
        "leaps of place": 1,
    }
    # session b follows a, which ends at 1.4 s, and its own last stretch
    ends = strips["leaps of place"][0].get_extents().intervalx
    np.testing.assert_allclose(ends, [1.4 + 1.5, 1.4 + 2.0])


def test_series_shows_reference_and_gyroscope_and_each_stage(tmp_path):
    t = np.linspace(0, 10, 51)
    up = np.column_stack([np.sin(t), np.cos(t), 0 * t])
    series = {"session": "a", "t_s": t, "reference": up, "sensor": up}
    series |= {"logged": 0.02 * t, "calibrated": 0.01 * t, "final": 0.001 * t}
    content = block(series=series, residuals={})
    picture, _ = pictures(tmp_path, content)
    _, below = picture.figure().axes
    lines = {line.get_label(): line.get_ydata() for line in below.lines}
    np.testing.assert_allclose(lines["with the effects"], np.degrees(0.001 * t))
    assert list(lines) == ["as logged", "calibrated", "with the effects"]
    # root mean square of 0.02 t is 0.02 · 10/√3
    assert "6.6° as logged, 3.3° calibrated, 0.33° with the effects" in picture.caption
    assert len(pd.read_csv(tmp_path / "gyroscope_reference_series.csv")) == 51
    # without effects there are two stages
    alone, *_ = pictures(tmp_path, content | {"effects": []})
    assert len(alone.figure().axes[1].lines) == 2


def test_durations_are_in_degrees_beside_the_floor():
    sizes = {"rotation": np.radians(0.2), "vertical": np.radians(0.1)}
    stages = dict.fromkeys(("logged", "calibrated", "final", "floor"), sizes)
    table = duration_table({"by_duration": [{"seconds": 0.1, "n": 7} | stages]})
    assert [row[0] for row in table.rows] == ["0.1\u202fs"] * 2
    assert table.rows[0][2:] == ("0.200",) * 4 + ("7",)
    assert table.rows[1][2:6] == ("0.100",) * 4
    assert duration_table({}) is None


@pytest.mark.parametrize(("sessions", "said"), [(1, True), (2, True), (3, False)])
def test_fewer_than_three_sessions_are_said_to_be_few(sessions, said):
    text = sentence("accelerometer", block(sessions=sessions))
    assert ("not a session" in text) == said
    # an arm is of the set-up, and belongs to no calibration anyway
    assert "left out of the calibration" not in text
    more = [ARM, ARM | {"name": "quadratic"}]
    text = sentence("accelerometer", block(sessions=sessions, effects=more))
    assert ("quadratic nonlinearity is seen within a session only" in text) == said


def test_sensor_beside_a_reference_is_a_part_and_an_answer_of_its_own():
    parts = {"poses": UNTESTED, "static_record": UNTESTED, "motion": UNTESTED}
    sensors = {"accelerometer": parts | {"reference": block()}, "gyroscope": parts}
    found = blocks({"sensors": sensors})
    assert ("accelerometer", "reference") in [each[:2] for each in found]
    assert ("gyroscope", "reference") not in [each[:2] for each in found]
    assert "accelerometer beside a reference" in [each[0] for each in answers({"sensors": sensors})]
