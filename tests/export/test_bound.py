"""N and K that bound an Allan curve: never below it, never below their own, and no larger."""

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from calibrate.devices import coefficient
from imuloop.core.noise_model import AxisNoise, Coefficient, GaussMarkovTerm, SinusoidTerm
from imuloop.export.bound import LONGEST, POINTS, SHORTEST, bounding

# the times at which the bound is held, and nineteen between each two
TAU = np.geomspace(SHORTEST, LONGEST, 20 * (POINTS - 1) + 1)
HELD = TAU[::20]


def limited(value):
    return Coefficient(None, None, value, False)


def process(q, tc):
    return GaussMarkovTerm(coefficient(q), coefficient(tc))


def curve(noise, tau=TAU):
    return replace(noise, sinusoid=()).allan_variance(tau)


def bound(pair, tau=TAU):
    return pair[0] ** 2 / tau + pair[1] ** 2 * tau / 3


def powers(low, high):
    return st.floats(low, high).map(lambda power: 10**power)


sizes = powers(-6, -2).map(coefficient)
absent = st.just(Coefficient())
unseen = powers(-6, -2).map(limited)
noises = st.builds(
    AxisNoise,
    Q=absent | sizes,
    N=sizes | unseen,
    B=absent | sizes,
    K=sizes | unseen,
    R=absent | sizes,
    gauss_markov=st.lists(st.builds(process, powers(-7, -2), powers(-1, 5)), max_size=3).map(tuple),
)
# white noise of a gyroscope, 0.3 deg/sqrt(h), and a walk that was not seen
WHITE = AxisNoise(N=coefficient(8e-5), K=limited(1e-7))
FLICKER = replace(WHITE, B=coefficient(4e-5))


@given(noises)
def test_the_pair_bounds_the_curve_and_neither_can_be_lower(noise):
    pair, sizes_alone = np.array(bounding(noise)), np.array([noise.N.size, noise.K.size])
    assert (pair >= sizes_alone).all()
    assert (bound(pair, HELD) >= (1 - 1e-11) * curve(noise, HELD)).all()
    assert (bound(pair) >= 0.999 * curve(noise)).all()
    for lower in ([0.98, 1.0], [1.0, 0.98]):
        below_own = (pair * lower < sizes_alone).any()
        assert below_own or (bound(pair * lower) < (1 - 1e-9) * curve(noise)).any()


@given(N=sizes | unseen, K=sizes | unseen)
def test_white_noise_and_walk_alone_stay_as_they_are(N, K):
    assert bounding(AxisNoise(N=N, K=K)) == (N.size, K.size)
    assert bounding(AxisNoise(N=limited(0.0), K=limited(0.0))) == (0.0, 0.0)


def test_a_line_raises_nothing():
    line = SinusoidTerm(coefficient(1e-2), coefficient(0.05))
    assert bounding(replace(WHITE, sinusoid=(line,))) == (8e-5, 1e-7)
    assert bounding(replace(FLICKER, sinusoid=(line,))) == bounding(FLICKER)
