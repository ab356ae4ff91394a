"""The first words on a device: what was found, what it gains, what is left."""

from itertools import product

import pytest

from imuloop.report.card import card, headline
from imuloop.report.report import recorded
from imuloop.report.verdict import ABOVE, UNTESTED, VERDICTS
from report.plausible_diagnosis import residual

UNITS = {
    "gravity_norm": "m/s^2",
    "rotation": "rad",
    "bias": "rad/s",
    "velocity_vertical": "m/s",
    "reference_rotation": "rad",
}
WITHIN, OVER = (9e-3, 1e-3, 1e-3, 40), (9e-3, 3e-3, 1e-3, 40)


def block(verdict, name, *effects, **more):
    """Return a record with a residual, above its floor where the verdict says so."""
    if verdict == "not_testable":
        return UNTESTED | {"why": "too few"} | more
    above = verdict in ABOVE
    left = residual(UNITS[name], *(OVER if above else WITHIN))
    left |= {"chi2_before": 9.0, "chi2_after": 9.0 if above else 1.0}
    found = {"effects": [{"name": e} for e in effects], "residuals": {name: left}}
    return UNTESTED | {"verdict": verdict} | found | more


def error(what="vertical after a turn", final=None, **sizes):
    effects = ["g-sensitivity"] if final else []
    sizes = {"logged": None, "calibrated": 2e-3, "floor": 1e-3, "slow_noise": False} | sizes
    return {"what": what, "unit": "rad", "final": final, "effects": effects} | sizes


def said(force, turn, *loop):
    found = card({"sensors": {"accelerometer": force, "gyroscope": turn}}, loop)
    words = [found["found"], found["gain"], *(text for _, text in found["left"])]
    return [w.replace("\u202f", " ") for w in (*words, found["untested"]) if w]


GOOD = {"poses": block("consistent", "gravity_norm")}
TURN = {"poses": block("explained", "rotation", "g_sensitivity")}
NONE = {"poses": block("not_testable", ""), "motion": block("not_testable", "")}


@pytest.mark.parametrize(
    ("force", "turn", "words"),
    [
        (GOOD, TURN, ["Undeclared in the gyroscope: g-sensitivity.", "Left: nothing"]),
        (GOOD, GOOD, ["No undeclared effect found.", "Left: nothing beyond the noise."]),
        (NONE, NONE, ["Not testable."]),
        (GOOD, {}, ["No undeclared effect found.", "Left: nothing", "Not tested: gyroscope."]),
        (
            NONE | {"static_record": block("explained", "bias", "bias_temperature", "steps")},
            NONE | {"static_record": block("explained", "bias", "bias_temperature")},
            [
                "Undeclared in the accelerometer and gyroscope: bias over temperature; "
                "in the accelerometer: bias steps.",
                "Left: nothing beyond the noise.",
                "Not tested: scale and misalignment, which poses show.",
            ],
        ),
        (
            GOOD,
            TURN | {"static_record": block("unexplained", "bias")},
            [
                "Undeclared in the gyroscope: g-sensitivity.",
                "Still unexplained in the gyroscope: wander of the bias, 0.17 °/s where the noise "
                "alone gives 0.057 °/s.",
                "Nothing else beyond the noise.",
            ],
        ),
        (
            {"poses": block("unexplained", "gravity_norm")},
            NONE,
            [
                "No known effect found, yet something is missing.",
                "Still unexplained in the accelerometer: error of gravity's magnitude, 0.31 mg",
                "Not tested: gyroscope.",
            ],
        ),
        (
            GOOD | {"motion": block("partly_explained", "velocity_vertical", "lever_arm")},
            GOOD | {"motion": block("partly_explained", "velocity_vertical", "gyro_axis_delay")},
            [
                "Undeclared in the accelerometer: lever arm; in the gyroscope: delays between",
                "Still unexplained in motion: vertical velocity at the end of a move, 3.0 mm/s",
                "Nothing else beyond the noise.",
            ],
        ),
        (
            NONE,
            {"reference": block("partly_explained", "reference_rotation", "time_offset")},
            [
                "Undeclared in the gyroscope beside a reference: time offset.",
                "Still unexplained in the gyroscope or the reference: error of the rotation over",
                "Not tested: accelerometer. Not tested: "
                "gyroscope: scale and misalignment, which poses show, nor its bias at rest.",
            ],
        ),
    ],
)
def test_every_device_is_answered_in_the_same_order(force, turn, words):
    found = said(force, turn)
    assert len(found) == len(words)
    for text, start in zip(found, words, strict=True):
        assert text.startswith(start)
        assert text == start or not start.endswith(".")


def test_what_is_said_holds_for_every_verdict_of_every_record():
    """Protects a device from good news that not every record bears out."""
    names = ("gravity_norm", "bias", "rotation", "bias")
    for verdicts in product(VERDICTS, repeat=4):
        effects = (("steps",) if v in ("explained", "partly_explained") else () for v in verdicts)
        a, b, c, d = (block(v, n, *e) for v, n, e in zip(verdicts, names, effects, strict=True))
        force, turn = ({"poses": p, "static_record": s} for p, s in ((a, b), (c, d)))
        found = card({"sensors": {"accelerometer": force, "gyroscope": turn}}, [])
        tested = {*verdicts} - {"not_testable"}
        above = tested & {*ABOVE}
        text = " ".join([found["found"], *(words for _, words in found["left"])])
        assert found["found"].startswith("Undeclared ") == ("steps" in text)
        assert ("No undeclared effect found" in text) == (tested == {"consistent"})
        assert found["found"].startswith("Not testable") == (not tested)
        assert text.count("Still unexplained") == sum(v in ABOVE for v in verdicts)
        assert ("Left: nothing beyond the noise" in text) == bool(tested and not above)
        assert ("Nothing else beyond" in text) == bool(above and tested - above)
        assert {v for v, _ in found["left"]} >= above
        untested = tested and "not_testable" in verdicts[::2]
        assert bool(found["untested"]) == bool(untested)


def test_the_floor_is_said_with_what_it_takes():
    lost = {"error": 4e-3, "others": 1e-3, "rate_hz": 62.5, "enough_hz": 143.0}
    slow = TURN["poses"] | {"slow_noise": True}
    few = block("consistent", "rotation")
    few["residuals"]["rotation"]["undersampled"] = lost
    for turn, loop, words in (
        (TURN["poses"], error(), "Left: nothing beyond the noise, which alone gives 0.057°."),
        # slow noise that no rest shows is a guess
        (slow, error(), "Left: nothing beyond the noise, which alone may give 0.057°."),
        (few, error(), "Left: nothing beyond the noise and the rate of the log, which alone give"),
    ):
        found = said(GOOD, {"poses": turn}, loop)
        assert found[-1].startswith(words)


def test_a_residual_far_below_its_noise_is_no_good_news():
    left = residual("m/s^2", 3e-6, 3e-6, 1e-3, 13) | {"chi2_before": 6e-6, "chi2_after": 6e-6}
    quiet = {"poses": UNTESTED | {"verdict": "consistent", "residuals": {"gravity_norm": left}}}
    assert said(quiet, GOOD)[-1] == (
        "Accelerometer: far quieter than its own noise allows, corrected or filtered before it was "
        "logged."
    )


def test_a_residual_at_its_floor_is_not_said_to_be_above_it():
    def text(chi2):
        found = block("partly_explained", "rotation", "g_sensitivity")
        found["residuals"] = {"rotation": residual("rad", *WITHIN) | {"chi2_after": chi2}}
        return said(GOOD, {"poses": found})[1]

    end = "error of gravity's direction after a rotation, of which the fit leaves more than noise, "
    assert text(2.0).endswith(f"{end}reduced χ² 2.00.")
    assert text(0.9).endswith("after a rotation, in a part of the data.")


def test_a_gain_names_both_ends_of_each_step_and_its_factor():
    def gain(*loop):
        return card({}, loop)["gain"].replace("\u202f", " ")

    turn = error(final=1e-3, logged=0.1)
    path = "calibrating takes 5.7° to 0.11°, 50 times less; correcting the effect takes that to "
    expected = f"Vertical after a turn: {path}0.057°, 2.0 times less."
    # of the errors those that the effects lowered, or the first
    assert gain(error("a"), turn) == expected
    assert gain(error("a"), error("b")) == "A: 0.11°."
    bias = error("gyroscope's bias", 5e-4, effects=["a", "b"])
    assert gain(turn, bias) == (
        f"{expected} Gyroscope's bias: correcting the effects takes 0.11° to 0.029°, 4.0 times "
        "less."
    )
    # what did not fall is no gain
    slight = error("a", 1.95e-3, logged=1e-3)
    assert gain(slight) == (
        "A: calibrating takes 0.057° to 0.11°; correcting the effect takes that to 0.11°."
    )
    assert gain() == ""


def device(label, verdict, *loop):
    return {"label": label, "answers": [("gyroscope", verdict, "")], "loop": list(loop)}


def test_the_headline_is_the_largest_find_and_a_small_gain_is_none():
    good = device("A", "consistent", error())
    found = device("B", "explained", error(final=1.9e-3), error("gravity at rest", 1e-3))
    words = "undeclared g-sensitivity. Gravity at rest 0.11° → 0.057°"
    of_all = "Undeclared effects in 1 of 2 devices; largest: B, gravity at rest 0.11° → 0.057°"
    assert headline([good, found]) == of_all
    assert headline([found]) == f"B: {words}"
    # it is the device's own sentence
    assert all(size in card({}, found["loop"])["gain"] for size in ("0.11°", "0.057°"))
    slight = device("C", "explained", error(final=1.95e-3))
    assert headline([slight]) == "C: what was missing is small"
    assert headline([good, good]) == "2 devices: nothing is missing"
    # one sensor alone says nothing of the other
    half = good | {"answers": [*good["answers"], ("accelerometer", "not_testable", "")]}
    assert headline([half]) == "A: nothing is missing, where it could be tested"
    missing = device("D", "unexplained", error())
    assert headline([good, missing]) == "2 devices: something is still missing"
    assert headline([device("E", "not_testable")]) == "E: nothing could be tested"


def test_turns_that_were_left_out_are_said_first():
    turn = {"session": "poses", "start_s": 120.0, "end_s": 121.5, "angle": 0.5}
    good = {"poses": block("consistent", "rotation", contradicting=[turn])}
    assert "1 turn contradicts all others: poses from 120 to 121.5 s" in said(GOOD, good)[-1]


def test_days_of_some_devices_are_not_those_of_all():
    def logged(label, *starts):
        sessions = {f"s{i}": {"start": start} for i, start in enumerate(starts)}
        return {"label": label, "sessions": sessions}

    old, new = logged("A", "2021-09-22T10:00:00", None), logged("B", "2021-09-20T23:59:59")
    none = logged("C", None)
    assert recorded([old]) == "recorded 2021-09-22"
    assert recorded([old, new]) == "recorded 2021-09-20 to 2021-09-22"
    assert recorded([none, new]) == "recorded 2021-09-20 (B)"
    assert recorded([old, new, none]) == "recorded 2021-09-20 to 2021-09-22 (2 of 3)"
    assert recorded([none]) == ""
