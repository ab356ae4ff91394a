import allantools
import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imuloop.noise.allan import CHUNK, COLUMNS, allan_table, allan_variance


@pytest.mark.parametrize("length", [5, CHUNK - 1, CHUNK + 2, 3 * CHUNK + 17])
def test_one_stretch_is_what_allantools_gives(length):
    """Chunks may end anywhere; a walk makes the integral large beside its second differences."""
    rng = np.random.default_rng(1)
    x = rng.standard_normal(length) + np.cumsum(rng.standard_normal(length))
    factors = np.unique(np.geomspace(1, length // 2 - 1, 20).astype(int))
    _, deviation, _, _ = allantools.oadev(x - x.mean(), rate=1.0, data_type="freq", taus=factors)
    np.testing.assert_allclose(np.sqrt(allan_variance([x], factors)), deviation, rtol=1e-9)


@settings(max_examples=20, deadline=None)
@given(k=st.floats(1e-6, 1e6), levels=st.lists(st.floats(-100, 100), min_size=2, max_size=2))
def test_deviation_scales_and_level_of_a_stretch_does_not_matter(k, levels):
    rng = np.random.default_rng(3)
    a, b = rng.standard_normal(300), rng.standard_normal(200)
    found = allan_variance([k * (a + levels[0]), k * (b + levels[1])], [1, 10, 60])
    assert found == pytest.approx(k**2 * allan_variance([a, b], [1, 10, 60]), rel=1e-9)


def test_table_has_the_contract_columns_and_the_printed_interval():
    # chi-square of 10 degrees: 3.246973 and 20.483177 at 2.5 and 97.5 %
    table = allan_table("gx", [0.5], [4.0], [10.0])
    assert tuple(table) == COLUMNS
    row = pd.DataFrame(table).iloc[0]
    assert (row.axis, row.tau_s, row.adev, row.edf, row.stage) == ("gx", 0.5, 2.0, 10.0, "raw")
    assert row.ci_low == pytest.approx(2 * np.sqrt(10 / 20.483177))
    assert row.ci_high == pytest.approx(2 * np.sqrt(10 / 3.246973))
