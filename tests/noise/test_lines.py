"""Lines against simulated truth, exact bounds and the sampling theorem."""

import numpy as np
import pytest
from scipy.signal import lfilter

from imuloop.noise.layout import Layout
from imuloop.noise.lines import Line, _summary, detection_limit, find_line, mains, means
from imuloop.noise.periodogram import one_frequency
from imuloop.noise.waves import Wave, fit_wave, follow, highest

RATE = 100.0
LEVEL = 0.01


def white_density(f):
    return 2.0 + 0 * f


def noise(kind, rng, n):
    """Return n samples with N = 1 and another process, and the one-sided density of both."""
    x = rng.standard_normal(n) * np.sqrt(RATE)
    if kind == "white":
        return x, white_density
    if kind == "quantised":
        return np.round(x / 20) * 20, white_density
    if kind == "flicker":
        f = np.fft.rfftfreq(2 * n, 1 / RATE)
        f[0] = f[1]
        z = rng.standard_normal((2, f.size)) * np.sqrt(9 / (np.pi * f) * RATE * n / 2)
        return x + np.fft.irfft(z[0] + 1j * z[1])[:n], lambda f: 2 + 9 / (np.pi * f)
    if kind == "walk":
        walk = np.cumsum(rng.standard_normal(n)) * 2 / np.sqrt(RATE)
        return x + walk, lambda f: 2 + 8 / (2 * np.pi * f) ** 2
    a = np.exp(-1 / RATE)
    hump = lfilter([1], [1, -a], rng.standard_normal(n + 1000) * np.sqrt(4.5 * (1 - a**2)))[1000:]
    return x + hump, lambda f: 2 + 18 / (1 + (2 * np.pi * f) ** 2)


def session(x, gaps=False, levels=(0, 0, 1)):
    n = len(x)
    ends = [(0, n // 10), (n // 8, n // 2), (int(0.7 * n), n)] if gaps else [(0, n)]
    layout = Layout(
        RATE,
        tuple(a for a, _ in ends),
        tuple(b - a for a, b in ends),
        levels if gaps else (0,),
    )
    return layout, [x[a:b].copy() for a, b in ends]


def sinusoid(n, frequency, amplitude, phase):
    return amplitude * np.cos(2 * np.pi * frequency * np.arange(n) / RATE + phase)


def test_chance_at_one_frequency_is_that_of_drawn_medians():
    rng = np.random.default_rng(1)
    medians = np.median(rng.exponential(size=(40_000, 3, 25)), axis=2).max(axis=1)
    for x in (1.0, 5.0, 10.0):
        assert one_frequency(x, 25, 3) == pytest.approx(np.exp(-x * medians).mean(), rel=0.02)


@pytest.mark.parametrize("gaps", [False, True])
def test_noise_has_lines_as_often_as_the_level_says(gaps):
    kinds, seeds, level = ("white", "quantised", "flicker", "walk", "gauss_markov"), 80, 0.1
    found = {kind: 0 for kind in kinds}
    for kind in kinds:
        for seed in range(seeds):
            x, density = noise(kind, np.random.default_rng([seed, gaps, len(kind)]), 1500)
            layout, values = session(x, gaps)
            values[-1] += 500.0 * gaps
            found[kind] += find_line([layout], [values], density, level) is not None
    # binomial: 3 standard errors of all, 4 of one kind
    total = sum(found.values()) / (len(kinds) * seeds)
    assert total == pytest.approx(level, abs=3 * np.sqrt(0.09 / (len(kinds) * seeds))), found
    assert max(found.values()) <= level * seeds + 4 * np.sqrt(0.09 * seeds), found


@pytest.mark.parametrize("gaps", [False, True])
def test_intervals_hold_and_limit_is_found_nine_times_in_ten(gaps):
    n, seeds, hits = 2000, 60, {}
    for times in (1, 3):
        rows = []
        for seed in range(seeds):
            rng = np.random.default_rng([seed, times, gaps])
            x, density = noise("white", rng, n)
            layout, _ = session(x, gaps)
            f = rng.uniform(2.0, 45.0)
            amplitude = times * detection_limit([layout], density, f, LEVEL)
            x += sinusoid(n, f, amplitude, rng.uniform(0, 2 * np.pi))
            line = find_line([layout], [session(x, gaps)[1]], density, LEVEL)
            if line is None or abs(line.frequency - f) > RATE / n:
                continue
            rows.append(
                (
                    line.frequency_ci95[0] <= f <= line.frequency_ci95[1],
                    line.amplitude_ci95[0] <= amplitude <= line.amplitude_ci95[1],
                )
            )
        hits[times] = (len(rows) / seeds, *np.mean(rows, axis=0))
    assert 0.8 <= hits[1][0] <= 0.99, hits
    assert hits[3][0] >= 0.97, hits
    assert all(0.89 <= share <= 1.0 for share in hits[3][1:]), hits


def test_intervals_are_the_bounds_of_rife_and_boorstyn():
    # var A = 2 s^2/n, var f = 6 s^2 rate^2/(pi^2 A^2 n^3) for white noise of variance s^2
    n, amplitude = 100_000, 5.0
    x, density = noise("white", np.random.default_rng(5), n)
    layout, values = session(x + sinusoid(n, 12.3456, amplitude, 1.0))
    line = find_line([layout], [values], density, LEVEL)
    half = np.diff(line.amplitude_ci95)[0] / 2, np.diff(line.frequency_ci95)[0] / 2
    assert half[0] == pytest.approx(1.96 * np.sqrt(2 * RATE / n), rel=0.06)
    bound = np.sqrt(6 * RATE**3 / n**3) / (np.pi * amplitude)
    assert half[1] == pytest.approx(1.96 * bound, rel=0.1)


@pytest.mark.parametrize("kind", ["white", "flicker", "walk"])
def test_a_line_of_four_periods_is_found_at_three_limits(kind):
    found, seeds, n = 0, 40, 5000
    for seed in range(seeds):
        x, density = noise(kind, np.random.default_rng(seed), n)
        layout, _ = session(x)
        amplitude = 3 * detection_limit([layout], density, 0.08, LEVEL)
        x += sinusoid(n, 0.08, amplitude, seed)
        line = find_line([layout], [[x]], density, LEVEL)
        found += line is not None and abs(line.frequency - 0.08) < RATE / n
    assert found >= 0.9 * seeds


@pytest.mark.parametrize("frequency", [0.0713, 1.234567, 23.4, 49.7])
def test_a_strong_line_leaves_nothing_across_gaps_and_levels(frequency):
    n = 6000
    rng = np.random.default_rng(2)
    x = 1e-4 * rng.standard_normal(n)
    layout, clean = session(x, gaps=True)
    values = session(x + sinusoid(n, frequency, 3.0, 0.4) + 0.002 * np.arange(n), gaps=True)[1]
    values[-1] += 9.8
    line = find_line([layout], [values], lambda f: 2e-10 + 0 * f, LEVEL)
    assert line.frequency == pytest.approx(frequency, abs=1e-6)
    assert line.amplitude == pytest.approx(3.0, abs=1e-4)
    rest = line.subtract([layout], [values])[0]
    t = np.array(layout.starts)
    for a, y, z in zip(t, rest, clean, strict=True):
        left = y - z - 0.002 * np.arange(a, a + len(y))
        assert np.std(left) < 1e-4


def test_sessions_have_their_own_phase_and_clock_and_may_lack_the_line():
    n = 20_000
    rng = np.random.default_rng(4)
    lines = [(8.0, 0.3), (8.0 * (1 + 3e-5), 2.0), None]
    clean = [rng.standard_normal(n) * np.sqrt(RATE) for _ in lines]
    values = [
        [x + (0 if w is None else sinusoid(n, w[0], 2.0, w[1]))]
        for x, w in zip(clean, lines, strict=True)
    ]
    layouts = [session(x)[0] for x in clean]
    line = find_line(layouts, values, white_density, LEVEL)
    assert {wave.session for wave in line.waves} == {0, 1}
    rest = line.subtract(layouts, values)
    assert rest[2][0] is values[2][0]
    for i in range(2):
        assert np.std(rest[i][0] - clean[i]) < 3 * np.sqrt(3 * RATE / n)
    assert find_line(layouts, rest, white_density, LEVEL) is None


def test_a_log_that_repeats_itself_gives_no_wave_for_each_of_its_parts():
    # most frequencies of the whole are empty then, those of its parts are not
    x = np.tile(np.random.default_rng(1).standard_normal(50_000) * np.sqrt(RATE), 4)
    layout, values = session(x)
    assert len(find_line([layout], [values], white_density, LEVEL).waves) == 1


def test_a_line_that_wanders_is_one_line():
    n = 200_000
    rng = np.random.default_rng(6)
    wander = lfilter([1], [1, -np.exp(-1 / 3e4)], rng.standard_normal(n))
    turns = np.cumsum(8.0 + 0.004 * wander / wander.std()) / RATE
    x = rng.standard_normal(n) * np.sqrt(RATE) + 5.0 * np.cos(2 * np.pi * turns)
    layout, values = session(x)
    line = find_line([layout], [values], white_density, LEVEL)
    assert len(line.waves) > 3
    assert line.frequency_ci95[0] < turns[-1] * RATE / n < line.frequency_ci95[1]
    assert line.amplitude == pytest.approx(5.0, rel=0.05)
    # what is left is none of half its amplitude
    again = find_line([layout], line.subtract([layout], [values]), white_density, LEVEL)
    assert again is None or again.amplitude < 1.0


def test_a_wander_of_stretches_that_never_change_is_followed_as_one_wave():
    k = np.arange(400)
    layout = Layout(RATE, tuple(50 * k), (20,) * len(k), (0,) * len(k))
    values = [np.full(20, x) for x in np.cos(np.pi * k / 2 + 3 * np.sin(np.pi * k / 100))]
    wave = fit_wave(layout, values, highest(layout, values, 0.5, 0.01), 0)
    assert follow(layout, values, wave, 1e-6) == [wave]


def test_a_line_of_part_of_a_period_in_a_short_session_stays_out_of_it():
    rng = np.random.default_rng(3)
    layouts = [session(np.zeros(n))[0] for n in (20_000, 500)]
    values = [[rng.standard_normal(n) * 10 + sinusoid(n, 0.08, 4.0, 1.0)] for n in (20_000, 500)]
    line = find_line(layouts, values, white_density, LEVEL)
    assert [wave.session for wave in line.waves] == [0]
    assert line.frequency == pytest.approx(0.08, abs=0.001)


def test_a_wave_is_no_slower_than_the_record_and_has_errors():
    rng = np.random.default_rng(4)
    for _ in range(40):
        walk = np.cumsum(rng.standard_normal(int(rng.integers(400, 3000))))
        layout, values = session(walk)
        wave = fit_wave(layout, values, RATE / walk.size, 0)
        assert wave.frequency * walk.size / RATE > 0.9
        assert 0 < wave.amplitude_std < np.inf and 0 < wave.frequency_std < np.inf


def test_what_a_line_left_lies_within_the_resolution_of_its_parts():
    def line(*waves):
        parts = tuple(Wave(i, a, b, f, 1.0, 0.0, 1.0, 0.1, 0.1) for i, a, b, f in waves)
        f = parts[0].frequency
        return Line(f, (f, f), 1.0, (1.0, 1.0), 0.0, parts)

    # parts of 100 s, and a session of 1000 s
    wanders = line((0, 0, 10_000, 0.55), (0, 10_000, 20_000, 0.57), (1, 0, 100_000, 0.56))
    for session_of, frequency, left in (
        (0, 0.541, True),
        (0, 0.539, False),
        (1, 0.5605, True),
        (1, 0.565, False),
        (2, 0.56, False),
    ):
        later = line((session_of, 0, 20_000, frequency))
        assert wanders.left(later, RATE) == left, (session_of, frequency)


def test_means_keep_their_place_and_level():
    x = np.arange(1000.0)
    layout = Layout(RATE, (0, 207, 500), (200, 7, 305), (0, 0, 1))
    stretches = [x[a : a + n] for a, n in zip(layout.starts, layout.lengths, strict=True)]
    (of_means,), (values,) = means([layout], [stretches], 10)
    assert of_means == Layout(RATE / 10, (0, 50), (20, 30), (0, 1))
    for start, y in zip(of_means.starts, values, strict=True):
        # the middles of the blocks
        assert y == pytest.approx(10 * (start + np.arange(len(y))) + 4.5)
    assert means([layout], [stretches], 500) == ([], [])


def test_a_steady_line_is_one_wave():
    for seed in range(20):
        x, density = noise("white", np.random.default_rng(seed), 20_000)
        layout, values = session(x + sinusoid(20_000, 9.87, 4.0, seed))
        assert len(find_line([layout], [values], density, LEVEL).waves) == 1


def test_intervals_do_not_reach_below_zero():
    wave = Wave(0, 0, 1000, 0.2, 1.0, 0.0, 1.0, amplitude_std=0.5, frequency_std=0.5)
    frequency, f95, amplitude, a95 = _summary([wave], 2.0, 1.0, freedom=2)
    assert f95[0] == a95[0] == 0.0 and f95[1] > frequency and a95[1] > amplitude


def test_a_line_ends_where_the_sensor_stops_changing():
    n = 40_000
    x = np.random.default_rng(5).standard_normal(n) * np.sqrt(RATE) + sinusoid(n, 7.3, 20.0, 0.4)
    x[n // 2 :] = 0.1
    found = find_line([session(x)[0]], [session(x)[1]], white_density, LEVEL)
    assert found.frequency == pytest.approx(7.3, abs=0.01)
    assert max(wave.end for wave in found.waves) <= n // 2 + n // 8


def test_a_resonance_beside_the_spectrum_is_no_line():
    # 2 Hz wide at 25 Hz, some 60 times the white noise, and not in the density
    found = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        r = np.exp(-np.pi * 2 / RATE)
        band = lfilter([1], [1, -2 * r * np.cos(np.pi / 2), r**2], rng.standard_normal(21_000))
        x = rng.standard_normal(20_000) * np.sqrt(RATE) + band[1000:] * np.sqrt(RATE)
        found += find_line([session(x)[0]], [[x]], white_density, LEVEL) is not None
    assert found <= 2


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_rounding_of_stretches_that_never_change_is_no_line(seed):
    starts = (0, 16, 100, 115, 129, 158, 172, 214, 228, 270, 285)
    lengths = (11, 9, 10, 9, 9, 9, 9, 9, 9, 9, 9)
    layout = Layout(4.807692, starts, lengths, tuple(range(11)))
    values = np.random.default_rng(seed).normal(size=11)
    stretches = [np.full(n, x) for n, x in zip(lengths, values, strict=True)]
    assert find_line([layout], [stretches], lambda f: 1e-34 + 0 * f, LEVEL) is None


@pytest.mark.parametrize("x", [np.full(5000, 9.8), np.zeros(5000), np.arange(40.0)])
def test_constant_and_short_records_have_no_line(x):
    layout, values = session(x)
    assert find_line([layout], [values], white_density, LEVEL) is None


def test_limit_is_infinite_where_nothing_is_searched():
    layout, _ = session(np.zeros(5000))
    assert detection_limit([layout], white_density, 0.05, LEVEL) == np.inf
    assert detection_limit([layout], white_density, 49.99, LEVEL) == np.inf


@pytest.mark.parametrize(
    ("frequency", "rate", "name"),
    [
        (50.01, 200.0, "50 Hz mains"),
        (100.05, 250.0, "50 Hz mains, its 2nd harmonic"),
        (4.0, 104.0, "50 Hz mains, alias of its 2nd harmonic"),
        (40.0, 100.0, "60 Hz mains, alias"),
        (12.0, 112.0, "50 Hz mains, alias of its 2nd harmonic"),
        (0.08, 100.0, None),
        (31.0, 100.0, None),
        (1.0, 2.0, None),
    ],
)
def test_mains_are_named(frequency, rate, name):
    assert mains(frequency, rate) == name


def test_sampled_harmonics_lie_where_mains_says():
    # the transform of a sampled harmonic, not the folding formula
    t = np.arange(4000) / 130.0
    for f0 in (50.0, 60.0):
        for h in range(1, 6):
            power = abs(np.fft.rfft(np.cos(2 * np.pi * h * f0 * t + 0.3)))
            frequency = np.fft.rfftfreq(t.size, 1 / 130.0)[power.argmax()]
            assert f"{f0:.0f} Hz mains" in mains(frequency, 130.0)


def test_a_name_is_seldom_an_accident():
    rng = np.random.default_rng(8)
    for rate, bound in ((100.0, 0.035), (200.0, 0.035), (1000.0, 0.012), (76.0, 0.1)):
        named = [mains(f, rate) is not None for f in rng.uniform(0, rate / 2, 4000)]
        assert 0 < np.mean(named) < bound
