"""Noise with a correlation time in window means: found where it is, and nowhere else."""

import numpy as np

from imuloop.noise.coloured import coloured, held_out_ratio, limits
from imuloop.noise.spectrum import coefficients, spectra
from imuloop.simulate.noise import flicker, gauss_markov, walk, white

LENGTH, PER_WINDOW = 2.0, 10


def means(seed, n=1500, B=0.3, K=0.01, q=0.0, tc=1.0):
    rng, dt = np.random.default_rng(seed), LENGTH / PER_WINDOW
    count = n * PER_WINDOW
    axes = [
        white(count, dt, 1.0, rng)
        + flicker(count, dt, B, rng)
        + walk(count, dt, K, rng)
        + gauss_markov(count, dt, q, tc, rng)
        for _ in range(3)
    ]
    return np.array(axes).T.reshape(n, PER_WINDOW, 3).mean(axis=1)


def judged(values):
    axes = spectra([coefficients(values)])
    return coloured(axes, LENGTH), axes


def test_white_flicker_and_walk_are_no_process():
    kinds = ((0.0, 0.0), (0.5, 0.0), (0.0, 0.02), (0.3, 0.01))
    found = [judged(means(k, B=kinds[k % 4][0], K=kinds[k % 4][1]))[0].p_value for k in range(24)]
    assert np.sum(np.array(found) < 0.05) <= 4
    assert np.sum(np.array(found) < 0.005) <= 1


def test_a_process_of_its_detection_limit_is_found_and_three_of_it_measured():
    threshold, tc = np.log(0.002), 30.0
    plain, axes = judged(means(1))
    near, limit = limits(plain, axes, LENGTH, threshold, 0.9)
    assert near == plain.tc or plain.p_value > 0.002
    q = limits(type(plain)(0.0, tc, plain.tries, plain.variances, plain.std), axes,
               LENGTH, threshold, 0.9)[1][0]  # fmt: skip
    assert all(limit)
    hits = [judged(means(10 + k, q=q, tc=tc))[0].log_p < threshold for k in range(10)]
    # three axes have it, the limit is that of one
    assert np.mean(hits) >= 0.9
    found, _ = judged(means(50, q=3 * q, tc=tc))
    assert 0.5 < found.tc / tc < 2
    density = np.sqrt(2 * found.variances[:, 4] / found.tc)
    assert np.all(np.abs(density / (3 * q) - 1) < 0.35)


def test_held_out_blocks_tell_a_process_from_none():
    def ratio(values):
        blocks = [coefficients(b) for b in np.array_split(values, 8)]
        folds = [(blocks[:k] + blocks[k + 1 :], blocks[k : k + 1]) for k in range(8)]
        return held_out_ratio(folds, 2000, 0)

    value, (low, high) = ratio(means(3, q=2.0, tc=30.0))
    assert low <= value <= high < 1
    # a term more that is not there predicts nothing better
    assert ratio(means(4))[1][1] > 0.999
    # seven blocks that never change say of the eighth that it cannot be
    stuck = np.where(np.arange(len(means(4)))[:, None] < len(means(4)) * 7 // 8, 1e-200, means(4))
    assert np.all(np.isfinite(ratio(stuck)[1]))
    # and of an axis that is stuck they know nothing at all
    alive = len(np.array_split(stuck, 8)[-1])
    stuck = means(4) * np.where(np.arange(len(stuck))[:, None] < len(stuck) - alive, [1, 1, 0], 1)
    assert np.all(np.isfinite(ratio(stuck)[1]))
