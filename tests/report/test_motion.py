"""What the report says of the motion between the rests."""

from imuloop.report.advice import what_next
from imuloop.report.verdict import BOTH, answers, motion_of, sentence
from report.plausible_diagnosis import residual

RESIDUAL = residual("m/s", 20e-3, 6e-3, 4e-3, 20)


def diagnosis(verdict, left_out=0, **effects):
    common = {
        "verdict": verdict,
        "residuals": {"velocity_vertical": RESIDUAL},
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
    effects = "lever arm and delays between the gyroscope's axes"
    words = f"better with {effects} corrected, but something is still missing"
    assert answers(found)[2:] == [("both in motion", "partly_explained", words)]
    # what is given to one sensor is none of the other's
    assert [c["status"] for c in motion_of(found)["candidates"]] == ["added"]
    # at its floor, or without a test, motion is no answer
    assert len(answers(diagnosis("consistent"))) == len(answers({})) == 2


def test_moves_that_a_knock_spoiled_are_counted_and_what_to_do_is_said():
    block = motion_of(diagnosis("unexplained", left_out=17))
    why = "a knock between two samples, lost samples, a tilt at the rest beside it or clipping"
    assert f"Left out, for {why}: 17 of 37 moves." in sentence(BOTH, block)
    assert "Low-pass the accelerometer" in what_next(block)
    # one knock in 37 moves is none of the others
    assert "Low-pass" not in what_next(motion_of(diagnosis("unexplained", left_out=1)))
