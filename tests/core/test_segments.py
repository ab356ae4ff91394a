"""The table of segments: statistics of each stretch, and its file."""

import numpy as np
import pandas as pd

from imuloop.core.samples import CHANNELS
from imuloop.core.segments import power_cycles, segment_table


def samples(temperature):
    t = np.arange(len(temperature)) / 10
    values = {c: np.arange(len(t)) + i for i, c in enumerate(CHANNELS)}
    return pd.DataFrame({"t": t, **values, "temperature": temperature})


def test_statistics_are_those_of_the_half_open_stretch():
    table = segment_table(samples(np.zeros(20)), [0, 0.5], [0.5, 2.0], ["static"] * 2, [0, 1])
    assert table["n"].tolist() == [5, 15]
    assert table["ax_mean"].tolist() == [2.0, 12.0]
    # 0 … 4 and 5 … 19: (n² - 1)/12
    np.testing.assert_allclose(table["gz_std"] ** 2, [2.0, 224 / 12])


def test_what_never_changes_has_no_deviation():
    for value in (0.1, 3.3, 9.80665, 1e-7):
        table = samples(np.full(1001, value)).assign(ax=value)
        assert segment_table(table, [0], [200], ["static"], [0])["ax_std"].tolist() == [0.0]


def test_a_missing_temperature_does_not_count():
    logged = np.array([20.0, np.nan, 22.0, np.nan, np.nan, np.nan])
    table = segment_table(samples(logged), [0, 0.3], [0.3, 0.6], ["static"] * 2, [0, 1])
    assert table["temperature_mean"][0] == 21.0
    assert table["temperature_std"][0] == 1.0
    assert np.isnan(table["temperature_mean"][1])


def test_a_gap_longer_than_all_that_was_recorded_ends_a_run():
    start = np.array([0, 10, 30, 39, 45, 1e9, 1e9 + 5])
    table = {
        "start_s": start,
        "end_s": np.append(start[1:], 1e9 + 10),
        "kind": ["static", "gap", "motion", "gap", "disturbed", "static", "gap"],
    }
    assert power_cycles(table).tolist() == [0] * 7
    # 10 s + 9 s + 9 s + 5 s were recorded
    table["kind"][4:] = ["gap", "static", "static"]
    assert power_cycles(table).tolist() == [0, 0, 0, 0, 1, 1, 1]
    assert power_cycles({name: [] for name in table}).tolist() == []
