"""Findings of a diagnosis: what is said of a device holds for every record of it."""

from itertools import product

import pytest

from imuloop.report.findings import ABOVE, UNTESTED, VERDICTS, answers, block_of, blocks, card
from imuloop.report.page import phrase

UNITS = {"gravity_norm": "m/s^2", "rotation": "rad", "bias": "rad/s"}
WITHIN, OVER = (9e-3, 1e-3, 1e-3, 40), (9e-3, 3e-3, 1e-3, 40)


def residual(unit, before, after, floor, n=24):
    block = {"unit": unit, "n": n, "floor": floor, "before": before, "after": after}
    return block | {"chi2_before": (before / floor) ** 2, "chi2_after": (after / floor) ** 2}


def record(verdict, name="rotation", *effects, **more):
    """Return a record with a residual, above its floor where the verdict says so."""
    if verdict == "not_testable":
        return UNTESTED | {"why": "too few"} | more
    above = verdict in ABOVE
    block = residual(UNITS[name], *(OVER if above else WITHIN))
    block |= {"chi2_before": 9.0, "chi2_after": 9.0 if above else 1.0}
    fields = {"effects": [{"name": e} for e in effects], "residuals": {name: block}}
    return UNTESTED | {"verdict": verdict} | fields | more


def diagnosis(force, turn=None):
    """Return a diagnosis, given the records of each sensor."""
    return {"sensors": {"accelerometer": force, "gyroscope": turn or {}}}


def verdict(content, sensor="gyroscope"):
    """Return the sentence on a record of poses."""
    block = block_of({"sensors": {sensor: {"poses": content}}}, sensor, "poses")
    return phrase("verdict", b=block).replace("\u202f", " ")


def test_what_is_said_holds_for_every_verdict_of_every_record():
    """Protects a device from good news that some record contradicts."""
    names = ("gravity_norm", "bias", "rotation", "bias")
    for verdicts in product(VERDICTS, repeat=4):
        effects = (("steps",) if v in ("explained", "partly_explained") else () for v in verdicts)
        a, b, c, d = (record(v, n, *e) for v, n, e in zip(verdicts, names, effects, strict=True))
        force, turn = ({"poses": p, "static_record": s} for p, s in ((a, b), (c, d)))
        answer = card(blocks(diagnosis(force, turn)), [])
        tested = {*verdicts} - {"not_testable"}
        above = tested & {*ABOVE}
        text = " ".join([answer["found"], *(words for _, words in answer["left"])])
        assert answer["found"].startswith("Hidden effect") == ("steps" in text)
        assert ("No hidden effect found" in text) == (tested == {"consistent"})
        assert answer["found"].startswith("Not testable") == (not tested)
        assert text.count("Still unexplained") == sum(v in ABOVE for v in verdicts)
        assert ("No error beyond the noise remains" in text) == bool(tested and not above)
        assert ("No other error is beyond" in text) == bool(above and tested - above)
        assert {v for v, _ in answer["left"]} >= above
        assert bool(answer["untested"]) == bool(tested and "not_testable" in verdicts[::2])


def test_a_residual_far_below_its_noise_is_no_good_news():
    def quiet(n, chi2):
        block = residual("m/s^2", 3e-6, 3e-6, 1e-3, n) | {"chi2_before": chi2, "chi2_after": chi2}
        return UNTESTED | {"verdict": "consistent", "residuals": {"gravity_norm": block}}

    records = blocks(diagnosis({"poses": quiet(13, 6e-6)}))
    assert "corrected or filtered" in verdict(quiet(13, 6e-6), "accelerometer")
    assert "far quieter than its noise allows" in answers(records)[0][2]
    assert "far quieter than its noise allows" in card(records, [])["left"][-1][1]
    # luck of few poses, and a floor that upper limits raise
    for n, chi2 in ((9, 1e-3), (11, 0.02), (38, 0.4), (38, 0.08)):
        assert "corrected" not in verdict(quiet(n, chi2), "accelerometer")


SIZES = {"rotation": ("rad", 19.6e-3, 19.6e-3, 18e-3), "pose_rate": ("rad/s", 2e-3, 2e-4, 1.8e-4)}
FELL = {"residuals": {name: residual(*sizes) for name, sizes in SIZES.items()}}
TURN = {"session": "poses", "start_s": 120.0, "end_s": 121.5, "angle": 0.5}
SLOW = {"error": 4e-3, "others": 1e-3, "rate_hz": 62.5, "enough_hz": 143.0}
SLOW = {"residuals": {"rotation": residual("rad", *OVER) | {"undersampled": SLOW}}}
CONTRADICTS = "1 turn contradicts all others and was left out: poses from 120 to 121.5 s, by 29°"
SAID = [
    # a verdict “explained” with a residual that stays as it was
    (record("explained", "rotation", "g_sensitivity") | FELL,
     "Residual angular rate at rest: held-out root mean square falls from 0.115 °/s to 0.0115 °/s"),
    (record("unexplained") | SLOW,
     "motion between samples adds 0.229°"),
    (record("consistent") | SLOW, "record at 150 Hz or more"),
    (record("consistent", contradicting=[TURN]), CONTRADICTS),
    (record("not_testable", contradicting=[TURN]), CONTRADICTS),
]  # fmt: skip


@pytest.mark.parametrize(("block", "words"), SAID)
def test_what_is_found_in_turns_is_said_with_its_numbers(block, words):
    assert words in verdict(block)
