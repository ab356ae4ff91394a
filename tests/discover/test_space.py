"""The space of composed effects: made of what is logged, each with its unit."""

from functools import partial

import numpy as np
import pytest

from imuloop.core.effect import Channels, FittedEffect
from imuloop.core.errors import ImuloopError
from imuloop.discover.space import Space, formulas
from imuloop.effects.discovered import Discovered, settling, turn_rate

RNG = np.random.default_rng(3)
T = 0.05 * np.arange(600)


def log():
    rate = np.where((T % 10 > 4)[:, None], 0.0, RNG.normal(size=(600, 3)) + 1.0)
    return Channels(T, RNG.normal(size=(600, 3)), rate, 20 + T / 10)


@pytest.mark.parametrize("sensor", ["accelerometer", "gyroscope"])
def test_every_term_has_a_unit_and_every_candidate_known_terms(sensor):
    terms, candidates = formulas(sensor, True, "fw")
    assert len(set(terms)) == len(terms) and len(set(candidates)) == len(candidates)
    assert {t for c in candidates for t in c} == set(terms)
    units = Discovered("; ".join(terms), sensor).units(sensor)
    assert len(units) == len(terms)
    assert all("output" not in unit for unit in units.values())


def test_without_a_temperature_no_term_takes_one():
    terms, _ = formulas("gyroscope", False, "fw")
    assert not any("T" in t or "R" in t for t in terms)


def test_a_formula_is_what_it_says():
    c = log()
    f, w, warm = c.output, c.other, c.temperature - 22.0
    effect = Discovered("x: fy^2*fz; z: wx*T; y: abs_fx", "accelerometer", 22.0)
    design = effect.design(c)
    np.testing.assert_allclose(design[:, 0, 0], f[:, 1] ** 2 * f[:, 2])
    np.testing.assert_allclose(design[:, 2, 1], w[:, 0] * warm)
    np.testing.assert_allclose(design[:, 1, 2], np.abs(f[:, 0]))
    assert np.count_nonzero(np.any(design != 0, axis=0)) == 3
    units = effect.units("accelerometer")
    assert units["c0x"] == "m/s^2 per (m/s^2)^3" and units["c2y"] == "m/s^2 per m/s^2"
    assert effect.needs == ("temperature",) and not effect.timed and not effect.reach
    assert Discovered("x: qx", "gyroscope").reach and Discovered("x: qx", "gyroscope").timed
    # of a gyroscope, its own output is the angular rate
    np.testing.assert_array_equal(Discovered("x: wx", "gyroscope").design(c)[:, 0, 0], f[:, 0])


@pytest.mark.parametrize("sensor", ["accelerometer", "gyroscope"])
def test_another_reference_temperature_moves_columns_among_each_other(sensor):
    c, (terms, _) = log(), formulas(sensor, True, "fw")

    def columns(reference):
        # less a constant, which is a bias
        found = Discovered("; ".join(terms), sensor, reference).design(c).reshape(1800, -1)
        levels = np.tile(np.eye(3), (600, 1))
        return found - levels @ np.linalg.lstsq(levels, found)[0]

    moved = Space(sensor, 22.0, terms, columns(22.0), ()).warmer(1.7)
    assert moved.reference_temperature == 23.7
    np.testing.assert_allclose(moved.columns, columns(23.7), rtol=1e-9, atol=1e-9)


def test_what_settles_counts_from_the_last_turn():
    # turns last from 0 to 4 s of each 10 s
    at = T == 14.0 + 5.0
    np.testing.assert_allclose(settling(log(), "accelerometer", 10)[at], np.exp(-0.5), rtol=0.02)
    assert np.all(turn_rate(log(), "accelerometer")[at] > 0.3)


@pytest.mark.parametrize("function", [partial(settling, tau=5), turn_rate])
def test_a_log_in_pieces_gives_the_same(function):
    c, past, found = log(), {}, []
    for i in range(0, 600, 150):
        piece = slice(max(i - 20, 0), i + 150)
        own = Channels(T[piece], c.output[piece], c.other[piece], past=past)
        found.append(function(own, "accelerometer")[-150:])
    np.testing.assert_allclose(np.concatenate(found), function(c, "accelerometer"), atol=1e-9)


def test_before_the_first_turn_nothing_settles():
    still = Channels(T, *np.zeros((2, 600, 3)))
    assert not settling(still, "gyroscope", 5).any() and not turn_rate(still, "gyroscope").any()


@pytest.mark.parametrize(
    "formula", ["x: fy^", "u: fx", "x: os.system", "x: fx*", "x: fx ;; y", "z: s0"]
)
def test_what_is_no_formula_is_refused(formula):
    content = {"name": "discovered", "constants": {"formula": formula}, "parameters": {}}
    with pytest.raises(ImuloopError, match="constants do not fit"):
        FittedEffect.from_dict(content)


def test_a_formula_goes_through_json():
    effect = Discovered("x: fy^2*fz", "accelerometer", 22.0)
    fitted = FittedEffect(effect, {"c0x": 2e-5}, {"c0x": 1e-6}, {"c0x": (-900.0, 900.0)})
    assert FittedEffect.from_dict(fitted.to_dict()) == fitted


@pytest.mark.parametrize(
    ("formula", "complexity"),
    [("x: fy^2*fz; y: T", (3, 0)), ("x: abs_fx", (2, 0)), ("z: s5; z: fx*s30", (2, 30))],
)
def test_what_is_simpler(formula, complexity):
    assert Discovered(formula).complexity == complexity


def test_a_time_constant_is_no_name_of_its_own():
    terms = ("z: s3", "z: s30", "z: s3*qy", "x: s3")
    own = Space("accelerometer", 25.0, terms, np.zeros((1, 4)), tuple((k,) for k in range(4)))
    assert own.kin(0) == {0, 1}
