"""Noise on a grid: kernels, tails, and p-values averaged over what the noise may be."""

import numpy as np
import pytest
from scipy.stats import combine_pvalues
from scipy.stats import f as f_distribution

from diagnose.records import record, root, search, windows
from imuloop.core.noise_model import Coefficient, NoiseModel
from imuloop.core.samples import CHANNELS
from imuloop.diagnose.static_noise import (
    GridNoise,
    log_f_tail,
    mean_covariance,
    ratios,
    unit_noise,
)
from imuloop.diagnose.static_search import fisher
from imuloop.effects.bias_temperature import BiasTemperature
from imuloop.effects.ramp import Ramp


def test_kernels_are_those_of_the_noise_model():
    at = windows(20)[[0, 1, 2, 5, 9, 19]]
    for name in "QNBK":
        noise = unit_noise(name)
        expected = NoiseModel("d", dict.fromkeys(CHANNELS, noise)).pose_mean_covariance(at)[0]
        np.testing.assert_allclose(mean_covariance(noise, at), expected, rtol=1e-12)


def test_the_grid_holds_precisions_of_white_flicker_and_walk():
    at, (grid, prior) = windows(30), ratios(1800.0, 60.0)
    assert np.exp(prior).sum() == pytest.approx(1)
    noise = GridNoise.of(at, grid)
    for point in (0, len(grid) // 2, len(grid) - 1):
        b, k = grid[point]
        axis = type(unit_noise("N"))(
            N=unit_noise("N").N, B=_known(np.sqrt(b)), K=_known(np.sqrt(k))
        )
        covariance = mean_covariance(axis, at)
        np.testing.assert_allclose(noise.precision[point] @ covariance, np.eye(30), atol=1e-7)
        assert noise.log_det[point] == pytest.approx(np.linalg.slogdet(covariance)[1])


def _known(value):
    return Coefficient(value, (value, value), value, True)


def test_tail_of_f_against_scipy_and_below_the_smallest_double():
    for q, dof, statistic in ((1, 40, 3.0), (3, 700, 5.0), (9, 60, 20.0)):
        expected = f_distribution.logsf(statistic, q, dof)
        assert log_f_tail(statistic, q, dof) == pytest.approx(expected, rel=1e-9)
    # with two degrees of freedom the tail is (1 + 2F/ν)^(-ν/2)
    for dof, statistic in ((100, 1e9), (4000, 50.0), (4000, 3e3)):
        exact = -dof / 2 * np.log1p(2 * statistic / dof)
        assert log_f_tail(statistic, 2, dof) == pytest.approx(exact, rel=1e-9)


def test_combined_p_values_are_those_of_fisher():
    for p in ([0.3], [0.2, 1e-3], [0.9, 0.04, 1e-12]):
        assert fisher(np.log(p)) == pytest.approx(np.log(combine_pvalues(p).pvalue), rel=1e-9)


@pytest.mark.parametrize("flicker, walk", [(0, 0), (20, 0), (0, 5), (0, 300), (20, 30)])
def test_slow_noise_is_not_taken_for_a_smooth_effect(flicker, walk):
    rng, n = np.random.default_rng(3), 120
    made, effects = root(n, flicker, walk), [Ramp(), BiasTemperature(2, 20.0)]
    found = []
    for _ in range(25):
        one = search([record(made @ rng.standard_normal((n, 3)))], effects)
        found += [one.test((), pattern).p_value for (pattern,) in one.shapes.values()]
    # 50 tests of three axes each; at 1 % half a one is expected, five would be one in 1e3 runs
    assert np.sum(np.array(found) < 0.01) <= 4
    assert np.sum(np.array(found) < 1e-3) <= 1


def test_known_noise_is_tested_as_by_f():
    """White noise that is certain: the p-values are uniform or, slow noise not excluded, larger."""
    rng, n = np.random.default_rng(5), 60
    found = []
    for _ in range(100):
        one = search([record(rng.standard_normal((n, 3)) / np.sqrt(60))], [Ramp()])
        found.append(one.test((), one.shapes[Ramp][0]).p_value)
    for level in (0.05, 0.2, 0.5):
        # three standard deviations of a binomial share
        assert np.mean(np.array(found) < level) <= level + 3 * np.sqrt(level * (1 - level) / 100)
