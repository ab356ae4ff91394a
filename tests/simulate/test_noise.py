"""Simulated noise against the closed forms of the Allan variance and of the spectrum."""

from dataclasses import replace

import numpy as np
import pytest

from imuloop.noise.allan import allan_variance
from imuloop.simulate import noise
from imuloop.simulate.truth import Noise, Popcorn

DT = 0.01
LENGTHS = np.array([1, 3, 10, 100, 1000, 5000])
TAU = LENGTHS * DT
SEEDS = 40


# process, Allan variance of the handbook, shortest length at which it holds for a sampled process
PROCESSES = {
    "white": (lambda n, r: noise.white(n, DT, 0.7, r), 0.7**2 / TAU, 1),
    "quantisation": (lambda n, r: noise.quantisation(n, DT, 0.3, r), 3 * 0.3**2 / TAU**2, 1),
    "flicker": (
        lambda n, r: noise.flicker(n, DT, 0.5, r),
        np.full(len(TAU), 2 * np.log(2) / np.pi * 0.5**2),
        10,
    ),
    "walk": (
        lambda n, r: noise.walk(n, DT, 2.0, r),
        2.0**2 * DT * (2 * LENGTHS**2 + 1) / (6 * LENGTHS),
        1,
    ),
}


@pytest.mark.parametrize("process", PROCESSES)
def test_allan_variance_is_the_closed_form(process):
    make, expected, shortest = PROCESSES[process]
    variances = np.array(
        [allan_variance([make(50_000, np.random.default_rng(k))], LENGTHS) for k in range(SEEDS)]
    )
    error = variances.mean(axis=0) / expected - 1
    # four standard errors of the mean, and 1 % for what sampling does at short times
    bound = 4 * variances.std(axis=0) / np.sqrt(SEEDS) / expected + 0.01
    holds = LENGTHS >= shortest
    assert np.all(np.abs(error[holds]) < bound[holds]), error


def test_flicker_does_not_close_on_itself():
    # a record as long as the synthesis' period would end where it began
    ends = [noise.flicker(20_000, DT, 1.0, np.random.default_rng(s))[[0, -1]] for s in range(200)]
    start, end = np.transpose(ends)
    neighbours = noise.flicker(20_000, DT, 1.0, np.random.default_rng(0))
    assert np.std(end - start) > 1.5 * np.std(np.diff(neighbours))


def axis(coefficients, number=0, seed=5):
    return noise.axis_noise(2000, DT, coefficients, number, np.random.SeedSequence(seed))


@pytest.mark.parametrize(
    "more", [Noise(Q=(1.0, 0, 0)), Noise(steps=(Popcorn((1.0, 0, 0), (3.0, 7.0)),))]
)
def test_one_process_does_not_move_another(more):
    white = Noise(N=(0.2, 0.3, 0.4))
    both = replace(more, N=white.N)
    assert np.any(axis(more))
    np.testing.assert_allclose(axis(both), axis(white) + axis(more), rtol=0, atol=1e-12)
