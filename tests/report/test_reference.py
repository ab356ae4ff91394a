"""What the report shows of a sensor beside a reference: its numbers, and what they do not say."""

from types import SimpleNamespace

import pandas as pd
import pytest

from imuloop.report.figures.residuals import residual_pictures
from imuloop.report.tables.calibration import reasons
from imuloop.report.tables.diagnosis import effect_table, set_up_table
from imuloop.report.verdict import UNTESTED, answers, blocks, sentence
from report.plausible_diagnosis import residual

RESIDUAL = residual("m/s^2", 0.06, 0.02, 0.01, 4)
ARM = {
    "name": "lever_arm",
    "constants": {},
    "parameters": {"rx": 0.001, "ry": -0.002, "rz": 0.008},
    "std": {"rx": 1e-4, "ry": 2e-4, "rz": 3e-4},
    "units": dict.fromkeys(("rx", "ry", "rz"), "m"),
}
SET_UP = {
    "constants": {},
    "parameters": {"bx": 0.0980665, "mx": 0.1},
    "std": {"bx": 0.00980665, "mx": 0.001},
    "units": {"bx": "m/s^2", "mx": "rad"},
}


def block(sessions=2, **more):
    kept = {"verdict": "partly_explained", "residuals": {"reference_force": RESIDUAL}}
    kept |= {"effects": [ARM], "set_up": {f"hand_{k}": SET_UP for k in range(sessions)}}
    return {key: [] for key in ("candidates", "confounded")} | kept | more


def test_a_picture_shows_every_window(tmp_path):
    columns = {"session": [*"aabb"], "residual": "reference_force", "pose": [0, 1, 0, 1]}
    columns |= {"start_s": [0.0, 1.0, 0.0, 1.0], "end_s": [0.4, 1.4, 0.4, 1.4]}
    for when in ("before", "after", "floor"):
        columns[f"reference_force_{when}"] = [0.05, 0.06, 0.07, 0.06]
    table = pd.DataFrame(columns)
    # windows of the other sensor, in which this residual is none
    table = pd.concat([table, table[["session", "residual", "pose", "start_s", "end_s"]]])
    device = SimpleNamespace(name="d", figures=tmp_path, reference=table, poses=None, moves=None)
    [picture] = residual_pictures(device, "accelerometer", block())
    assert "<svg" in picture.svg
    said = picture.caption.replace("\u202f", " ")
    assert "falls from 6.12 mg to 2.04 mg" in said and "window 0 of b" in said
    assert len(pd.read_csv(tmp_path / "accelerometer_reference_force.csv")) == 4


def test_the_set_up_is_a_table_in_the_units_of_data_sheets():
    table = set_up_table("accelerometer", block())
    rows = [tuple(cell.replace("\u202f", " ") for cell in row) for row in table.rows]
    assert rows[:2] == [("hand_0, bx", "10.0 ± 1.0", "mg"), ("hand_0, mx", "5.730 ± 0.057", "°")]
    assert len(rows) == 4 and not set_up_table("accelerometer", block(sessions=0))
    arm = effect_table("accelerometer", "reference", ARM)
    assert arm.rows[0][0] == "rx" and arm.rows[0][2] == "mm" and "marker" in arm.note


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


@pytest.mark.parametrize(("sessions", "said"), [(1, True), (2, False)])
def test_parts_of_one_session_are_said_to_be_no_sessions(sessions, said):
    text = sentence("accelerometer", block(sessions=sessions))
    assert ("parts of one session" in text) == said
    assert "in the sensor or the reference" in text


def test_sensor_beside_a_reference_is_a_part_and_an_answer_of_its_own():
    parts = {"poses": UNTESTED, "static_record": UNTESTED, "motion": UNTESTED}
    sensors = {"accelerometer": parts | {"reference": block()}, "gyroscope": parts}
    found = blocks({"sensors": sensors})
    assert ("accelerometer", "reference") in [each[:2] for each in found]
    assert ("gyroscope", "reference") not in [each[:2] for each in found]
    assert "accelerometer beside a reference" in [each[0] for each in answers({"sensors": sensors})]
