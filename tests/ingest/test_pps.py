"""A local clock of known error comes back as the GNSS time that it was made from."""

import numpy as np
import pandas as pd
import pytest

from imuloop.core.errors import ImuloopError
from imuloop.core.samples import CHANNELS

ROWS, RATE, START = 30_000, 100, 345_600
SECONDS = np.arange(1, ROWS // RATE)


def local(t):
    """Return an oscillator's reading, us, at GNSS times: 37 ppm fast, 2 ppm with temperature."""
    # temperature swings within 90 s; the integral of its error in closed form
    return 1e6 * (t + 37e-6 * t + 2e-6 * 90 / (2 * np.pi) * (1 - np.cos(2 * np.pi * t / 90)))


@pytest.fixture
def simulated(log):
    """A log whose time column is a local counter from 5 s on, us, its GNSS times, and its marks."""
    table = pd.DataFrame({name: np.resize(log[name], ROWS) for name in CHANNELS})
    true = 0.0035 + np.arange(ROWS) / RATE
    table.insert(0, "t", np.rint(5e6 + local(true)).astype(np.int64))
    marks = pd.DataFrame({"counter": np.rint(5e6 + local(SECONDS)).astype(np.int64)})
    return table, true, marks.assign(gnss=START + SECONDS)


def last_mark(table, true, marks):
    """Return the log with the last mark in each row, zeros before the first."""
    row = np.searchsorted(marks.gnss - START, true, side="right") - 1
    latched = marks.to_numpy()[np.maximum(row, 0)] * (row >= 0)[:, None]
    return table.assign(pps_us=latched[:, 0], gnss_s=latched[:, 1])


@pytest.fixture
def ingested(run, tmp_path):
    """Ingest a log and marks in a file, or in the log where `marks` is None."""

    def call(table, marks=None, **declared):
        path = tmp_path / "log.parquet"
        table.to_parquet(path, index=False)
        given = {"units": {"time": "us"}, "pps": {"counter": "pps_us", "time": "gnss_s"}}
        paths = [path]
        if marks is not None:
            marks.to_csv(tmp_path / "marks.csv", index=False)
            paths.append(tmp_path / "marks.csv")
            given["sources"] = {"log": {"path": "log"}, "pps": {"path": "marks.csv"}}
            given["pps"] = {}
        return run(*paths, **{**given, **declared})

    return call


def by_formula(counters, marks):
    found = []
    c, t = marks.counter.to_numpy(), marks.gnss.to_numpy()
    for c2 in counters:
        k = max(i for i in range(len(c) - 1) if c[i] <= c2 or i == 0)
        c1, c3, t1, t3 = float(c[k]), float(c[k + 1]), float(t[k]), float(t[k + 1])
        b = (t3 - t1) - (c3 - c1) * 1e-6
        found.append(t1 + (c2 - c1) * 1e-6 + b * (c2 - c1) / (c3 - c1))
    return np.array(found)


def test_the_formula_written_out(simulated, ingested):
    table, _, marks = simulated
    done = ingested(table, marks)
    some = np.r_[0:5, 95:105, 15_000:15_010, ROWS - 5 : ROWS]
    expected = by_formula(table.t.to_numpy()[some], marks)
    found = done.samples.t.to_numpy()[some]
    # numbers of six digits before the point keep ten behind it
    np.testing.assert_allclose(found - found[0], expected - expected[0], rtol=0, atol=2e-10)


def test_the_true_time_comes_back(simulated, ingested):
    table, true, marks = simulated
    done = ingested(table, marks)
    # counters are whole us; within 1 s temperature bends the clock by some 0.02 us
    np.testing.assert_allclose(done.samples.t, true - true[0], rtol=0, atol=2.2e-6)
    figures = done.quality["clock"]["pps"]
    assert (figures["marks"], figures["rejected"], figures["missed"]) == (299, 0, 0)
    assert figures["drift_ppm"] == pytest.approx(37, abs=0.3)
    low, high = figures["drift_range_ppm"]
    assert low == pytest.approx(35, abs=1.2)
    assert high == pytest.approx(39, abs=1.2)
    assert (figures["before"], figures["after"]) == (100, 100)
    assert done.quality["rate_hz"] == pytest.approx(100, rel=1e-8)
    assert done.metadata["units"]["time"] == "us, by 1PPS"
    assert done.metadata["start"] is None
    assert set(done.metadata["source"]) == {"log", "pps"}
    assert done.quality["warnings"][0].startswith("t is GNSS time through 299 1PPS marks")


def test_marks_in_the_log(simulated, ingested):
    table, _, marks = simulated
    apart = ingested(table, marks)
    latched = last_mark(*simulated)
    done = ingested(latched)
    np.testing.assert_array_equal(done.samples.t, apart.samples.t)
    # the rows of zeros at the start are no mark
    assert done.quality["clock"]["pps"]["rejected"] == 1
    assert done.quality["columns"]["pps"] == ["pps_us", "gnss_s"]
    small = ingested(latched, batch_rows=977)
    assert small.path.read_bytes() == done.path.read_bytes()
    assert small.quality == done.quality


def test_missing_marks(simulated, ingested):
    table, true, marks = simulated
    done = ingested(table, marks.drop([*range(50, 60), 100, 200]))
    assert done.quality["clock"]["pps"]["missed"] == 12
    assert done.quality["clock"]["pps"]["longest_step_s"] == 11
    # over 11 s temperature bends the clock by up to 2e-6 * 2 pi / 90 * 11^2 / 8 = 2.1 us
    np.testing.assert_allclose(done.samples.t, true - true[0], rtol=0, atol=4.5e-6)
    assert "12 marks missed, the longest way 11 s" in done.quality["warnings"][0]


def test_marks_that_jitter_and_marks_that_are_none(simulated, ingested):
    table, true, marks = simulated
    rng = np.random.default_rng(4)
    late = rng.integers(0, 20, len(marks))
    marks["counter"] += late
    wrong = [20, 21, 90, 150, 151, 152, 280]
    marks.loc[wrong, "counter"] += [700, -900, 40_000, 600, 2_000, -800, 300_000]
    marks["gnss"] = marks.gnss.astype(float)
    marks.loc[[40, 180], "gnss"] += [0.25, -0.5]
    done = ingested(table, marks)
    assert done.quality["clock"]["pps"]["rejected"] == 9
    assert done.quality["clock"]["pps"]["missed"] == 9
    error = done.samples.t - (true - true[0])
    assert np.ptp(error) < 60e-6
    assert np.median(np.abs(error - np.median(error))) < 10e-6


@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("offset", [100, 5, -3])
def test_a_counter_that_rolls_over(simulated, ingested, offset, inside):
    table, _, marks = simulated
    straight = ingested(table, marks).samples.t
    # rolls over so many seconds after the log begins
    shift = 2**32 - table.t[0] - offset * 10**6
    table["t"] = (table.t + shift) % 2**32
    marks["counter"] = (marks.counter + shift) % 2**32
    if inside:
        latched = last_mark(table, 0.0035 + np.arange(ROWS) / RATE, marks)
        done = ingested(latched)
    else:
        # marks that begin before the log does
        before = np.arange(8, 0, -1)
        counter = (marks.counter[0] - 10**6 * before) % 2**32
        early = pd.DataFrame({"counter": counter, "gnss": marks.gnss[0] - before})
        done = ingested(table, pd.concat([early, marks]))
    np.testing.assert_allclose(done.samples.t[200:], straight[200:], rtol=0, atol=1e-4)
    assert done.quality["clock"]["pps"]["missed"] == 0
    assert done.quality["clock"]["rollovers"] == (offset > 0)


def test_the_week_ends_and_dates(simulated, ingested):
    table, _, marks = simulated
    straight = ingested(table, marks).samples.t
    week = marks.assign(gnss=(marks.gnss - START + 604_700) % 604_800)
    np.testing.assert_array_equal(ingested(table, week).samples.t, straight)
    dates = pd.Timestamp("2024-02-29T23:58:00Z") + pd.to_timedelta(SECONDS, "s")
    marks = marks.assign(gnss=dates.strftime("%Y-%m-%dT%H:%M:%SZ"))
    dated = ingested(table, marks)
    np.testing.assert_array_equal(dated.samples.t, straight)
    begin = pd.Timestamp("2024-02-29T23:58:00.0035Z")
    assert abs(pd.Timestamp(dated.metadata["start"]) - begin) < pd.Timedelta("2us")
    cropped = ingested(table, marks, time_range=["2024-02-29T23:59:00Z", None])
    assert len(cropped.samples) == ROWS - 6000
    begin += pd.Timedelta("1min")
    assert abs(pd.Timestamp(cropped.metadata["start"]) - begin) < pd.Timedelta("2us")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda t, m: (t, m.assign(gnss=m.gnss * 1e-3)), "no two fit together"),
        (lambda t, m: (t, m.assign(counter=m.counter * 10)), "no two fit together"),
        (lambda t, m: (t, m.assign(counter=m.counter + 10**12)), "share no time"),
        (lambda t, m: (t, m[:1]), "of 1 marks no two fit together"),
        (lambda t, m: (t.assign(t=np.r_[t.t[:20_000] + 10**9, t.t[20_000:] - 2 * 10**8]), m),
         "the local counter starts again"),
    ],
)  # fmt: skip
def test_marks_that_do_not_fit_reject_the_log(simulated, ingested, change, reason):
    table, _, marks = simulated
    done = ingested(*change(table, marks))
    assert done.quality["status"] == "rejected"
    assert reason in done.quality["reasons"][0]


def test_what_is_declared_wrongly_is_one_line(simulated, ingested):
    table, _, marks = simulated
    with pytest.raises(ImuloopError, match=r"pps\.time: no column 'gnss_s'; there are t, ax"):
        ingested(table.assign(pps_us=0))
    with pytest.raises(ImuloopError, match=r"pps\.counter: no column 'c'; there are counter, gnss"):
        ingested(table, marks, pps={"counter": "c"})
    with pytest.raises(ImuloopError, match="pps: the log has no time column"):
        ingested(table.drop(columns="t"), marks, rate=100)
    stamps = pd.Timestamp("2024-02-29") + pd.to_timedelta(table.t, "us")
    with pytest.raises(ImuloopError, match="stamps are dates, not a local counter"):
        ingested(table.assign(t=stamps), marks)
