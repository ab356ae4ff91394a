"""Spectrum and autocorrelation against scipy, definitions, closed forms and simulated records."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter, welch

from imuloop.core.noise_model import AxisNoise, Coefficient
from imuloop.noise import views as module
from imuloop.noise.allan import allan_variance
from imuloop.noise.layout import Layout
from imuloop.noise.settings import NoiseSettings
from imuloop.noise.views import (
    COLUMNS,
    LAGS,
    POINTS,
    VIEWS,
    autocorrelation,
    empty,
    label,
    power_spectrum,
    segment_lengths,
    views,
)

RATE = 50.0


def layout(lengths):
    starts = np.cumsum([0, *(n + 100 for n in lengths[:-1])])
    return Layout(RATE, tuple(starts), tuple(lengths), tuple(range(len(lengths))))


def coefficient(value):
    return Coefficient(value, (value, value), value, True)


def test_segments_span_both_ends_of_the_spectrum():
    assert segment_lengths(15) == []
    assert segment_lengths(1000) == [256]
    assert segment_lengths(17_280_000) == [1 << 23, 1 << 17, 1 << 11]


@pytest.mark.parametrize("length", [300, 9000, 400_000])
def test_each_point_is_a_mean_over_what_scipy_gives(length):
    rng = np.random.default_rng(0)
    x = rng.standard_normal(length) + 0.01 * np.cumsum(rng.standard_normal(length)) + 9.8
    f, density, _ = power_spectrum([x], RATE)
    longest, *_ = lengths = segment_lengths(length)
    grids = {n: welch(x, RATE, nperseg=n) for n in lengths}
    edges = np.geomspace(1.5 * RATE / longest, RATE / 2, POINTS + 1)
    assert len(f) <= POINTS and np.all(np.diff(f) > 0)
    assert f[0] == pytest.approx(2 * RATE / longest)
    for point, value in zip(f, density, strict=True):
        k = np.searchsorted(edges, point) - 1
        n = next((n for n in lengths[::-1] if edges[k] >= 16 * RATE / n), longest)
        grid, expected = grids[n]
        inside = (grid >= edges[k]) & (grid < edges[k + 1]) & (grid < RATE / 2)
        assert point == pytest.approx(grid[inside].mean())
        assert value == pytest.approx(expected[inside].mean(), rel=1e-9)


def test_low_end_of_a_long_record_is_that_of_the_whole_transform(monkeypatch):
    """Quantisation is the worst case for the means that stand in: all its power lies above."""
    rng = np.random.default_rng(1)
    length = 3_000_000
    x = 30 * np.diff(rng.standard_normal(length + 1)) + 0.1 * rng.standard_normal(length)
    f, density, _ = power_spectrum([x], RATE)
    assert segment_lengths(length)[0] > module.TRANSFORM
    monkeypatch.setattr(module, "TRANSFORM", 1 << 30)
    whole_f, whole, _ = power_spectrum([x], RATE)
    np.testing.assert_allclose(f, whole_f)
    # the ends of a segment hold different samples
    first = f < 17 * RATE / segment_lengths(length)[1]
    ratio = density[first] / whole[first]
    assert ratio.mean() == pytest.approx(1, abs=0.01) and ratio.std() < 0.1
    np.testing.assert_allclose(density[~first], whole[~first])


def test_cuts_and_levels_do_not_enter():
    rng = np.random.default_rng(2)
    stretches = [rng.standard_normal(n) for n in (5000, 200, 12, 9000)]
    moved = [x + 1e6 * i for i, x in enumerate(stretches)]
    for found, expected in zip(
        power_spectrum(moved, RATE), power_spectrum(stretches, RATE), strict=True
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-6)
    _, found, _ = autocorrelation(moved)
    np.testing.assert_allclose(found, autocorrelation(stretches)[1], atol=1e-9)


def test_spectrum_intervals_cover():
    """White noise in three stretches: 95 % of all points of 60 records hold 2 N^2."""
    rng = np.random.default_rng(3)
    inside, settings = [], NoiseSettings(views=("psd",))
    lengths = [30_000, 9000, 9001]
    for _ in range(60):
        table = views(layout(lengths), [rng.standard_normal(n) for n in lengths], "gx", settings)
        table = pd.DataFrame(table)
        inside.append((table.ci_low <= 2 / RATE) & (2 / RATE <= table.ci_high))
    inside = np.array(inside)
    thirds = [part.mean() for part in np.array_split(inside, 3, axis=1)]
    print("covered", thirds)
    assert thirds == pytest.approx([0.95] * 3, abs=0.015)


def test_spectrum_of_simulated_noise_is_the_models():
    """White noise, a Gauss-Markov process and a walk against `AxisNoise.density`."""
    rng = np.random.default_rng(4)
    n_samples, n, k, q, tc = 400_000, 0.02, 2e-3, 0.05, 3.0
    x = n * np.sqrt(RATE) * rng.standard_normal(n_samples)
    x += k / np.sqrt(RATE) * np.cumsum(rng.standard_normal(n_samples))
    decay = np.exp(-1 / (RATE * tc))
    step = q * np.sqrt(tc / 2 * (1 - decay**2))
    x += lfilter([1], [1, -decay], step * rng.standard_normal(n_samples))
    f, density, edf = power_spectrum([x], RATE)
    model = AxisNoise(N=coefficient(n), K=coefficient(k)).density(f, RATE)
    model = model + 2 * q**2 / (tc**-2 + (2 * np.pi * f) ** 2)
    score = (density / model - 1) / np.sqrt(2 / edf)
    # a sampled process folds what lies above half the rate: not there
    score = score[f < RATE / 8]
    assert np.abs(score.mean()) < 4 / np.sqrt(len(score))
    assert score.std() == pytest.approx(1, abs=0.15)


def test_autocorrelation_is_its_definition():
    rng = np.random.default_rng(5)
    # several blocks of the transform, lags longer than the short stretches
    stretches = [np.cumsum(rng.standard_normal(n)) for n in (150_000, 37, 1, 70_001)]
    lags, value, pairs = autocorrelation(stretches)
    assert lags[0] == 1 and lags[-1] == 15_000 and len(lags) <= LAGS
    centred = [x - x.mean() for x in stretches]
    power = sum(y @ y for y in centred) / sum(map(len, centred))
    for k in range(0, len(lags), 9):
        lag = lags[k]
        products = [y[lag:] @ y[: len(y) - lag] for y in centred if len(y) > lag]
        assert pairs[k] == sum(len(y) - lag for y in centred if len(y) > lag)
        assert value[k] == pytest.approx(sum(products) / pairs[k] / power, abs=1e-12)


def test_autocorrelation_of_a_gauss_markov_process():
    rng = np.random.default_rng(6)
    decay = np.exp(-1 / 20)
    x = lfilter([1], [1, -decay], rng.standard_normal(400_000))
    lags, value, _ = autocorrelation([x])
    near = lags <= 60
    np.testing.assert_allclose(value[near], np.exp(-lags[near] / 20), atol=0.03)


def test_band_of_white_noise_holds_95_percent_of_its_lags():
    rng = np.random.default_rng(7)
    settings = NoiseSettings(views=("autocorrelation",))
    lengths, inside = [3000, 1000], []
    for _ in range(100):
        table = views(layout(lengths), [rng.standard_normal(n) for n in lengths], "gx", settings)
        table = pd.DataFrame(table)
        inside.append(table.value.between(table.ci_low, table.ci_high))
    assert np.mean(inside) == pytest.approx(0.95, abs=0.015)


def test_views_hold_what_the_settings_ask_for():
    x = [np.random.default_rng(8).standard_normal(n) for n in (3000, 500)]
    asked = NoiseSettings(
        views=("psd", "autocorrelation", "total", "modified", "hadamard"), m_samples=(2, 3)
    )
    table = pd.DataFrame(views(layout([3000, 500]), x, "gy", asked))
    assert tuple(table.columns) == COLUMNS == tuple(empty())
    assert set(table["axis"]) == {"gy"}
    assert list(table["view"].unique()) == [*asked.views, "m_sample_2", "m_sample_3"]
    assert not table[["x", "value"]].isna().any(axis=None)
    bounded = ~table["view"].str.startswith("m_sample")
    assert table.loc[bounded, ["ci_low", "ci_high"]].notna().all(axis=None)
    deviations = table[~table["view"].isin(["psd", "autocorrelation"])]
    first = deviations.groupby("view").first()
    assert first["x"].to_numpy() == pytest.approx(1 / RATE)
    two = table[table["view"] == "m_sample_2"]
    expected = allan_variance(x, np.rint(two["x"] * RATE).astype(int))
    assert two["value"].to_numpy() ** 2 == pytest.approx(expected)


def test_default_views_are_the_spectrum_and_the_autocorrelation():
    x = [np.random.default_rng(9).standard_normal(300)]
    assert set(views(layout([300]), x, "ax", NoiseSettings())["view"]) == {
        "psd",
        "autocorrelation",
    }


@pytest.mark.parametrize("length", [1, 2, 9, 16, 40])
@pytest.mark.parametrize("level", [0.0, 9.8])
def test_short_or_constant_output_gives_what_there_is(length, level):
    settings = NoiseSettings(
        views=("psd", "autocorrelation", "total", "modified", "hadamard"), m_samples=(4,)
    )
    with np.errstate(all="raise"):
        table = views(layout([length]), [np.full(length, level)], "ax", settings)
    assert not (table["view"] == "autocorrelation").any()
    assert table["value"] == pytest.approx(0, abs=1e-12)


def test_each_view_is_told_apart():
    assert label("m_sample_3").startswith("3-sample deviation: of 3 consecutive averages")
    assert label("hadamard") == VIEWS["hadamard"]
    words = [label(view) for view in VIEWS if view != "m_sample"]
    assert len(set(words)) == len(words)
