"""Power spectral density against scipy, closed forms and simulated records."""

import numpy as np
import pandas as pd
import pytest

from imuloop.noise.spectrum import COLUMNS, no_spectrum, spectrum_table
from seeds import seeds

RATE = 50.0


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
