"""Units, stamps and their crop."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import CHANNELS
from imuloop.core.units import DEGREE, STANDARD_GRAVITY
from imuloop.ingest.stamps import (
    absolute_nanoseconds,
    iso_nanoseconds,
    parse_stamps,
    stamp_array,
    stamp_values,
)
from ingest.logs import FORCE, RATE, poses

SIX = [*CHANNELS]


@pytest.mark.parametrize(
    ("quantity", "unit", "si"),
    [
        ("acceleration", "g", STANDARD_GRAVITY),
        ("acceleration", "mg", STANDARD_GRAVITY / 1000),
        ("angular_rate", "deg/s", DEGREE),
        ("angular_rate", "mrad/s", 1e-3),
        ("angular_rate", "deg/h", DEGREE / 3600),
    ],
)
def test_declared_units_of_a_sensor_are_of_it_alone(log, run, quantity, unit, si):
    names = FORCE if quantity == "acceleration" else RATE
    done = run(log.assign(**log[names] / si), units={quantity: unit})
    np.testing.assert_allclose(done.samples[SIX], log[SIX], rtol=1e-14)
    assert done.metadata["units"][quantity] == unit


@pytest.mark.parametrize(("unit", "ticks"), [("ms", 10**3), ("us", 10**6), ("ns", 10**9)])
def test_whole_stamps_lose_nothing_whenever_they_start(log, run, unit, ticks):
    # fifty years, from which float64 nanoseconds would lose three digits
    steps = np.arange(500) * (ticks // 100) + np.arange(500) % 2
    done = run(log.assign(t=50 * 365 * 86400 * ticks + steps), units={"time": unit})
    np.testing.assert_allclose(done.samples.t, steps / ticks, rtol=0, atol=2e-15)
    # as in a published drone log: microseconds since a moment that only the drone knows
    done = run(log.assign(t=256551281491968 + 10_000 * np.arange(500)), units={"time": "us"})
    assert done.metadata["start"] is None


def test_a_finer_unit_of_unix_time_is_taken_where_it_is_declared(log, run):
    log["t"] = np.rint((log.t + 1.7e9) * 1e6).astype("int64")
    assert run(log, units={"time": "us"}).metadata["start"] == "2023-11-14T22:13:20Z"


@pytest.mark.parametrize("declared", [None, {"time": "ISO 8601"}])
def test_dates_are_stamps_and_crop_the_log(log, run, declared):
    moments = pd.Timestamp("2024-12-31T23:59:58") + pd.to_timedelta(np.arange(500) * 10, "ms")
    log["t"] = [m.isoformat(timespec="milliseconds") + "Z" for m in moments]
    done = run(log, units=declared)
    np.testing.assert_array_equal(done.samples.t, np.arange(500) * 10_000_000 * 1e-9)
    assert done.metadata["start"] == "2024-12-31T23:59:58Z"
    late = run(log, units=declared, time_range=["2025-01-01", None])
    assert len(late.samples) == 300 and late.samples.t[0] == 0


def test_a_crop_in_seconds_is_half_open_and_starts_at_zero(log, run):
    log["t"] += 1000
    done = run(log, time_range=[1, 4])
    assert (len(done.samples), done.quality["outside_time_range"]) == (300, 200)
    assert done.samples.t[0] == 0
    assert done.samples.ax.tolist() == log.ax[100:400].tolist()
    reasons = run(log, time_range=[60, 70]).quality["reasons"]
    assert reasons == ["none of the log's 500 rows lies in the time range"]
    for given, line in (
        (["2024-01-01", "2024-01-02"], "is a date, but the log's stamps are not"),
        ([4, 4], "is not before the end"),
    ):
        with pytest.raises(ImuloopError, match=line):
            run(log, time_range=given)
    # after a clock that starts again, of the time that goes on
    log["t"] = np.r_[log.t[:200], log.t[:300]]
    assert len(run(log, time_range=[2.05, None]).samples) == 300


def test_a_log_without_time_has_the_declared_rate(log, run):
    log = log.drop(columns="t")
    done = run(log, rate=204.8)
    np.testing.assert_array_equal(done.samples.t, np.arange(500) * (1 / 204.8))
    # rows stamped by the declared rate say nothing of it
    assert done.quality["clock"]["drift_ppm"] is None
    # a row that is dropped keeps its place in time
    log.loc[3, "ax"] = np.nan
    assert run(log, rate=100).samples.t[2:4].tolist() == [0.02, 0.04]
    with pytest.raises(ImuloopError, match=r"no time column .*give rate in Hz"):
        run(log)


# stamps as text; 2024-02-29T23:59:59 UTC is 19782 days after 1970 and a second less than a day
MOMENT, WHOLE = 19782 * 86400 + 86399, 2**60 + 1


@pytest.mark.parametrize(
    ("text", "values", "absolute"),
    [
        (["23:59:59.250", "0:00:01", "?", "24:61", None], [86399.25, 1.0, None, None, None], False),
        ([str(WHOLE), None, "oops", ""], [WHOLE, None, None, None], False),
        ([str(WHOLE)], [WHOLE], False),
        *(
            ([date, "?"], [MOMENT * 10**9, None], True)
            for date in ("2024-02-29T23:59:59", "2024-02-29 23:59:59.000", "2024-02-29T23:59:59Z",
                         "2024-03-01T00:59:59+01:00", "2024-02-29T18:59:59.000000000-05:00")
        ),
        (["2024-02-29T23:59:59", "9999-12-31T00:00:00"], [MOMENT * 10**9, None], True),
        (["9999-12-31T00:00:00", "0001-01-01T00:00:00"], [None, None], True),
    ],
)  # fmt: skip
def test_stamps_keep_what_was_written(text, values, absolute):
    columns = [parse_stamps(pa.array(text))]
    if text[-1] and text[-1].startswith(("9999", "0001")):
        columns += [stamp_array(pa.array(np.array(text, f"datetime64[{u}]"))) for u in ("us", "s")]
    for column in columns:
        found, readable, dated = stamp_values(column)
        assert dated == absolute
        assert readable.tolist() == [value is not None for value in values]
        assert found[readable].tolist() == [value for value in values if value is not None]


def test_dates_and_unix_time_are_moments_and_time_since_power_on_is_none():
    assert iso_nanoseconds("2024-03-01T00:59:59+01:00") == MOMENT * 10**9
    for text in ("yesterday", "now", "10:00", "NaT", ""):
        with pytest.raises(ImuloopError, match=f"'{text}' is no ISO 8601 stamp"):
            iso_nanoseconds(text)
    assert absolute_nanoseconds(MOMENT, "s", False) == MOMENT * 10**9
    assert absolute_nanoseconds(MOMENT * 10**6 + 1, "us", False) == MOMENT * 10**9 + 1000
    assert absolute_nanoseconds(256551281491968, "us", False) is None
    assert absolute_nanoseconds(np.float64(12.5), "s", False) is None


@pytest.mark.parametrize("seed", range(20))
def test_rows_lost_at_random_are_no_stamps_that_scatter(run, seed):
    log = poses(seed=seed)
    kept = np.flatnonzero(np.random.default_rng(seed).random(len(log)) < 0.8)
    done = run(log.iloc[kept])
    assert not done.quality["clock"]["rebuilt"]
    np.testing.assert_allclose(done.samples["t"], (kept - kept[0]) / 100, atol=1e-9)
    assert done.quality["gaps"]["count"] > 0.1 * len(kept)
