"""Sizes of noise by the residuals: closed forms, the likelihood written out, known truth."""

import numpy as np
import pytest

from imuloop.estimate.noise_components import Component, likely_sizes, total_covariance

N = 40
T = np.arange(N)
LINE = np.column_stack([np.ones(N), T])
WALK = np.minimum.outer(T, T) / N


def test_the_likelihood_is_the_one_that_is_written():
    values = 1.5 * np.random.default_rng(2).normal(size=N) + 0.4 * T**0.5
    parts = [Component(WALK, 0.8, 0.5), Component(np.diag(T < 20).astype(float))]

    def log_probability(sizes):
        covariance = total_covariance(np.eye(N), parts, sizes)
        weight = np.linalg.inv(covariance)
        normal = LINE.T @ weight @ LINE
        residual = values - LINE @ np.linalg.solve(normal, LINE.T @ weight @ values)
        logs = np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(normal)[1]
        return -(logs + residual @ weight @ residual) / 2 - ((sizes[0] - 0.8) / 0.5) ** 2 / 2

    sizes_fitted = likely_sizes(values, LINE, np.eye(N), parts)
    best, step = log_probability(sizes_fitted), 0.02
    assert np.all(sizes_fitted > step)
    around = [sizes_fitted + step * np.array(d) for d in [(0, 1), (0, -1), (1, 0), (-1, 0), (1, 1)]]
    changes = [log_probability(sizes) - best for sizes in around]
    assert max(changes) < 0
    # the top is flat: as much either way
    assert changes[0] == pytest.approx(changes[1], rel=0.1)
    assert changes[2] == pytest.approx(changes[3], rel=0.1)
