"""Power spectral density against scipy, closed forms and simulated records."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import welch

from imuloop.noise.spectrum import (
    COLUMNS,
    POINTS,
    no_spectrum,
    power_spectrum,
    segment_lengths,
    spectrum_table,
)
from seeds import seeds

RATE = 50.0


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


@seeds(20, 60)
def test_intervals_of_white_noise_cover(seeds):
    """95 % of the points hold 2 N^2."""
    rng, inside = np.random.default_rng(3), []
    for _ in range(seeds):
        rows = spectrum_table("gx", [rng.standard_normal(n) for n in (30_000, 9000, 9001)], RATE)
        inside.append((rows["ci_low"] <= 2 / RATE) & (2 / RATE <= rows["ci_high"]))
    thirds = [part.mean() for part in np.array_split(inside, 3, axis=1)]
    assert thirds == pytest.approx([0.95] * 3, abs=0.12 / np.sqrt(seeds))


def test_a_table_has_its_columns():
    x = [np.random.default_rng(8).standard_normal(n) for n in (3000, 500)]
    table = pd.DataFrame(spectrum_table("gy", x, RATE))
    assert tuple(table.columns) == COLUMNS == tuple(no_spectrum())
    assert set(table["axis"]) == {"gy"} and not table.isna().any(axis=None)


@pytest.mark.parametrize("length", [1, 9, 16, 40])
@pytest.mark.parametrize("level", [0.0, 9.8])
def test_short_or_constant_output_gives_what_there_is(length, level):
    with np.errstate(all="raise"):
        table = spectrum_table("gx", [np.full(length, level)], RATE)
    assert np.asarray(table["psd"]) == pytest.approx(0, abs=1e-12)
