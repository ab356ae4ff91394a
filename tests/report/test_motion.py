"""What the report says of the motion between the rests."""

from imuloop.report.advice import what_next
from imuloop.report.verdict import BOTH, answers, motion_of, sentence

RESIDUAL = {
    "unit": "m/s", "n": 20, "floor": 4e-3, "before": 20e-3, "after": 6e-3,
    "chi2_before": 27.0, "chi2_after": 1.1,
}  # fmt: skip


def diagnosis(verdict, left_out=0, **effects):
    """Return a diagnosis of motion alone, effects by sensor."""
    common = {
        "verdict": verdict,
        "residuals": {"velocity_vertical": RESIDUAL},
        "correlates": [],
        "confounded": [],
        "moves": {"all": 37, "left_out": left_out},
    }
    late = {"name": "time_offset", "status": "confounded", "why": "the accelerometer's"}
    own = {"accelerometer": [late | {"status": "added"}], "gyroscope": [late]}
    return {
        "sensors": {
            sensor: {
                "motion": common
                | {"effects": [{"name": n} for n in effects.get(sensor, ())]}
                | {"candidates": own[sensor]}
            }
            for sensor in own
        }
    }


def test_effects_of_both_sensors_are_one_answer():
    found = diagnosis(
        "partly_explained", accelerometer=["lever_arm"], gyroscope=["gyro_axis_delay"]
    )
    assert answers(found)[2:] == [
        (
            "both in motion",
            "partly_explained",
            "better with lever arm and gyro axis delay corrected, but something is still missing",
        )
    ]
    # what is given to one sensor is none of the other's
    assert [c["status"] for c in motion_of(found)["candidates"]] == ["added"]


def test_motion_at_its_floor_or_without_a_test_is_no_answer():
    assert len(answers(diagnosis("consistent"))) == len(answers({})) == 2


def test_moves_that_a_knock_spoiled_are_counted_and_what_to_do_is_said():
    block = motion_of(diagnosis("unexplained", left_out=17))
    assert "Left out, for a knock between two samples: 17 of 37 moves." in sentence(BOTH, block)
    assert "Low-pass the accelerometer" in what_next(block)
    assert "Left out" not in sentence(BOTH, motion_of(diagnosis("unexplained")))
