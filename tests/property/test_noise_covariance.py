"""The covariance of means over any windows of time, for any noise."""

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from calibrate.devices import coefficient
from imuloop.core.noise_model import AxisNoise, GaussMarkovTerm, NoiseModel, SinusoidTerm
from imuloop.core.samples import CHANNELS

sizes = st.one_of(st.just(0.0), st.floats(-6, 0).map(lambda power: 10**power)).map(coefficient)
times = st.floats(0.1, 1e4).map(coefficient)
noises = st.builds(
    AxisNoise,
    *[sizes] * 4,
    gauss_markov=st.lists(st.builds(GaussMarkovTerm, sizes, times), max_size=1).map(tuple),
    sinusoid=st.lists(st.builds(SinusoidTerm, sizes, times), max_size=1).map(tuple),
)


@st.composite
def windows(draw):
    """Up to twenty windows of 10 ms to 3 h; they may touch, overlap, or hold one another."""
    edges = np.cumsum(draw(st.lists(st.floats(0.01, 1e3), min_size=3, max_size=12)))
    pairs = st.tuples(*[st.integers(0, len(edges) - 1)] * 2).filter(lambda p: p[0] < p[1])
    chosen = draw(st.lists(pairs, min_size=1, max_size=20, unique=True))
    return edges[np.array(chosen)]


def model(noise):
    return NoiseModel("d", dict.fromkeys(CHANNELS, noise))


@settings(max_examples=60)
@given(noises, windows())
def test_it_is_symmetric_never_negative_and_knows_no_clock(noise, spans):
    # of the same lengths to the last bit: a line's mean over whole periods is next to nothing
    spans = (spans + 4096) - 4096
    c = model(noise).mean_covariance(spans)[0]
    later = model(noise).mean_covariance(spans + 4096)[0]
    np.testing.assert_allclose(later, c, atol=1e-7 * np.abs(c).max())
    np.testing.assert_array_equal(c, c.T)
    # judged on correlations, where no window outweighs another
    scale = np.sqrt(np.diag(c))
    assume(np.all(scale > 0))
    assert np.linalg.eigvalsh(c / (scale[:, None] * scale))[0] > -1e-6


@settings(max_examples=50)
@given(noises, st.lists(st.floats(0.01, 1e3), min_size=4, max_size=4))
def test_an_angle_is_the_sum_of_its_parts(noise, steps):
    a, b, c, d = np.cumsum(steps)
    spans = np.array([[a, b], [b, c], [a, c], [c, d]])
    length = np.diff(spans)[:, 0]
    covariance = model(noise).mean_covariance(spans)[0] * (length[:, None] * length)
    add = np.array([[1, 1, -1, 0.0]])
    # the difference of whole and parts is exactly nothing, with itself and with any other window
    assert np.abs(add @ covariance).max() <= 1e-9 * np.abs(covariance).max()
