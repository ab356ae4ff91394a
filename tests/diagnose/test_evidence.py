"""Fits of evidence against plain generalised least squares; p-values averaged over the noise."""

import numpy as np
import pytest
from scipy.stats import f as f_distribution

from diagnose.records import record, root, search
from imuloop.effects.drifts import Ramp
from imuloop.effects.temperature import BiasTemperature
from imuloop.estimate.axis_fit import log_f_tail


def test_tail_of_f_against_scipy_and_below_the_smallest_double():
    for q, dof, statistic in ((1, 40, 3.0), (3, 700, 5.0), (9, 60, 20.0)):
        expected = f_distribution.logsf(statistic, q, dof)
        assert log_f_tail(statistic, q, dof) == pytest.approx(expected, rel=1e-9)
    # with two degrees of freedom the tail is (1 + 2F/ν)^(-ν/2)
    for dof, statistic in ((100, 1e9), (4000, 50.0), (4000, 3e3)):
        exact = -dof / 2 * np.log1p(2 * statistic / dof)
        assert log_f_tail(statistic, 2, dof) == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("flicker, walk", [(0, 300), (20, 30)])
def test_slow_noise_is_not_taken_for_a_smooth_effect(flicker, walk):
    rng, n = np.random.default_rng(3), 120
    made, effects = root(n, flicker, walk), [Ramp(), BiasTemperature(2, 20.0)]
    found = []
    for _ in range(25):
        one = search([record(made @ rng.standard_normal((n, 3)))], effects)
        found += [one.test((), effect).p_value for effect in effects]
    # 50 tests of three axes each; at 1 % half a one is expected, five would be one in 1e3 runs
    assert np.sum(np.array(found) < 0.01) <= 4
    assert np.sum(np.array(found) < 1e-3) <= 1
