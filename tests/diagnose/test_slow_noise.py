"""Slow noise of static records on a grid: kernels and precisions."""

import numpy as np
import pytest

from diagnose.records import windows
from imuloop.core.noise_model import Coefficient
from imuloop.diagnose.records.slow_noise import hypotheses, ratios, unit_noise


def test_the_grid_holds_precisions_of_white_flicker_and_walk():
    at, (grid, prior) = windows(30), ratios(1800.0, 60.0)
    assert np.exp(prior).sum() == pytest.approx(1)
    noise = hypotheses(at, grid)
    for point in (0, len(grid) // 2, len(grid) - 1):
        b, k = grid[point]
        axis = type(unit_noise("N"))(
            N=unit_noise("N").N, B=_known(np.sqrt(b)), K=_known(np.sqrt(k))
        )
        covariance = axis.mean_covariance(at)
        np.testing.assert_allclose(noise.precision[point] @ covariance, np.eye(30), atol=1e-7)
        assert noise.log_det[point] == pytest.approx(np.linalg.slogdet(covariance)[1])


def _known(value):
    return Coefficient(value, (value, value), value, True)
