"""Units, stamps and their crop; a local clock with marks of each second; increments."""

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
from imuloop.ingest.streams import Stream, raw_log
from ingest.logs import FORCE, RATE, brief

SIX = [*CHANNELS]

# --- units


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


# --- stamps as text; 2024-02-29T23:59:59 UTC is 19782 days after 1970 and a second less than a day

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


# --- 1PPS: a local clock of known error comes back as the GNSS time that it was made from

# two swings of the temperature
ROWS, START = 18_000, 345_600
SECONDS = np.arange(1, ROWS // 100)
MARKS = len(SECONDS)


def local(t):
    """Return an oscillator's reading, us, at GNSS times: 37 ppm fast, 2 ppm with temperature."""
    # temperature swings within 90 s; the integral of its error in closed form
    return 1e6 * (t + 37e-6 * t + 2e-6 * 90 / (2 * np.pi) * (1 - np.cos(2 * np.pi * t / 90)))


@pytest.fixture
def pps():
    """A log whose time column is a local counter from 5 s on, us, its GNSS times, and its marks."""
    true = 0.0035 + np.arange(ROWS) / 100
    table = brief(ROWS).assign(t=np.rint(5e6 + local(true)).astype(np.int64))
    counter = np.rint(5e6 + local(SECONDS)).astype(np.int64)
    return table, true, pd.DataFrame({"counter": counter, "gnss": START + SECONDS})


def last_mark(table, true, marks):
    """Return the log with the last mark in each row, zeros before the first."""
    row = np.searchsorted(marks.gnss - START, true, side="right") - 1
    latched = marks.to_numpy()[np.maximum(row, 0)] * (row >= 0)[:, None]
    return table.assign(pps_us=latched[:, 0], gnss_s=latched[:, 1])


@pytest.fixture
def by_marks(run, tmp_path):
    """Ingest a log and marks in a file, or in the log where `marks` is None."""

    def call(table, marks=None, **declared):
        table.to_parquet(tmp_path / "log.parquet", index=False)
        given = {"units": {"time": "us"}, "pps": {"counter": "pps_us", "time": "gnss_s"}}
        paths = [tmp_path / "log.parquet"]
        if marks is not None:
            marks.to_csv(tmp_path / "marks.csv", index=False)
            paths.append(tmp_path / "marks.csv")
            given["sources"] = {"log": {"path": "log"}, "pps": {"path": "marks.csv"}}
            given["pps"] = {}
        return run(*paths, **{**given, **declared})

    return call


def by_formula(counters, marks):
    found, (c, t) = [], marks.to_numpy().T
    for c2 in counters:
        k = max(i for i in range(len(c) - 1) if c[i] <= c2 or i == 0)
        c1, c3, t1, t3 = float(c[k]), float(c[k + 1]), float(t[k]), float(t[k + 1])
        b = (t3 - t1) - (c3 - c1) * 1e-6
        found.append(t1 + (c2 - c1) * 1e-6 + b * (c2 - c1) / (c3 - c1))
    return np.array(found)


def test_the_true_time_comes_back_by_the_formula(pps, by_marks):
    table, true, marks = pps
    done = by_marks(table, marks)
    # counters are whole us; within 1 s temperature bends the clock by some 0.02 us
    np.testing.assert_allclose(done.samples.t, true - true[0], rtol=0, atol=2.2e-6)
    some = np.r_[0:5, 95:105, 5000:5010, ROWS - 5 : ROWS]
    expected, found = by_formula(table.t.to_numpy()[some], marks), done.samples.t.to_numpy()[some]
    # numbers of six digits before the point keep ten behind it
    np.testing.assert_allclose(found - found[0], expected - expected[0], rtol=0, atol=2e-10)
    figures = done.quality["clock"]["pps"]
    assert (figures["marks"], figures["rejected"], figures["missed"]) == (MARKS, 0, 0)
    assert figures["drift_ppm"] == pytest.approx(37, abs=0.3)
    assert figures["drift_range_ppm"] == pytest.approx([35, 39], abs=1.2)
    assert (figures["before"], figures["after"]) == (100, 100)
    assert done.quality["rate_hz"] == pytest.approx(100, rel=1e-8)
    assert done.metadata["units"]["time"] == "us, by 1PPS"
    assert done.metadata["start"] is None and {*done.metadata["source"]} == {"log", "pps"}
    assert done.quality["warnings"][0].startswith(f"t is GNSS time through {MARKS} 1PPS marks")
    # marks in the log are the same; its rows of zeros at the start are no mark
    latched = last_mark(*pps)
    inside = by_marks(latched)
    np.testing.assert_array_equal(inside.samples.t, done.samples.t)
    assert inside.quality["clock"]["pps"]["rejected"] == 1
    assert inside.quality["columns"]["pps"] == ["pps_us", "gnss_s"]
    whole = inside.path.read_bytes()
    assert by_marks(latched, batch_rows=977).path.read_bytes() == whole


def test_marks_that_are_missing_jitter_or_are_none_are_counted(pps, by_marks):
    table, true, marks = pps
    done = by_marks(table, marks.drop([*range(50, 60), 100]))
    figures = done.quality["clock"]["pps"]
    assert (figures["missed"], figures["longest_step_s"]) == (11, 11)
    # over 11 s temperature bends the clock by up to 2e-6 * 2 pi / 90 * 11^2 / 8 = 2.1 us
    np.testing.assert_allclose(done.samples.t, true - true[0], rtol=0, atol=4.5e-6)
    assert "11 marks missed, the longest way 11 s" in done.quality["warnings"][0]
    marks["counter"] += np.random.default_rng(4).integers(0, 20, len(marks))
    wrong = {20: 700, 21: -900, 60: 40_000, 75: 600, 76: 2_000, 77: -800, 110: 300_000}
    marks.loc[[*wrong], "counter"] += [*wrong.values()]
    marks["gnss"] = marks.gnss.astype(float)
    marks.loc[[40, 95], "gnss"] += [0.25, -0.5]
    done = by_marks(table, marks)
    figures = done.quality["clock"]["pps"]
    assert (figures["rejected"], figures["missed"]) == (9, 9)
    error = done.samples.t - (true - true[0])
    assert np.ptp(error) < 60e-6
    assert np.median(np.abs(error - np.median(error))) < 10e-6


@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("offset", [100, 5, -3])
def test_a_counter_of_marks_that_rolls_over_goes_on(pps, by_marks, offset, inside):
    table, true, marks = pps
    # rolls over so many seconds after the log begins
    shift = 2**32 - table.t[0] - offset * 10**6
    table["t"] = (table.t + shift) % 2**32
    marks["counter"] = (marks.counter + shift) % 2**32
    if inside:
        done = by_marks(last_mark(table, true, marks))
    else:
        # marks that begin before the log does
        before = np.arange(8, 0, -1)
        counter = (marks.counter[0] - 10**6 * before) % 2**32
        early = pd.DataFrame({"counter": counter, "gnss": marks.gnss[0] - before})
        done = by_marks(table, pd.concat([early, marks]))
    np.testing.assert_allclose(done.samples.t[200:], (true - true[0])[200:], rtol=0, atol=1e-4)
    assert done.quality["clock"]["pps"]["missed"] == 0
    assert done.quality["clock"]["rollovers"] == (offset > 0)


def test_marks_may_be_of_a_week_that_ends_or_dates(pps, by_marks):
    table, _, marks = pps
    straight = by_marks(table, marks).samples.t
    week = marks.assign(gnss=(marks.gnss - START + 604_720) % 604_800)
    np.testing.assert_array_equal(by_marks(table, week).samples.t, straight)
    dates = pd.Timestamp("2024-02-29T23:59:00Z") + pd.to_timedelta(SECONDS, "s")
    marks = marks.assign(gnss=dates.strftime("%Y-%m-%dT%H:%M:%SZ"))
    dated = by_marks(table, marks)
    np.testing.assert_array_equal(dated.samples.t, straight)
    cropped = by_marks(table, marks, time_range=["2024-03-01T00:00:00Z", None])
    assert len(cropped.samples) == ROWS - 6000
    for done, begin in (
        (dated, "2024-02-29T23:59:00.0035Z"),
        (cropped, "2024-03-01T00:00:00.0035Z"),
    ):
        away = pd.Timestamp(done.metadata["start"]) - pd.Timestamp(begin)
        assert abs(away) < pd.Timedelta("2us")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda t, m: (t, m.assign(gnss=m.gnss * 1e-3)), "no two fit together"),
        (lambda t, m: (t, m.assign(counter=m.counter * 10)), "no two fit together"),
        (lambda t, m: (t, m.assign(counter=m.counter + 10**12)), "share no time"),
        (lambda t, m: (t, m[:1]), "of 1 marks no two fit together"),
        (lambda t, m: (t.assign(t=np.r_[t.t[:8000] + 10**9, t.t[8000:] - 8 * 10**7]), m),
         "the local counter starts again"),
    ],
)  # fmt: skip
def test_marks_that_do_not_fit_reject_the_log(pps, by_marks, change, reason):
    table, _, marks = pps
    found = by_marks(*change(table, marks)).quality
    assert found["status"] == "rejected" and reason in found["reasons"][0]


@pytest.mark.parametrize(
    ("change", "inside", "declared", "line"),
    [
        (lambda t: t.assign(pps_us=0), True, {}, r"pps\.time: no column 'gnss_s'; there are t, ax"),
        (lambda t: t, False, {"pps": {"counter": "c"}},
         r"pps\.counter: no column 'c'; there are counter, gnss"),
        (lambda t: t.drop(columns="t"), False, {"rate": 100}, "pps: the log has no time column"),
        (lambda t: t.assign(t=pd.Timestamp("2024-02-29") + pd.to_timedelta(t.t, "us")), False, {},
         "stamps are dates, not a local counter"),
    ],
)  # fmt: skip
def test_marks_that_are_declared_wrongly_are_one_line(
    pps, by_marks, change, inside, declared, line
):
    table, _, marks = pps
    with pytest.raises(ImuloopError, match=line):
        by_marks(change(table), None if inside else marks, **declared)


# --- increments of velocity and angle become rates by the interval that they are really of

DELTA = [f"dv{axis}" for axis in "xyz"] + [f"dtheta_{axis}" for axis in "xyz"]
# a sensor whose intervals vary by a tenth, whole us
TICKS = np.random.default_rng(3).integers(9_500, 10_500, 500)


@pytest.fixture
def rates(log):
    return log[SIX].to_numpy()


@pytest.fixture
def ingested(run, tmp_path):
    """Ingest increments over some seconds, stamped in us, as CSV, the same in small batches."""

    def call(values, seconds, stamps, drop=(), **more):
        declared = {key: more.pop(key) for key in {*more} & {"units", "columns"}}
        table = pd.DataFrame(values * np.asarray(seconds)[..., None], columns=DELTA)
        if stamps is not None:
            table.insert(0, "time_us", stamps)
        table = table.assign(**more).drop(index=[*drop])
        table.to_csv(tmp_path / "log.csv", index=False, float_format="%.17g")
        done = run(tmp_path / "log.csv", **declared)
        whole = done.path.read_bytes(), done.quality
        small = run(tmp_path / "log.csv", batch_rows=7, **declared)
        assert (small.path.read_bytes(), small.quality) == whole
        assert done.quality["status"] == "ok", done.quality["reasons"]
        return done

    return call


def test_increments_are_of_the_steps_of_the_stamps(rates, ingested):
    done = ingested(rates, TICKS * 1e-6, 10**9 + np.cumsum(TICKS))
    np.testing.assert_allclose(done.samples[SIX], rates[1:], rtol=1e-14)
    np.testing.assert_allclose(done.samples.t, (np.cumsum(TICKS)[1:] - sum(TICKS[:2])) * 1e-6)
    assert done.metadata["raw_units"]["acceleration"]["name"] == "m/s^2"
    assert done.metadata["raw_units"]["angular_rate"]["name"] == "rad/s"
    assert done.metadata["units"] == {"time": "us", "acceleration": "m/s", "angular_rate": "rad"}
    figures = done.quality["increments"]
    assert (figures["without_interval"], figures["by_usual_step"]) == (1, 0)
    assert figures["usual_step_s"] == pytest.approx(np.median(TICKS[2:]) * 1e-6, rel=1e-12)
    line, jitter = done.quality["warnings"][:2]
    assert line == (
        "increments of acceleration (m/s) and angular_rate (rad) divided by their interval: step "
        "of the stamps that ends at the row; 1 at the start has none and is dropped"
    )
    assert f"jitter by {TICKS[2:].std() / TICKS[2:].mean():.1%} of a step" in jitter


@pytest.mark.parametrize("name", ["dt_us", "delta_t [us]", "interval"])
def test_increments_are_of_the_logged_interval(rates, ingested, name):
    units = {} if "us" in name else {"units": {"interval": "us"}}
    # stamps of a host, which say nothing of the intervals
    stamps = np.cumsum(TICKS) + np.random.default_rng(5).integers(-1000, 1000, 500)
    done = ingested(rates, TICKS * 1e-6, stamps, **{name: TICKS}, **units)
    np.testing.assert_allclose(done.samples[SIX], rates, rtol=1e-14)
    assert done.quality["columns"]["interval"] == [name]
    line = "increments of acceleration (m/s) and angular_rate (rad) divided by their interval: "
    assert done.quality["warnings"][0] == f"{line}logged"


def test_each_sensor_may_have_an_interval_of_its_own(rates, run, tmp_path):
    # as ulog2csv writes a vehicle_imu
    other = TICKS + 37
    table = {"timestamp": np.cumsum(TICKS), "delta_angle_dt": other, "delta_velocity_dt": TICKS}
    for i in range(3):
        table[f"delta_velocity[{i}]"] = rates[:, i] * TICKS * 1e-6
        table[f"delta_angle[{i}]"] = rates[:, 3 + i] * other * 1e-6
    pd.DataFrame(table).to_csv(tmp_path / "log.csv", index=False)
    units = {"units": {"time": "us", "interval": "us"}}
    found = run(tmp_path / "log.csv", **units)
    np.testing.assert_allclose(found.samples[SIX], rates, rtol=1e-13)
    assert found.quality["columns"]["interval"] == ["delta_velocity_dt", "delta_angle_dt"]
    interval = {"acceleration": "delta_velocity_dt", "angular_rate": "delta_angle_dt"}
    declared = run(tmp_path / "log.csv", columns={"interval": interval}, **units)
    pd.testing.assert_frame_equal(declared.samples, found.samples)
    # by the stamps where that is declared
    none = run(tmp_path / "log.csv", columns={"interval": None}, units={"time": "us"})
    assert len(none.samples) == 499


def test_faults_of_other_rows_do_not_reach_an_increment(rates, ingested):
    # lost rows: the interval of the next is that of the sensor
    lost = [*range(100, 150), 300]
    done = ingested(rates, np.full(500, 0.01), 10_000 * np.arange(500), drop=lost)
    np.testing.assert_allclose(done.samples[SIX], np.delete(rates, [0, *lost], 0), rtol=1e-13)
    assert (done.quality["gaps"]["count"], done.quality["increments"]["by_usual_step"]) == (2, 2)
    line = "2 after gaps are of one interval too, the usual step 0.01 s"
    assert line in str(done.quality["warnings"])
    # a roll-over, a missing value, a repeated and a late stamp, and a clock that starts again
    stamps = (2**32 - 1_000_000 + 10_000 * np.arange(500)) % 2**32
    stamps[40], stamps[[60, 61]] = stamps[39], stamps[[61, 60]]
    stamps[380:] -= stamps[380]
    values = rates.copy()
    values[20, 1] = np.nan
    done = ingested(values, np.full(500, 0.01), stamps)
    np.testing.assert_allclose(done.samples[SIX], np.delete(rates, [0, 20, 40, 61], 0), rtol=1e-12)
    counts = [done.quality[key] for key in ("non_finite", "duplicates", "out_of_order")]
    assert counts == [1, 1, 1]
    assert (done.quality["clock"]["rollovers"], done.quality["clock"]["resets"]) == (1, 1)


def test_increments_of_stamps_in_bursts_are_of_the_step_of_the_line(rates, ingested):
    late = np.repeat(np.random.default_rng(6).gamma(2, 0.001, 100), 5)
    t = 0.05 * (np.arange(500) // 5) + late + 0.002 * (np.arange(500) % 5)
    done = ingested(rates, np.full(500, 0.01), None, t=t)
    step = done.samples.t[499] / 499
    assert done.quality["clock"]["rebuilt"] and step == pytest.approx(0.01, rel=5e-3)
    np.testing.assert_allclose(done.samples[SIX], rates * (0.01 / step), rtol=1e-12)
    assert done.quality["increments"]["interval"] == "step of the rows, rebuilt"


# the units of velocity and angle, and how many of them 10 ms of a unit of SI are
@pytest.mark.parametrize(
    ("force", "rate", "per"),
    [("m/s", "deg", (0.01, 0.01 / DEGREE)), ("mm/s", "mrad", (10, 10)), ("m/s", None, (0.01, 1))],
)
def test_columns_of_any_name_are_increments_where_their_unit_says_so(log, run, force, rate, per):
    units = {"acceleration": force} | ({"angular_rate": rate} if rate else {})
    done = run(log.assign(**log[FORCE] * per[0], **log[RATE] * per[1]), units=units)
    np.testing.assert_allclose(done.samples[SIX], log[SIX].iloc[1:], rtol=1e-9)


def test_intervals_that_are_declared_wrongly_are_one_line(rates, run):
    table = pd.DataFrame(rates * 0.01, columns=DELTA)
    for declared, line in (
        ({}, "no time column"),
        ({"columns": {"interval": "step"}, "rate": 100},
         r"columns.interval: no column 'step'; there are dvx"),
        ({"columns": {"interval": "dvx"}, "units": {"interval": "usec"}},
         r"units.interval: 'usec' is not a unit; .* 'us'\?"),
    ):  # fmt: skip
        with pytest.raises(ImuloopError, match=line):
            run(table, **declared)
    with pytest.raises(ImuloopError, match=r"columns.interval: only tables have one"):
        raw_log([Stream("imu", np.arange(9), {})], {"interval": "dt"})
