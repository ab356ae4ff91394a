from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from imuloop.core.noise_model import AxisNoise, Coefficient, GaussMarkovTerm
from imuloop.noise import gains
from imuloop.noise.axis import estimate_axis, find_lines
from imuloop.noise.modes import modes
from imuloop.noise.settings import NoiseSettings
from imuloop.noise.signal import Signal
from imuloop.simulate.noise import flicker, quantisation, ramp, walk, white
from noise.one_record import estimate_record, gauss_markov, line_limit, unbroken
from seeds import least_count, seeds

SETTINGS = NoiseSettings()
N, RATE = 30_000, 10.0
DT = 1 / RATE


def record(seed, Q=0.0, W=0.01, B=0.0, K=0.0, R=0.0, hump=None, line=None, n=N):
    rng = np.random.default_rng(seed)
    x = white(n, DT, W, rng) + ramp(n, DT, R)
    x += quantisation(n, DT, Q, rng) + flicker(n, DT, B, rng) + walk(n, DT, K, rng)
    if hump:
        x += gauss_markov(n, DT, *hump, rng)
    if line:
        amplitude, frequency = line
        x += amplitude * np.sin(2 * np.pi * (frequency * DT * np.arange(n) + rng.random()))
    return x


WHOLE = unbroken(RATE, N)
BASIS = modes([WHOLE])


def estimates(seeds, **truth):
    records = (record(seed, **truth) for seed in range(seeds))
    return [estimate_axis(BASIS, [replace(WHOLE, values=x)], SETTINGS).noise for x in records]


# what is put in, what is to come back with its largest error, root mean square and relative, and
# what is not to be found
CASES = {
    # the bound is 1/sqrt(2n)
    "white": ({}, {"N": (0.01, 1.4 / np.sqrt(2 * N))}, "QBKR"),
    "walk": ({"K": 3e-4}, {"K": (3e-4, 0.22)}, ""),
    "flicker and quantisation": ({"B": 4e-3, "Q": 5e-3}, {"B": (4e-3, 0.1), "Q": (5e-3, 0.1)}, ""),
    "ramp": ({"R": 1e-5}, {"R": (1e-5, 0.1)}, "K"),
    "hump": ({"hump": (4e-3, 20.0)}, {"q": (4e-3, 0.3), "tc": (20.0, 0.5)}, ""),
}


@seeds(5, 20)
@pytest.mark.parametrize("case", CASES)
def test_what_is_there_comes_back_within_its_interval_and_nothing_else_does(case, seeds):
    truth, expected, absent = CASES[case]
    noises = estimates(seeds, **truth)
    for name, (value, most) in expected.items():
        coefficients = [
            getattr(f.gauss_markov[0] if name in ("q", "tc") else f, name) for f in noises
        ]
        assert all(c.identifiable for c in coefficients)
        assert np.sqrt(np.mean([(c.value / value - 1) ** 2 for c in coefficients])) < most, name
        inside = sum(c.ci95[0] <= value <= c.ci95[1] for c in coefficients)
        assert inside >= least_count(seeds, 0.95, 0.01), name
    for name in absent:
        coefficients = [getattr(f, name) for f in noises]
        assert sum(c.identifiable for c in coefficients) <= seeds / 5, name
        missing = [c for c in coefficients if not c.identifiable]
        assert all(c.value is c.ci95 is None and c.upper95 > 0 for c in missing)
    assert sum(bool(f.sinusoid) or len(f.gauss_markov) != ("q" in expected) for f in noises) <= (
        seeds / 5
    )
    if case == "white":
        # a walk crosses white noise within the record at sqrt(3) N/K
        assert np.sqrt(3) * 0.01 / 3000 < noises[0].K.upper95 < 3e-4


def test_a_line_is_found_and_leaves_the_rest_as_it_was():
    (plain,), (noise,) = estimates(1), estimates(1, line=(0.005, 0.7))
    (line,) = noise.sinusoid
    assert line.frequency.value == pytest.approx(0.7, abs=1 / (N * DT))
    assert line.amplitude.ci95[0] <= 0.005 <= line.amplitude.ci95[1]
    assert noise.N.value == pytest.approx(plain.N.value, rel=1e-3)


SHORT = unbroken(RATE, 4000)
SHORT_BASIS = modes([SHORT])
SLOW = {"white": {}, "flicker": {"B": 6e-3}, "walk": {"K": 4e-3}, "hump": {"hump": (0.02, 10.0)}}


def slow_density(B=0.0, K=0.0, hump=(0.0, 1.0)):
    process = GaussMarkovTerm(*map(Coefficient, hump))
    noise = AxisNoise(
        N=Coefficient(0.01), B=Coefficient(B), K=Coefficient(K), gauss_markov=(process,)
    )
    return lambda f: gains.density(noise, f, RATE)


def short_lines(seed, amplitude=0.0, **truth):
    """Return the lines of a record of 400 s with four periods of a sinusoid."""
    x = record(seed, n=4000, line=(amplitude, 0.01), **truth)
    return find_lines(SHORT_BASIS, [replace(SHORT, values=x)], SETTINGS)[0]


@seeds(5, 20)
@pytest.mark.parametrize("kind", SLOW)
def test_a_line_of_four_periods_is_no_slow_noise(kind, seeds):
    density = slow_density(**SLOW[kind])
    amplitude = 3 * line_limit(SHORT, density, 0.01)
    lines = [short_lines(seed, amplitude, **SLOW[kind]) for seed in range(seeds)]
    # one over the record away
    near = [len(f) == 1 and abs(f[0].frequency.value - 0.01) < 0.0025 for f in lines]
    assert sum(near) >= 0.8 * seeds


@seeds(5, 20)
def test_slow_noise_is_no_line(seeds):
    alarms = {kind: sum(bool(short_lines(s, **SLOW[kind])) for s in range(seeds)) for kind in SLOW}
    assert sum(alarms.values()) <= seeds / 5, alarms


def test_a_gap_keeps_its_place_and_a_disturbance_ends_a_level():
    x = record(3, K=3e-4)
    whole = estimate_record(x, RATE, SETTINGS).noise
    x[15_000:] += 1.0
    values = np.r_[x[:14_000], x[15_000:]]
    cut = Signal(RATE, *np.array([[0, 15_000], [14_000, 15_000], [0, 1]]), values)
    moved = estimate_axis(modes([cut]), [cut], SETTINGS).noise
    assert moved.K.value == pytest.approx(whole.K.value, rel=0.3)
    one_level = replace(cut, levels=np.zeros(2, int))
    step = estimate_axis(modes([one_level]), [one_level], SETTINGS).noise
    assert step.K.value > 3 * moved.K.value


def test_a_spectrum_outside_the_model_widens_the_intervals():
    rng = np.random.default_rng(6)
    # two resonances of the table that are neither lines nor Gauss-Markov processes
    x = record(6)
    for low, high in ((0.3, 0.8), (1.5, 2.2)):
        band = butter(4, [low, high], "bandpass", fs=RATE, output="sos")
        x += 2 * sosfilt(band, white(N, DT, 0.01, rng))
    plain = estimate_record(record(6), RATE, SETTINGS)
    odd = estimate_record(x, RATE, SETTINGS)
    assert plain.misfit == 0 and odd.misfit > 0.1
    width = [np.diff(e.noise.N.ci95)[0] for e in (plain, odd)]
    assert width[1] > 5 * width[0]


def test_a_line_without_noise_is_one_line():
    t = np.arange(4000.0)
    noise = estimate_record(np.sin(t / 7.3), 1.0, SETTINGS).noise
    (line,) = noise.sinusoid
    assert line.amplitude.value == pytest.approx(1.0, rel=1e-9)
    assert noise.N.upper95 < 1e-11


@seeds(5, 20)
def test_three_seconds_give_white_noise_and_limits_of_the_rest(seeds):
    """The figures of docs/questions.md: 600 values at 200 Hz."""
    short = unbroken(200.0, 600)
    basis = modes([short])
    for seed in range(seeds):
        values = white(600, 1 / 200, 0.01, np.random.default_rng(seed))
        noise = estimate_axis(basis, [replace(short, values=values)], SETTINGS).noise
        assert np.ptp(noise.N.ci95) < 4 * 0.04 * 0.01 and abs(noise.N.value - 0.01) < 0.12 * 0.01
        assert not noise.B.identifiable and not noise.K.identifiable and noise.K.upper95 > 0
