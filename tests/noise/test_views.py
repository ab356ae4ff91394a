"""Spectrum and autocorrelation against scipy, definitions, closed forms and simulated records."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import welch

from imuloop.noise.settings import NoiseSettings
from imuloop.noise.views import (
    COLUMNS,
    LAGS,
    POINTS,
    autocorrelation,
    no_views,
    power_spectrum,
    record_views,
    segment_lengths,
)
from seeds import seeds

RATE = 50.0
EVERY = NoiseSettings(views=("psd", "autocorrelation", "total", "modified", "hadamard"))


def tabulated(stretches, settings, axis="gx"):
    return pd.DataFrame(record_views(RATE, stretches, axis, [0, 0, 0, 0, 0], settings))


@pytest.mark.parametrize("length", [300, 400_000])
def test_each_point_is_a_mean_over_what_scipy_gives(length):
    rng = np.random.default_rng(0)
    x = rng.standard_normal(length) + 0.01 * np.cumsum(rng.standard_normal(length)) + 9.8
    f, density, _ = power_spectrum([x], RATE)
    longest, *_ = lengths = segment_lengths(length)
    grids = {n: welch(x, RATE, nperseg=n) for n in lengths}
    edges = np.geomspace(1.5 * RATE / longest, RATE / 2, POINTS + 1)
    assert f[0] == pytest.approx(2 * RATE / longest)
    for point, value in zip(f, density, strict=True):
        k = np.searchsorted(edges, point) - 1
        n = next((n for n in lengths[::-1] if edges[k] >= 16 * RATE / n), longest)
        grid, expected = grids[n]
        inside = (grid >= edges[k]) & (grid < edges[k + 1]) & (grid < RATE / 2)
        assert point == pytest.approx(grid[inside].mean())
        assert value == pytest.approx(expected[inside].mean(), rel=1e-9)


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


@seeds(20, 60)
def test_intervals_of_white_noise_cover(seeds):
    """95 % of the points hold 2 N^2; the band of the autocorrelation its lags."""
    rng = np.random.default_rng(3)
    inside = {"psd": [], "autocorrelation": []}
    for _ in range(seeds):
        table = tabulated([rng.standard_normal(n) for n in (30_000, 9000, 9001)], NoiseSettings())
        for view, rows in table.groupby("view"):
            value = 2 / RATE if view == "psd" else rows.value
            inside[view].append((rows.ci_low <= value) & (value <= rows.ci_high))
    thirds = [part.mean() for part in np.array_split(inside["psd"], 3, axis=1)]
    assert thirds == pytest.approx([0.95] * 3, abs=0.12 / np.sqrt(seeds))
    assert np.mean(inside["autocorrelation"]) == pytest.approx(0.95, abs=0.12 / np.sqrt(seeds))


def test_autocorrelation_is_its_definition():
    rng = np.random.default_rng(5)
    # lags longer than the short stretches
    stretches = [np.cumsum(rng.standard_normal(n)) for n in (15_000, 37, 1, 7_001)]
    lags, value, pairs = autocorrelation(stretches)
    assert lags[0] == 1 and lags[-1] == 1_500 and len(lags) <= LAGS
    centred = [x - x.mean() for x in stretches]
    power = sum(y @ y for y in centred) / sum(map(len, centred))
    for k in range(0, len(lags), 9):
        lag = lags[k]
        products = [y[lag:] @ y[: len(y) - lag] for y in centred if len(y) > lag]
        assert pairs[k] == sum(len(y) - lag for y in centred if len(y) > lag)
        assert value[k] == pytest.approx(sum(products) / pairs[k] / power, abs=1e-12)


def test_tables_hold_what_the_settings_ask_for():
    x = [np.random.default_rng(8).standard_normal(n) for n in (3000, 500)]
    table = tabulated(x, EVERY, "gy")
    assert tuple(table.columns) == COLUMNS == tuple(no_views())
    assert set(table["axis"]) == {"gy"}
    assert tuple(table["view"].unique()) == EVERY.views
    assert not table.isna().any(axis=None)
    deviations = table[~table["view"].isin(["psd", "autocorrelation"])]
    assert deviations.groupby("view").first()["x"].to_numpy() == pytest.approx(1 / RATE)


@pytest.mark.parametrize("length", [1, 9, 16, 40])
@pytest.mark.parametrize("level", [0.0, 9.8])
def test_short_or_constant_output_gives_what_there_is(length, level):
    with np.errstate(all="raise"):
        table = tabulated([np.full(length, level)], EVERY)
    assert not (table["view"] == "autocorrelation").any()
    assert table["value"].to_numpy() == pytest.approx(0, abs=1e-12)
