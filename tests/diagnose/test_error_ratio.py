"""The interval of the ratio of held-out errors: it covers the true ratio as often as it says."""

import numpy as np

from imuloop.estimate.held_out import ratio_interval


def covers(rng, parts):
    """Return whether the interval covers the ratio of drawn errors, noise and noise with more.

    The noise has heavy tails and is correlated from row to row; parts differ in length by two.
    """
    part = np.repeat(np.arange(parts), rng.integers(16, 33, parts))
    white = rng.standard_t(5, (len(part) + 1, 1)) / np.sqrt(5 / 3)
    noise, size = 0.8 * white[1:] + 0.6 * white[:-1], rng.uniform(0.3, 3.0)
    low, high = ratio_interval(part, noise + size * rng.normal(size=noise.shape), noise)
    return low < 1 / np.hypot(1, size) < high


def test_the_interval_covers_the_ratio():
    rng = np.random.default_rng(1)
    covered = [covers(rng, parts) for parts in (4, 5, 8, 10, 12) for _ in range(500)]
    assert 0.93 < np.mean(covered) < 0.97


def test_one_part_tells_nothing_and_equal_errors_have_the_ratio_one():
    errors = np.random.default_rng(2).normal(size=(40, 3))
    assert ratio_interval(np.zeros(40), errors, 0.5 * errors) == [0, np.inf]
    assert ratio_interval(np.arange(40) // 4, errors, errors) == [1, 1]
