"""Lines against simulated truth, exact bounds and the sampling theorem."""

import numpy as np
import pytest

from imuloop.noise.lines import find_line, mains
from imuloop.noise.signal import Signal
from noise.one_record import line_limit
from seeds import least_count, seeds

RATE = 100.0
LEVEL = 0.01


def white_density(f):
    return 2.0 + 0 * f


def signal(x, gaps=False, step=0.0):
    """Return a Signal, whole or of three stretches, the last of a new level, a step away."""
    n = len(x)
    ends = [(0, n // 10), (n // 8, n // 2), (int(0.7 * n), n)] if gaps else [(0, n)]
    starts, lengths = np.transpose([(a, b - a) for a, b in ends])
    values = np.concatenate([x[a:b] + step * (a > n / 2) for a, b in ends])
    return Signal(RATE, starts, lengths, np.array([0, 0, 1])[: len(ends)], values)


def line_of(x, density=white_density, gaps=False):
    return find_line([signal(x, gaps)], density, LEVEL)


def sinusoid(n, frequency, amplitude, phase):
    return amplitude * np.cos(2 * np.pi * frequency * np.arange(n) / RATE + phase)


@seeds(15, 40)
@pytest.mark.parametrize("gaps", [False, True])
def test_intervals_hold_and_limit_is_found_nine_times_in_ten(gaps, seeds):
    n, hits = 2000, {}
    for times in (1, 3):
        rows = []
        for seed in range(seeds):
            rng = np.random.default_rng([seed, times, gaps])
            x, density = rng.standard_normal(n) * np.sqrt(RATE), white_density
            f = rng.uniform(2.0, 45.0)
            amplitude = times * line_limit(signal(x, gaps), density, f, LEVEL)
            line = line_of(x + sinusoid(n, f, amplitude, rng.uniform(0, 7)), density, gaps)
            if line is None or abs(line.frequency.value - f) > RATE / n:
                continue
            near = ((line.frequency.ci95, f), (line.amplitude.ci95, amplitude))
            rows.append([low <= truth <= high for (low, high), truth in near])
        hits[times] = (len(rows), *np.sum(rows, axis=0))
    assert least_count(seeds, 0.9, 0.02) <= hits[1][0] <= least_count(seeds, 0.9, 0.98), hits
    assert hits[3][0] >= 0.95 * seeds, hits
    assert all(count >= least_count(hits[3][0], 0.95, 0.02) for count in hits[3][1:]), hits


@pytest.mark.parametrize("frequency", [0.0713, 1.234567, 49.7])
def test_a_strong_line_leaves_nothing_across_gaps_and_levels(frequency):
    n = 6000
    x = 1e-4 * np.random.default_rng(2).standard_normal(n)
    with_line = signal(x + sinusoid(n, frequency, 3.0, 0.4) + 0.002 * np.arange(n), True, 9.8)
    line = find_line([with_line], lambda f: 2e-10 + 0 * f, LEVEL)
    assert line.frequency.value == pytest.approx(frequency, abs=1e-6)
    assert line.amplitude.value == pytest.approx(3.0, abs=1e-4)
    (rest,) = line.subtract([with_line])
    expected = signal(x + 0.002 * np.arange(n), True)
    for y, z in zip(rest.split(rest.values), expected.split(expected.values), strict=True):
        assert np.std(y - z) < 1e-4


def test_sessions_have_their_own_phase_and_clock_and_may_lack_the_line():
    n, rng = 20_000, np.random.default_rng(4)
    clean = [rng.standard_normal(n) * np.sqrt(RATE) for _ in range(3)]
    lines = sinusoid(n, 8.0, 2.0, 0.3), sinusoid(n, 8.0 * (1 + 3e-5), 2.0, 2.0), np.zeros(n)
    signals = [signal(x + line) for x, line in zip(clean, lines, strict=True)]
    line = find_line(signals, white_density, LEVEL)
    assert set(line.sinusoids) == {0, 1}
    rest = line.subtract(signals)
    assert rest[2] is signals[2]
    for i in range(2):
        assert np.std(rest[i].values - clean[i]) < 3 * np.sqrt(3 * RATE / n)
    assert find_line(rest, white_density, LEVEL) is None


def test_rounding_of_stretches_that_never_change_is_no_line():
    starts = np.array([0, 16, 100, 115, 129, 158, 172, 214, 228, 270, 285])
    lengths = np.array([11, 9, 10, 9, 9, 9, 9, 9, 9, 9, 9])
    values = np.random.default_rng(1).normal(size=11).repeat(lengths)
    rests = Signal(4.807692, starts, lengths, np.arange(11), values)
    assert find_line([rests], lambda f: 1e-34 + 0 * f, LEVEL) is None


@pytest.mark.parametrize(
    ("frequency", "rate", "name"),
    [
        (50.01, 200.0, "50 Hz mains"),
        (100.05, 250.0, "50 Hz mains, its 2nd harmonic"),
        (4.0, 104.0, "50 Hz mains, alias of its 2nd harmonic"),
        (40.0, 100.0, "60 Hz mains, alias"),
        (0.08, 100.0, None),
        (31.0, 100.0, None),
        (1.0, 2.0, None),
    ],
)
def test_mains_are_named(frequency, rate, name):
    assert mains(frequency, rate) == name
