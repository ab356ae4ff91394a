"""The bench itself: its bound, its rivals and its true curves against closed forms; all tables."""

import numpy as np
import pytest

from bench.noise import accuracy, coverage, detection
from bench.noise.__main__ import document
from bench.noise.accuracy import RIVALS, lines, weighted
from bench.noise.bound import difference_covariance, relative_bound
from bench.noise.records import Scenario
from imuloop.core.noise_model import AxisNoise, Coefficient

TAU = np.geomspace(0.1, 3600, 44)


def exact_curve(**terms):
    noise = AxisNoise(**{k: Coefficient(v, identifiable=True) for k, v in terms.items()})
    return noise.allan_variance(TAU)


def test_bound_of_white_noise_and_walk_is_the_closed_one():
    # differences of white noise and walk: both diagonal in the sine transform
    n, rate, truth = 10_800, 10.0, {"N": 0.01, "K": 3e-4}
    chord = 2 - 2 * np.cos(np.pi * np.arange(1, n) / n)
    units = np.array([rate * chord, np.full(n - 1, 1 / rate)])
    squares = np.square(list(truth.values()))
    spectrum = squares @ units
    information = (units / spectrum) @ (units / spectrum).T / 2
    closed = np.sqrt(np.diag(np.linalg.inv(information))) / (2 * squares)
    found = relative_bound(Scenario("", truth), n, rate, "NK")
    assert list(found.values()) == pytest.approx(closed, rel=0.005)


@pytest.mark.parametrize("m", [1, 300])
def test_differences_have_twice_the_allan_variance(m):
    # exact for samples: N^2/tau, 3 Q^2/tau^2, the walk's (2 m^2 + 1)/6 m; flicker's flat part
    n, rate = 30_000, 10.0
    tau = m / rate
    found = {name: difference_covariance(name, m, 1, n, rate)[0] / 2 for name in "QNBK"}
    assert found["Q"] == pytest.approx(3 / tau**2)
    assert found["N"] == pytest.approx(1 / tau)
    assert found["K"] == pytest.approx((2 * m**2 + 1) / (6 * m) / rate)
    if m > 1:
        assert found["B"] == pytest.approx(2 * np.log(2) / np.pi, rel=0.02)


def test_rivals_read_an_exact_curve_as_their_tools_do():
    truth = {"Q": 0.02, "N": 0.01, "B": 8e-3, "K": 2e-3, "R": 2e-4}
    assert weighted(TAU, exact_curve(**truth)) == pytest.approx(truth, rel=1e-6)
    assert lines(TAU, exact_curve(N=0.01))["N"] == pytest.approx(0.01)
    assert lines(TAU, exact_curve(K=2e-4))["K"] == pytest.approx(2e-4)


def test_what_was_found_is_named_only_by_its_kind_and_place():
    line = detection.Case("line", 0.08, "white")
    hump = detection.Case("Gauss–Markov", 20.0, "white")
    assert line.is_named([("line", 0.08009)], 100_000)
    assert not line.is_named([("line", 0.08011)], 100_000)
    assert not line.is_named([("line", 0.08), ("Gauss–Markov", 20.0)], 100_000)
    assert hump.is_named([("Gauss–Markov", 39.0)], 100_000)
    assert not hump.is_named([("Gauss–Markov", 41.0)], 100_000)


def test_every_table_is_made(monkeypatch):
    length, cases = 3000, detection.CASES[1:6:4]
    monkeypatch.setattr(accuracy, "LENGTH", length)
    outcomes = {
        "accuracy": accuracy.run(1, map, length),
        "coverage": coverage.run(1, map, length),
        "detection": detection.run(1, map, 20_000, cases, detection.CONTROLS[:1]),
    }
    text = document(outcomes)
    assert "nan" not in text
    for part in ("| walk | N = 0.01 |", "Gauss–Markov of 20 s", *RIVALS):
        assert part in text
    assert text.count("## ") == 3
