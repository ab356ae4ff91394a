"""1PPS: a local clock of known error comes back as the GNSS time that it was made from."""

import numpy as np
import pandas as pd
import pytest

from imuloop.core.errors import ImuloopError
from ingest.figures import check_figures
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


def log_and_marks(shift=0):
    """Return a log whose time column is a local counter of 32 bits, us, and its marks."""
    marks = {"counter": (local(SECONDS) + shift) % 2**32, "gnss": START + SECONDS}
    return brief(ROWS).assign(t=(local(TRUE) + shift) % 2**32), pd.DataFrame(marks)


def inside(log, marks):
    """Return the log with the last mark in each row, zeros before the first."""
    row = np.searchsorted(marks.gnss - START, TRUE, side="right") - 1
    latched = marks.to_numpy()[np.maximum(row, 0)] * (row >= 0)[:, None]
    return log.assign(pps_us=latched[:, 0], gnss_s=latched[:, 1]), None


@pytest.fixture
def by_marks(run, tmp_path):
    """Ingest a log and marks in a file, or in the log where `marks` is None."""

    def call(log, marks=None, **declared):
        paths, keys = [tmp_path / "log.parquet"], {"pps": {"counter": "pps_us", "time": "gnss_s"}}
        log.to_parquet(paths[0], index=False)
        if marks is not None:
            paths.append(tmp_path / "marks.csv")
            marks.to_csv(paths[1], index=False)
            sources = {"log": {"path": "log"}, "pps": {"path": "marks.csv"}}
            keys = {"pps": {}, "sources": sources}
        return run(*paths, **{"units": {"time": "us"}, **keys, **declared})

    return call


def lossy(log, marks):
    return log, marks.drop([*range(50, 60), 100])


def jittery(log, marks):
    """Marks that jitter, some of them wrong, and two that are no whole second."""
    marks = lossy(log, marks)[1].astype(float)
    marks["counter"] += np.random.default_rng(4).integers(0, 20, len(marks))
    wrong = {20: 700, 21: -900, 62: 40_000, 75: 600, 76: 2_000, 77: -800, 110: 300_000}
    marks.loc[[*wrong], "counter"] += [*wrong.values()]
    marks.loc[[40, 95], "gnss"] += [0.25, -0.5]
    return log, marks


FIGURES = {
    "marks": MARKS, "rejected": 0, "missed": 0, "drift_ppm": "36.7 .. 37.3",
    "drift_range_ppm.0": "33.8 .. 36.2", "drift_range_ppm.1": "37.8 .. 40.2",
    "before": 100, "after": 100,
}  # fmt: skip


# how marks are given; how near the time comes, s: counters are whole us, and within 1 s temperature
# bends the clock by 0.02 us, over 11 s by 2e-6 * 2 pi / 90 * 11^2 / 8 = 2.1 us
@pytest.mark.parametrize(
    ("change", "within", "figures"),
    [(lambda *pair: pair, 2.2e-6, FIGURES),
     # zeros at the start are no mark
     (inside, 2.2e-6, FIGURES | {"rejected": 1}),
     (lossy, 4.5e-6, {"missed": 11, "longest_step_s": 11}),
     (jittery, 6e-5, {"rejected": 9, "missed": 20})],
)  # fmt: skip
def test_the_true_time_comes_back(by_marks, change, within, figures):
    log, marks = log_and_marks()
    done = by_marks(*change(log, marks))
    np.testing.assert_allclose(done.samples.t, TRUE - TRUE[0], rtol=0, atol=within)
    check_figures(done.quality["clock"]["pps"], figures)
    assert done.quality["rate_hz"] == pytest.approx(100, rel=1e-7)
    assert (done.metadata["units"]["time"], done.metadata["start"]) == ("us, by 1PPS", None)
    assert done.quality["warnings"][0].startswith("t is GNSS time through ")


@pytest.mark.parametrize("in_log", [False, True])
@pytest.mark.parametrize("offset", [100, 5, -3])
def test_a_counter_of_marks_that_rolls_over_goes_on(by_marks, offset, in_log):
    # rolls over so many seconds after the log begins
    log, marks = log_and_marks(2**32 - local(TRUE[0]) - offset * 10**6)
    # marks in a file begin before the log does
    before = np.arange(8, 0, -1)
    counter = (marks.counter[0] - 10**6 * before) % 2**32
    early = pd.DataFrame({"counter": counter, "gnss": marks.gnss[0] - before})
    done = by_marks(*(inside(log, marks) if in_log else (log, pd.concat([early, marks]))))
    np.testing.assert_allclose(done.samples.t[200:], (TRUE - TRUE[0])[200:], rtol=0, atol=1e-4)
    assert done.quality["clock"]["pps"]["missed"] == 0
    assert done.quality["clock"]["rollovers"] == (offset > 0)


def test_marks_may_be_of_a_week_that_ends_or_dates(by_marks):
    log, marks = log_and_marks()
    straight = by_marks(log, marks).samples.t
    dates = pd.Timestamp("2024-02-29T23:59:00Z") + pd.to_timedelta(SECONDS, "s")
    dated = marks.assign(gnss=dates.strftime("%Y-%m-%dT%H:%M:%SZ"))
    for other in (marks.assign(gnss=(marks.gnss - START + 604_720) % 604_800), dated):
        np.testing.assert_array_equal(by_marks(log, other).samples.t, straight)
    done = by_marks(log, dated, time_range=["2024-03-01T00:00:00Z", None])
    away = pd.Timestamp(done.metadata["start"]) - pd.Timestamp("2024-03-01T00:00:00.0035Z")
    assert len(done.samples) == ROWS - 6000 and abs(away) < pd.Timedelta("2us")


@pytest.mark.parametrize(
    ("change", "line", "declared"),
    [(lambda t, m: (t, m.assign(counter=m.counter * 10)), "no two fit together", None),
     (lambda t, m: (t, m.assign(counter=m.counter + 10**12)), "share no time", None),
     (lambda t, m: (inside(t, m)[0].assign(pps_us=np.nan),), "the log holds no marks", None),
     (lambda t, m: (t.assign(t=np.r_[t.t[:8000] + 10**9, t.t[8000:] - 8 * 10**7]), m),
      "the local counter starts again", None),
     (lambda t, m: (t, m), r"pps\.counter: no column 'c'; there are counter, gnss",
      {"pps": {"counter": "c"}}),
     (lambda t, m: (t.drop(columns="t"), m), "pps: the log has no time column", {"rate": 100})],
)  # fmt: skip
def test_marks_that_do_not_fit_are_one_line(by_marks, change, line, declared):
    """What is `declared` wrongly is an error; else the log is rejected."""
    if declared is None:
        quality = by_marks(*change(*log_and_marks())).quality
        assert quality["status"] == "rejected" and line in quality["reasons"][0]
    else:
        with pytest.raises(ImuloopError, match=line):
            by_marks(*change(*log_and_marks()), **declared)
