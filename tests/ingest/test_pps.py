"""1PPS: a local clock of known error comes back as the GNSS time that it was made from."""

import numpy as np
import pandas as pd
import pytest

from imuloop.core.errors import ImuloopError
from ingest.logs import brief

# two swings of the temperature
ROWS, START = 18_000, 345_600
SECONDS = np.arange(1, ROWS // 100)
MARKS, TRUE = len(SECONDS), 0.0035 + np.arange(ROWS) / 100


def local(t):
    """Return an oscillator's reading, us, at GNSS times: 37 ppm fast, 2 ppm with temperature."""
    # temperature swings within 90 s; the integral of its error in closed form
    swing = 2e-6 * 90 / (2 * np.pi) * (1 - np.cos(2 * np.pi * t / 90))
    return np.rint(5e6 + 1e6 * (t + 37e-6 * t + swing)).astype(np.int64)


def made(shift=0):
    """Return a log whose time column is a local counter of 32 bits, us, and its marks."""
    marks = {"counter": (local(SECONDS) + shift) % 2**32, "gnss": START + SECONDS}
    return brief(ROWS).assign(t=(local(TRUE) + shift) % 2**32), pd.DataFrame(marks)


def last_mark(log, marks):
    """Return the log with the last mark in each row, zeros before the first."""
    row = np.searchsorted(marks.gnss - START, TRUE, side="right") - 1
    latched = marks.to_numpy()[np.maximum(row, 0)] * (row >= 0)[:, None]
    return log.assign(pps_us=latched[:, 0], gnss_s=latched[:, 1])


@pytest.fixture
def by_marks(run, tmp_path):
    """Ingest a log and marks in a file, or in the log where `marks` is None."""

    def call(log, marks=None, **declared):
        log.to_parquet(tmp_path / "log.parquet", index=False)
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
    c, t = marks.to_numpy(float).T
    k = np.clip(np.searchsorted(c, counters, side="right") - 1, 0, len(c) - 2)
    b = (t[k + 1] - t[k]) - (c[k + 1] - c[k]) * 1e-6
    return t[k] + (counters - c[k]) * 1e-6 + b * (counters - c[k]) / (c[k + 1] - c[k])


def test_the_true_time_comes_back_by_the_formula(by_marks):
    log, marks = made()
    done = by_marks(log, marks)
    # counters are whole us; within 1 s temperature bends the clock by some 0.02 us
    np.testing.assert_allclose(done.samples.t, TRUE - TRUE[0], rtol=0, atol=2.2e-6)
    # numbers of six digits before the point keep ten behind it
    expected = by_formula(log.t.to_numpy(), marks)
    np.testing.assert_allclose(done.samples.t, expected - expected[0], rtol=0, atol=2e-10)
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
    inside = by_marks(last_mark(log, marks))
    np.testing.assert_array_equal(inside.samples.t, done.samples.t)
    assert inside.quality["clock"]["pps"]["rejected"] == 1
    assert inside.quality["columns"]["pps"] == ["pps_us", "gnss_s"]


def test_marks_that_are_missing_jitter_or_are_none_are_counted(by_marks):
    log, marks = made()
    done = by_marks(log, marks.drop([*range(50, 60), 100]))
    figures = done.quality["clock"]["pps"]
    assert (figures["missed"], figures["longest_step_s"]) == (11, 11)
    # over 11 s temperature bends the clock by up to 2e-6 * 2 pi / 90 * 11^2 / 8 = 2.1 us
    np.testing.assert_allclose(done.samples.t, TRUE - TRUE[0], rtol=0, atol=4.5e-6)
    assert "11 marks missed, the longest way 11 s" in done.quality["warnings"][0]
    marks["counter"] += np.random.default_rng(4).integers(0, 20, len(marks))
    wrong = {20: 700, 21: -900, 60: 40_000, 75: 600, 76: 2_000, 77: -800, 110: 300_000}
    marks.loc[[*wrong], "counter"] += [*wrong.values()]
    marks["gnss"] = marks.gnss.astype(float)
    marks.loc[[40, 95], "gnss"] += [0.25, -0.5]
    done = by_marks(log, marks)
    figures = done.quality["clock"]["pps"]
    assert (figures["rejected"], figures["missed"]) == (9, 9)
    error = done.samples.t - (TRUE - TRUE[0])
    assert np.ptp(error) < 60e-6
    assert np.median(np.abs(error - np.median(error))) < 10e-6


@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("offset", [100, 5, -3])
def test_a_counter_of_marks_that_rolls_over_goes_on(by_marks, offset, inside):
    # rolls over so many seconds after the log begins
    log, marks = made(2**32 - local(TRUE[0]) - offset * 10**6)
    # marks in a file begin before the log does
    before = np.arange(8, 0, -1)
    counter = (marks.counter[0] - 10**6 * before) % 2**32
    early = pd.DataFrame({"counter": counter, "gnss": marks.gnss[0] - before})
    given = [last_mark(log, marks)] if inside else [log, pd.concat([early, marks])]
    done = by_marks(*given)
    np.testing.assert_allclose(done.samples.t[200:], (TRUE - TRUE[0])[200:], rtol=0, atol=1e-4)
    assert done.quality["clock"]["pps"]["missed"] == 0
    assert done.quality["clock"]["rollovers"] == (offset > 0)


def test_marks_may_be_of_a_week_that_ends_or_dates(by_marks):
    log, marks = made()
    straight = by_marks(log, marks).samples.t
    week = marks.assign(gnss=(marks.gnss - START + 604_720) % 604_800)
    np.testing.assert_array_equal(by_marks(log, week).samples.t, straight)
    dates = pd.Timestamp("2024-02-29T23:59:00Z") + pd.to_timedelta(SECONDS, "s")
    marks = marks.assign(gnss=dates.strftime("%Y-%m-%dT%H:%M:%SZ"))
    np.testing.assert_array_equal(by_marks(log, marks).samples.t, straight)
    for begin, rows in (("2024-02-29T23:59:00", ROWS), ("2024-03-01T00:00:00", ROWS - 6000)):
        done = by_marks(log, marks, time_range=[f"{begin}Z", None])
        away = pd.Timestamp(done.metadata["start"]) - pd.Timestamp(f"{begin}.0035Z")
        assert len(done.samples) == rows and abs(away) < pd.Timedelta("2us")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda t, m: (t, m.assign(gnss=m.gnss * 1e-3)), "no two fit together"),
        (lambda t, m: (t, m.assign(counter=m.counter * 10)), "no two fit together"),
        (lambda t, m: (t, m.assign(counter=m.counter + 10**12)), "share no time"),
        (lambda t, m: (t, m[:1]), "of 1 marks no two fit together"),
        (lambda t, m: (t, m[:0]), "no"),
        (lambda t, m: (last_mark(t, m).assign(pps_us=np.nan),), "the log holds no marks"),
        (lambda t, m: (t.assign(t=np.r_[t.t[:8000] + 10**9, t.t[8000:] - 8 * 10**7]), m),
         "the local counter starts again"),
    ],
)  # fmt: skip
def test_marks_that_do_not_fit_reject_the_log(by_marks, change, reason):
    found = by_marks(*change(*made())).quality
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
def test_marks_that_are_declared_wrongly_are_one_line(by_marks, change, inside, declared, line):
    log, marks = made()
    with pytest.raises(ImuloopError, match=line):
        by_marks(change(log), None if inside else marks, **declared)
