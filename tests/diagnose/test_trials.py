"""Trials: what a candidate takes off the residual, its test, and what the test would have found."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import kstest

from diagnose.rows import Column, N, Other, T, rows, search
from imuloop.diagnose.choice import Choices
from imuloop.diagnose.limits import detection_limits
from imuloop.diagnose.records.pose_problem import PoseProblem
from seeds import seeds

LINE = np.column_stack([np.ones(N), T])
WAVE = {Column(): np.sin(9 * T)}


def test_what_the_base_model_takes_up_is_not_tried():
    made = search(T * 0, LINE, {Column(): 3 + 2 * T, Other(): np.zeros(N)})
    for cls in (Column, Other):
        assert made.trial((), cls) is None
        problem = SimpleNamespace(shapes={cls: (cls(),)}, scans={})
        assert "taken up by the base model" in PoseProblem.why_no_trial(problem, made, cls)


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
    assert made.best(()).effect.kind is first


@pytest.mark.parametrize(("like", "chosen"), [(0.999, Warm), (0.6, Late)])
def test_a_constant_more_has_to_gain_its_price(like, chosen):
    true, other = np.sin(9 * T), np.cos(23 * T)
    made = search(
        5 * true + np.random.default_rng(1).normal(size=N),
        LINE,
        {Warm(): like * true + np.sqrt(1 - like**2) * other, Late(): true},
    )
    shapes = Warm(), Late()
    tried = made.tests((), shapes)
    best = made.shaped((), shapes, 0.0)
    assert (tried[1].log_p < tried[0].log_p - 3.0) == (chosen is Late)
    assert type(best.effect) is chosen
    paid = {Warm: tried[0].log_p, Late: tried[1].log_p + 3.0}[chosen]
    assert best.log_p == pytest.approx(paid)


def test_a_nuisance_that_one_part_alone_shows_is_an_error_each_time_that_part_is_held_out():
    alone = np.column_stack([np.ones(N), np.arange(N) % 10 == 0]).astype(float)
    made = Choices(rows(T * 0, alone, WAVE)).search(frozenset({0}))
    for _ in range(2):
        with pytest.raises(np.linalg.LinAlgError):
            made.training_fit(()).residuals((), 0)


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
        made = choices(0.0).search()
        quiet.append(detection_limits(made, (), made.trial((), Column), power)["p"])
    limit = np.median(quiet)
    # it passes the test, and parts that are held out keep it
    found = [choices(limit).choice().base == (Column(),) for _ in range(seeds)]
    # three standard errors; a little less: the scale of the test is never below the noise model's
    assert np.mean(found) == pytest.approx(power, abs=1.2 / np.sqrt(seeds))


@pytest.mark.parametrize("elsewhere, shown", [(0.05, False), (0.5, True)])
def test_what_one_part_alone_shows_has_no_limit(elsewhere, shown):
    """Errors of a parameter that all others hardly know are in that part larger than the noise."""
    part, values = np.arange(N) % 10 == 0, np.random.default_rng(7).normal(size=N)
    columns = {Column(): np.where(part, 1.0, elsewhere * np.sin(40 * T))}
    made = search(values, LINE, columns)
    limits = detection_limits(made, (), made.trial((), Column), 0.9)
    assert bool(limits) == shown
