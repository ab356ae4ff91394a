"""The diagnosis in the report: units, ranking, twins, what is left, static records."""

import copy
import random

import numpy as np
import pytest

from imuloop.core.samples import TEMPERATURE, TIME
from imuloop.core.units import DEGREE, HOUR, STANDARD_GRAVITY
from imuloop.report.figures.bias import temperatures
from imuloop.report.numbers import NO_NUMBER
from imuloop.report.section import diagnosis_part
from imuloop.report.tables.candidates import ranked
from imuloop.report.tables.diagnosis import effect_table, steps_table
from imuloop.report.units import RESIDUAL, data_sheet
from imuloop.report.verdict import (
    RESIDUAL_WORDS,
    UNTESTED,
    answers,
    blocks,
    sentence,
    too_quiet,
)
from report.plausible_diagnosis import residual

G = STANDARD_GRAVITY
CHI2 = "chi2_before", "chi2_after"


# what a parameter of 1 in the unit of data sheets adds at a stimulus, both in SI
@pytest.mark.parametrize(
    ("si", "shown", "stimulus", "added"),
    [
        ("m/s^2 per K/s", "mg per K/min", 1 / 60, G / 1e3),
        ("m/s^2 per s", "mg/h", HOUR, G / 1e3),
        ("m/s^2 per (m/s^2)^2", "µg/g²", G**2, G / 1e6),
        ("m/s^2 per (m/s^2)^3", "µg/g³", G**3, G / 1e6),
        ("rad/s per m/s^2", "°/s per g", G, DEGREE),
        ("rad/s per (m/s^2)^2", "°/s per g²", G**2, DEGREE),
        ("rad/s per K/s", "°/s per K/min", 1 / 60, DEGREE),
        ("rad/s per (rad/s)^2", "ppm per °/s", DEGREE**2, 1e-6 * DEGREE),
        ("rad/s per (rad/s)^3", "ppm per (°/s)²", DEGREE**3, 1e-6 * DEGREE),
        ("1 per K", "ppm/K", 1.0, 1e-6),
    ],
)
def test_one_in_the_unit_of_a_data_sheet(si, shown, stimulus, added):
    display = data_sheet(si)
    assert display.unit == shown
    assert added / stimulus * display.factor == pytest.approx(1, rel=1e-12)


def test_the_ranking_does_not_depend_on_the_order_of_the_file(devices):
    block = devices["board"].diagnosis["sensors"]["gyroscope"]["poses"]
    shuffled = copy.deepcopy(block)
    random.Random(3).shuffle(shuffled["candidates"])
    names = [c["name"] for c in ranked(block)]
    assert names == [c["name"] for c in ranked(shuffled)]
    assert names == ["g_sensitivity", "bias_drift", "earth_rate", "bias_temperature"]
    force = devices["board"].diagnosis["sensors"]["accelerometer"]["poses"]
    assert [c["name"] for c in ranked(force)][:2] == ["cubic", "quadratic"]


def test_temperatures_are_those_of_the_windows(devices):
    session = devices["still"].sessions[0]
    start = 60.0 * np.arange(15)
    t, warmth = (session.samples[name] for name in (TIME, TEMPERATURE))
    inside = (t >= 120) & (t < 180)
    found = temperatures(session, start)
    assert found[2] == pytest.approx(warmth[inside].mean(), rel=1e-12)
    assert temperatures(devices["board"].sessions[0], start) is None


def test_parameters_are_named_by_time_and_session_and_runs_have_their_scatter():
    def table_of(name, values, unit, **constants):
        effect = {"name": name, "constants": constants, "parameters": values, "std": {}}
        effect |= {"units": dict.fromkeys(values, unit)}
        table = effect_table("gyroscope", "poses", effect)
        return [[cell.replace("\u202f", " ") for cell in row] for row in table.rows]

    steps = {f"h{k}{axis}": 1e-2 * k for k in (1, 2) for axis in "xyz"}
    rows = table_of("steps", steps, "rad/s", times=[30.0, 7200.0], sessions=["night", "day"])
    assert [row[0] for row in rows[2:4]] == ["h1z, night at 30.0 s", "h2x, day at 2.00 h"]
    runs = {f"s{k}{axis}": v for k, v in ((2, 0.02), (3, -0.02)) for axis in "xyz"}
    (row,) = (r for r in table_of("turn_on_bias", runs, "m/s^2", runs=3) if "cycles, x" in r[0])
    # 0.02 m/s^2; chi square with 2 degrees of freedom: 0.0506 and 7.378
    assert row[1:3] == ["2.04", "mg"] and "95 % interval 1.06 to 12.8 mg" in row[0]


def test_a_static_record_shows_what_the_correction_changed(devices):
    device = devices["still"]
    parts = [diagnosis_part(device, *each) for each in blocks(device.diagnosis)]
    parts = {p["title"]: p for p in parts}
    part = parts["Accelerometer, static record"]
    captions = [t.caption for t in part["effects"]]
    assert [c.split(":")[0] for c in captions][:2] == [
        "Accelerometer, static record",
        "bias_temperature, added to the accelerometer (static record)",
    ]
    noise = part["effects"][-1]
    assert noise.note == "What the effects explain is no noise."
    row = next(r for r in noise.rows if r[0].startswith("B"))
    # 1e-3 and 1e-4 m/s²
    assert row[1:3] == ("µg", "102.0\u202f±\u202f5.2 → 10.20\u202f±\u202f0.52")
    assert len(part["corrected"]) == len(part["bias"]) == 2
    assert "20.5 to 34.5 °C" in part["bias"][0].caption


def test_a_residual_far_below_its_noise_is_no_good_news():
    def block(n, chi2):
        left = residual("m/s^2", 3e-6, 3e-6, 1e-3, n) | dict.fromkeys(CHI2, chi2)
        return UNTESTED | {"verdict": "consistent", "residuals": {"gravity_norm": left}}

    said = sentence("accelerometer", block(13, 6e-6))
    assert "far below 1" in said and "p <\u202f10⁻¹⁰" in said and "corrected or filtered" in said
    assert too_quiet(block(13, 6e-6))[2] < 1e-9
    [(_, verdict, words), _] = answers({"sensors": {"accelerometer": {"poses": block(13, 6e-6)}}})
    assert verdict == "consistent" and words.startswith("far quieter than its own noise allows")
    # luck of few poses, and a floor that upper limits raise
    for n, chi2 in ((9, 1e-3), (11, 0.02), (38, 0.4), (38, 0.08)):
        assert too_quiet(block(n, chi2)) is None
        assert "corrected" not in sentence("accelerometer", block(n, chi2))


@pytest.mark.parametrize("verdict", ["consistent", "unexplained"])
def test_turns_that_were_sampled_too_slowly_are_said_with_the_rate_that_they_need(verdict):
    lost = {"error": 4e-3, "others": 1e-3, "rate_hz": 62.5, "enough_hz": 143.0}
    left = residual("rad", 4e-3, 4e-3, 4.2e-3, 20) | {"undersampled": lost}
    block = UNTESTED | {"verdict": verdict, "residuals": {"rotation": left}}
    said = sentence("gyroscope", block).replace("\u202f", " ")
    assert "62.5 Hz does not show adds 0.229° to the error of gravity's direction" in said
    assert "record at 150 Hz or more, or turn more slowly" in said
    [_, (_, _, words)] = answers({"sensors": {"gyroscope": {"poses": block}}})
    assert (words == "as good as its noise and the log's rate allow") == (verdict == "consistent")
    del left["undersampled"]
    assert "too slowly" not in sentence("gyroscope", block)


@pytest.mark.parametrize("verdict", ["consistent", "not_testable"])
def test_turns_that_contradict_all_others_are_said(verdict):
    turn = {"session": "poses", "start_s": 120.0, "end_s": 121.5, "angle": 0.5}
    left = {"rotation": residual("rad", 4e-3, 4e-3, 4.2e-3, 20)}
    block = UNTESTED | {"verdict": verdict, "residuals": left, "contradicting": [turn]}
    said = sentence("gyroscope", block)
    assert "1 turn contradicts all others: poses from 120 to 121.5 s, by 29°" in said
    block["contradicting"] = [turn, turn]
    assert "2 turns contradict all others" in sentence("gyroscope", block)


@pytest.mark.parametrize("kind", RESIDUAL_WORDS)
@pytest.mark.parametrize("own", [("m/s", "velocity_vertical"), ("m/s^2", "gravity_norm")])
def test_an_error_is_shown_in_its_own_unit_or_not_at_all(kind, own):
    """Protects what is printed of a residual that a block lacks: radians were shown as mm/s.

    Moves are tested with effects that lower the error of a rotation, which is no residual of
    theirs.
    """
    unit, name = own
    block = {"residuals": {name: residual(unit, 3.0, 2.0, 1.0)}, "confounded": []}
    tried = {"name": "scale_asymmetry", "status": "rejected", "why": "", "p_value": 0.1}
    added = tried | {"residual": kind, "heldout_before": 3.0, "heldout_after": 2.0}
    block["effects"] = [added | {"ratio_ci95": [0.5, 0.9], "units": {}}]
    for error in map(str, steps_table("gyroscope", "motion", block).rows[0][3:5]):
        assert (RESIDUAL[unit].unit in error) == (kind == name)
        assert (error == NO_NUMBER) == (kind != name)
