"""The first words on a device: what was found, what it gains, what is left."""

from itertools import product

from imuloop.report.card import card
from imuloop.report.verdict import ABOVE, UNTESTED, VERDICTS
from report.plausible_diagnosis import residual

UNITS = {
    "gravity_norm": "m/s^2",
    "rotation": "rad",
    "bias": "rad/s",
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


def said(force, turn, *loop):
    found = card({"sensors": {"accelerometer": force, "gyroscope": turn}}, loop)
    words = [found["found"], found["gain"], *(text for _, text in found["left"])]
    return [w.replace("\u202f", " ") for w in (*words, found["untested"]) if w]


GOOD = {"poses": block("consistent", "gravity_norm")}


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


def test_a_residual_far_below_its_noise_is_no_good_news():
    left = residual("m/s^2", 3e-6, 3e-6, 1e-3, 13) | {"chi2_before": 6e-6, "chi2_after": 6e-6}
    quiet = {"poses": UNTESTED | {"verdict": "consistent", "residuals": {"gravity_norm": left}}}
    assert said(quiet, GOOD)[-1] == (
        "Accelerometer: far quieter than its own noise allows, corrected or filtered before it was "
        "logged."
    )


def test_turns_that_were_left_out_are_said_first():
    turn = {"session": "poses", "start_s": 120.0, "end_s": 121.5, "angle": 0.5}
    good = {"poses": block("consistent", "rotation", contradicting=[turn])}
    assert "1 turn contradicts all others: poses from 120 to 121.5 s" in said(GOOD, good)[-1]
