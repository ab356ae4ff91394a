"""Trials: reduction of the residual by a candidate, its test, and its detection limit."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.stats import kstest

from diagnose.rows import Column, N, T, rows, search
from imuloop.estimate.choice import Choices
from imuloop.estimate.limits import detection_limits
from seeds import seeds

LINE = np.column_stack([np.ones(N), T])
WAVE = {Column(): np.sin(9 * T)}


@dataclass(frozen=True)
class Drift(Column):
    name, after_temperature, needs = "drift", True, ()


@dataclass(frozen=True)
class Warm(Column):
    name, needs = "warm", ("temperature",)


@dataclass(frozen=True)
class Late(Warm):
    price = 3.0


@pytest.mark.parametrize(("like", "first"), [(0.999, Warm), (0.6, Drift)])
def test_a_logged_cause_goes_before_time_where_it_explains_as_much(like, first):
    drift, other = np.sin(9 * T), np.cos(23 * T)
    columns = {Drift(): drift, Warm(): like * drift + np.sqrt(1 - like**2) * other}
    made = search(20 * drift + np.random.default_rng(1).normal(size=N), LINE, columns)
    trials = [made.trial((), cls) for cls in (Drift, Warm)]
    assert trials[0].log_p < trials[1].log_p < made.threshold(0)
    assert made.best_trial((), made.kinds).effect.kind is first


@pytest.mark.parametrize(("like", "chosen"), [(0.999, Warm), (0.6, Late)])
def test_a_constant_more_has_to_gain_its_price(like, chosen):
    true, other = np.sin(9 * T), np.cos(23 * T)
    made = search(
        5 * true + np.random.default_rng(1).normal(size=N),
        LINE,
        {Warm(): like * true + np.sqrt(1 - like**2) * other, Late(): true},
    )
    variants = Warm(), Late()
    tried = made.tests((), variants)
    best = made.best_variant((), variants, 0.0)
    assert (tried[1].log_p < tried[0].log_p - 3.0) == (chosen is Late)
    assert type(best.effect) is chosen
    paid = {Warm: tried[0].log_p, Late: tried[1].log_p + 3.0}[chosen]
    assert best.log_p == pytest.approx(paid)


def test_p_values_are_uniform_without_an_effect():
    rng = np.random.default_rng(2)
    drawn = [search(rng.normal(size=N), LINE, WAVE).trial((), Column).p_value for _ in range(200)]
    # conservative by a little: the scale is never below the noise model's
    assert kstest(drawn, "uniform").pvalue > 1e-3


@seeds(100, 300)
def test_an_effect_of_its_detection_limit_is_found_with_the_stated_power(seeds):
    rng, power, threshold = np.random.default_rng(3), 0.8, 0.005
    wave = WAVE[Column()]

    def choices(size):
        return Choices(rows(rng.normal(size=N) + size * wave, LINE, WAVE, threshold=threshold))

    quiet = []
    for _ in range(10):
        made = choices(0.0)
        quiet.append(detection_limits(made, (), made.trial((), Column), power)["p"])
    limit = np.median(quiet)
    # it passes the test, and parts that are held out keep it
    found = [choices(limit).choice().effects == (Column(),) for _ in range(seeds)]
    # three standard errors; a little less: the scale of the test is never below the noise model's
    assert np.mean(found) == pytest.approx(power, abs=1.2 / np.sqrt(seeds))
