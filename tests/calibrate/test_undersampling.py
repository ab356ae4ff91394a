"""What a slow log loses of turns by hand is foreseen; of others there is nothing to foresee."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calibrate import hand
from calibrate.devices import record_samples
from imuloop.calibrate.undersampling import aliased_turns
from imuloop.core.rotation import exponential, prefix_product, step_vectors
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import example_truth
from loggers import lose
from seeds import seeds

NOISE, TURNS = 2e-3, 40


def turn_of_samples(w, rate):
    """Return the turn that samples of a rate make."""
    steps = step_vectors(w, np.full(len(w) - 1, 1 / rate))
    return Rotation.from_quat(prefix_product(exponential(steps))[-1], scalar_first=True)


def foresee_error(turns, rate, noise=NOISE, rng=None):
    """Return the result of `aliased_turns` for turns, one after the other in a log."""
    last = np.cumsum([len(w) for w in turns]) - 1
    w = np.concatenate(turns)
    if noise:
        w = w + noise * rng.standard_normal(w.shape)
    shape = len(turns), 3
    where = np.append(0, last[:-1] + 1), last
    return aliased_turns(
        np.arange(len(w)) / rate, w, *where, np.zeros(shape), np.full(shape, noise**2)
    )


def draw_turns(seed, rate):
    """Return turns as they are and as they are logged, and the generator."""
    rng = np.random.default_rng(seed)
    whole = [hand.turn(rng) for _ in range(TURNS)]
    return whole, [hand.sample_rate(w, rate, rng) for w in whole], rng


@seeds(5, 20)
@pytest.mark.parametrize("rate", [50, 62.5, 100])
def test_the_error_of_turns_by_hand_is_foreseen_within_20_per_cent(seeds, rate):
    expected, found = [], []
    for seed in range(seeds):
        whole, logged, rng = draw_turns(seed, rate)
        expected.append(foresee_error(logged, rate, rng=rng)[0])
        for w, own in zip(whole, logged, strict=True):
            lack = turn_of_samples(own, rate) * turn_of_samples(w, hand.RATE).inv()
            found.append(lack.as_rotvec() ** 2)
    assert np.sqrt(np.mean(expected) / np.mean(found)) == pytest.approx(1, abs=0.2)


@pytest.mark.parametrize("share", [0.0, 0.03])
def test_turns_that_are_followed_lose_nothing_even_where_samples_are_lost(share):
    log = simulate_session(example_truth(), "multi_position", 3)
    made = record_samples(lose(log, share, np.random.default_rng(1)))
    assert len(made.rotations) and not made.rotations.aliased.any()


def test_without_noise_and_without_a_turn():
    size, *_ = foresee_error([np.zeros((50, 3))] * 3, 100, noise=0)
    assert not size.any()
    bell = np.outer(hand.bell(np.arange(100) / 100), [1, 2, 3])
    size, fall, *_ = foresee_error([bell] * 3, 100, noise=0)
    assert np.sqrt(size.max()) < 1e-5
    assert fall[0] > 5
