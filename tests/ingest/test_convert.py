"""Units, time from zero, the crop, and what becomes of faulty rows."""

import numpy as np
import pandas as pd
import pytest

from imuloop.core.errors import ImuloopError

DEGREE = np.pi / 180


@pytest.mark.parametrize(
    ("quantity", "unit", "si"),
    [
        ("acceleration", "m/s^2", 1.0),
        ("acceleration", "g", 9.80665),
        ("acceleration", "mg", 9.80665e-3),
        ("angular_rate", "rad/s", 1.0),
        ("angular_rate", "deg/s", DEGREE),
        ("angular_rate", "mrad/s", 1e-3),
        ("angular_rate", "deg/h", DEGREE / 3600),
    ],
)
def test_units_of_the_sensors(log, run, quantity, unit, si):
    if quantity == "acceleration":
        log[["ax", "ay", "az"]] /= si
    done = run(log, units={quantity: unit})
    for name in log.columns[1:]:
        factor = si if (name[0] == "a") == (quantity == "acceleration") else 1.0
        np.testing.assert_allclose(done.samples[name], factor * log[name], rtol=1e-15)


@pytest.mark.parametrize("unit", ["ms", "ns"])
def test_units_of_time_from_any_start(log, run, unit):
    ticks = {"ms": 10**3, "us": 10**6, "ns": 10**9}[unit]
    # fifty years, from which float64 nanoseconds would lose three digits
    log["t"] = 50 * 365 * 86400 * ticks + np.arange(500) * (ticks // 100)
    done = run(log, units={"time": unit})
    np.testing.assert_allclose(done.samples.t, np.arange(500) / 100, rtol=0, atol=2e-15)
    assert done.quality["rate_hz"] == pytest.approx(100)


def test_whole_stamps_lose_nothing(log, run):
    # as in a published drone log: microseconds since a moment that only the drone knows
    stamps = 256551281491968 + np.cumsum(np.r_[0, np.tile([9999, 10001, 10000], 167)[:499]])
    log["t"] = stamps
    done = run(log, units={"time": "us"})
    np.testing.assert_array_equal(np.round(done.samples.t * 1e6), stamps - stamps[0])
    np.testing.assert_array_equal(done.samples.t, (stamps - stamps[0]) * 1e-6)
    assert done.metadata["start"] is None


@pytest.mark.parametrize("declared", [None, {"time": "ISO 8601"}])
def test_dates(log, run, declared):
    moments = pd.Timestamp("2024-12-31T23:59:58") + pd.to_timedelta(np.arange(500) * 10, "ms")
    log["t"] = [m.isoformat(timespec="milliseconds") + "Z" for m in moments]
    done = run(log, units=declared)
    np.testing.assert_array_equal(done.samples.t, np.arange(500) * 10_000_000 * 1e-9)
    assert done.metadata["start"] == "2024-12-31T23:59:58Z"
    late = run(log, units=declared, time_range=["2025-01-01", None])
    assert len(late.samples) == 300
    assert late.samples.t[0] == 0


def test_rate_without_time(log, run):
    done = run(log.drop(columns="t"), rate=204.8)
    np.testing.assert_array_equal(done.samples.t, np.arange(500) * (1 / 204.8))
    # a row that is dropped keeps its place in time
    log.loc[3, "ax"] = np.nan
    done = run(log.drop(columns="t"), rate=100)
    assert done.samples.t[2:4].tolist() == [0.02, 0.04]
    with pytest.raises(ImuloopError, match=r"no time column .*give rate in Hz"):
        run(log.drop(columns="t"))


def test_crop_in_seconds_is_half_open_and_starts_at_zero(log, run):
    log["t"] += 1000
    done = run(log, time_range=[1, 4])
    assert (len(done.samples), done.quality["outside_time_range"]) == (300, 200)
    assert done.samples.t[0] == 0
    assert done.samples.ax.tolist() == log.ax[100:400].tolist()
    assert run(log, time_range=[60, 70]).quality["reasons"] == [
        "none of the log's 500 rows lies in the time range"
    ]
    with pytest.raises(ImuloopError, match="is a date, but the log's stamps are not"):
        run(log, time_range=["2024-01-01", "2024-01-02"])
    with pytest.raises(ImuloopError, match="is not before the end"):
        run(log, time_range=[4, 4])


def test_repeated_and_late_rows(log, run):
    faulty = log.copy()
    faulty.loc[10, "t"] = faulty.loc[9, "t"]
    faulty.loc[20, "t"] = faulty.loc[15, "t"]
    faulty.loc[30, "t"] = np.nan
    done = run(faulty)
    counts = {key: done.quality[key] for key in ("duplicates", "out_of_order", "non_finite")}
    assert counts == {"duplicates": 1, "out_of_order": 1, "non_finite": 1}
    assert done.quality["rows"] == 497
    assert done.quality["rows_read"] == 500
    pd.testing.assert_frame_equal(
        done.samples, log.drop(index=[10, 20, 30]).reset_index(drop=True), check_exact=True
    )


def test_every_row_is_counted_once(log, run):
    rng = np.random.default_rng(1)
    log["t"] = rng.permutation(log.t)
    log.loc[::7, "ax"] = np.nan
    log.loc[::5, "t"] = np.nan
    found = run(log, time_range=[0, 3]).quality
    parts = "rows outside_time_range non_finite duplicates out_of_order".split()
    assert sum(found[part] for part in parts) == found["rows_read"] == 500
    assert found["status"] == "rejected"
