"""Clocks that roll over, start again, or stray; late rows are none of these."""

import numpy as np
import pandas as pd
import pytest

from imuloop.ingest.clocks import RESET_STEPS, Clock, with_lookahead

STEP = 10_000


def mended(stamps, size=None, tick=1000, valid=None):
    x = np.asarray(stamps)
    valid = np.ones(len(x), dtype=bool) if valid is None else valid
    size = size or len(x)
    parts = [(x[i : i + size], valid[i : i + size]) for i in range(0, len(x), size)]
    clock = Clock()
    done = [clock.mended(*part, after, tick) for part, after in with_lookahead(parts)]
    return *(np.concatenate(each) for each in zip(*done, strict=True)), clock


def events(clock):
    return clock.rollovers, clock.resets, clock.strays


@pytest.mark.parametrize("size", [None, 7])
@pytest.mark.parametrize(
    ("width", "tick", "lost"), [(2**32, 1000, 0), (2**24, 1000, 3), (604_800_000, 10**6, 0)]
)
def test_a_counter_that_rolls_over(width, tick, lost, size):
    rng = np.random.default_rng(1)
    true = width - 200 * STEP + np.cumsum(rng.integers(STEP - 99, STEP + 99, 500))
    true = np.delete(true, np.flatnonzero(true >= width)[0] + np.arange(-1, lost - 1))
    x, readable, clock = mended(true % width, size, tick)
    np.testing.assert_array_equal(x, true)
    assert x.dtype == np.int64
    assert readable.all()
    assert events(clock) == (1, 0, 0)
    assert clock.span_s == pytest.approx(width * tick * 1e-9)


@pytest.mark.parametrize("size", [None, 7])
@pytest.mark.parametrize("rows", [30, 777])
def test_stamps_that_start_again(rows, size):
    first = 10**9 + STEP * np.arange(rows)
    again = 12_345 + STEP * np.arange(400)
    x, readable, clock = mended(np.concatenate((first, again, again)), size)
    np.testing.assert_array_equal(x[:rows], first)
    steps = np.diff(x)
    assert steps[[rows - 1, rows + 399]].tolist() == [RESET_STEPS * STEP] * 2
    assert (np.delete(steps, [rows - 1, rows + 399]) == STEP).all()
    assert readable.all()
    assert events(clock) == (0, 2, 0)


@pytest.mark.parametrize("size", [None, 7])
@pytest.mark.parametrize("block", [1, 20])
def test_late_rows_stay_late(block, size):
    stamps = STEP * np.arange(500)
    late = np.concatenate((np.delete(stamps, np.s_[100 : 100 + block]), stamps[100 : 100 + block]))
    for at in (161, 300, 499 - block):
        rows = np.concatenate((late[:at], late[500 - block :], late[at : 500 - block]))
        x, readable, clock = mended(rows, size)
        np.testing.assert_array_equal(x, rows)
        assert readable.all()
        assert events(clock) == (0, 0, 0)


def test_missing_stamps_and_any_batches():
    rng = np.random.default_rng(4)
    true = 2**32 - 1500 * STEP + STEP * np.arange(3000)
    rows = true % 2**32
    rows[2000:] -= rows[2000] - 77
    rows[rng.integers(0, 3000, 30)] += rng.integers(-(10**7), 10**7, 30)
    valid = rng.random(3000) > 0.1
    whole = mended(rows, valid=valid)
    assert events(whole[2])[:2] == (1, 1)
    for size in (1, 99, 101):
        parts = mended(rows, size, valid=valid)
        np.testing.assert_array_equal(parts[0][parts[1]], whole[0][whole[1]])
        np.testing.assert_array_equal(parts[1], whole[1])
        assert events(parts[2]) == events(whole[2])


@pytest.fixture
def quality(log, run):
    """Samples and quality of the log with other stamps, the same in small batches."""

    def call(stamps, **declared):
        log["t"] = stamps
        done = run(log, **declared)
        whole, reported = done.path.read_bytes(), done.quality
        small = run(log, batch_rows=7, **declared)
        assert small.path.read_bytes() == whole
        assert small.quality == reported
        return done

    return call


def test_a_reset_is_a_gap_and_a_roll_over_is_none(quality):
    stamps = (2**32 - 10**6 + STEP * np.arange(500)) % 2**32
    done = quality(stamps, units={"time": "us"})
    np.testing.assert_array_equal(done.samples.t, STEP * np.arange(500) * 1e-6)
    assert done.quality["clock"]["span_s"] == pytest.approx(4294.967296)
    line = "the stamps roll over after 4294.967296 s, once: the span is added"
    assert done.quality["warnings"] == [line]
    done = quality(np.r_[100 + np.arange(200) / 100, np.arange(300) / 100])
    assert len(done.samples) == 500
    assert (done.quality["status"], done.quality["clock"]["resets"]) == ("ok", 1)
    assert done.quality["gaps"]["count"] == 1
    assert done.quality["gaps"]["list"][0]["start_s"] == pytest.approx(1.99)
    assert done.quality["gaps"]["total_s"] == pytest.approx(0.1)
    assert "the stamps start again once" in done.quality["warnings"][0]
    assert len(quality(done.samples.t, time_range=[2.05, None]).samples) == 300


def test_a_stamp_far_ahead_costs_its_row(quality):
    stamps = np.arange(500) / 100
    stamps[[0, 70]] = 1e9
    done = quality(stamps)
    assert done.quality["rows"] == 498
    assert done.quality["non_finite"] == done.quality["clock"]["strays"] == 2
    assert done.samples.t.max() == pytest.approx(4.98)


def test_jitter_and_drift(quality):
    clock = quality(np.arange(500) / 100, rate=100.01).quality["clock"]
    assert clock["drift_ppm"] == pytest.approx(-99.99, rel=1e-6)
    assert clock["jitter_ppm"] < 1e-3
    clock = quality((np.arange(500) + np.tile([0, 0.1], 250)) / 100).quality["clock"]
    assert clock["drift_ppm"] is None
    assert clock["jitter_ppm"] == pytest.approx(1e5, rel=1e-2)
    # rows stamped by the declared rate say nothing of it
    unstamped = quality(np.arange(500) / 100, rate=100, columns={"time": None})
    assert unstamped.quality["clock"]["drift_ppm"] is None


def bursts(rows, size=5, rate=100, spacing=0.002, seed=6):
    """Return stamps of a host to whom samples come `size` at once, some milliseconds late."""
    rng = np.random.default_rng(seed)
    first = np.arange(rows) // size
    sent = (first + 1) * size / rate
    late = rng.gamma(2, 0.001, first[-1] + 1)[first]
    return sent + late + spacing * (np.arange(rows) % size)


def test_bursts_are_rebuilt(log, quality):
    log.loc[[7, 300], "ax"] = np.nan
    stamps = bursts(500)
    done = quality(stamps)
    clock = done.quality["clock"]
    # a row that is dropped keeps its place
    rows = np.delete(np.arange(500), [7, 300])
    np.testing.assert_allclose(done.samples.t, rows / 100, rtol=1e-3, atol=1e-12)
    # what was stamped is kept beside it
    np.testing.assert_array_equal(done.samples.t_logged, stamps[rows] - stamps[0])
    assert "t_logged" not in done.quality["range"]
    assert done.quality["status"] == "ok"
    assert clock["rebuilt"]
    assert clock["jitter_ppm"] < 1e-3
    # 99 pauses, and a row dropped in the middle of a burst
    assert clock["logged"]["gaps"]["count"] == 100
    assert clock["logged"]["jitter"]["std_s"] > 0
    # the two rows dropped
    assert done.quality["gaps"]["count"] == 2
    assert "in bursts (median step 2 ms, mean 9.97 ms)" in done.quality["warnings"][0]


def test_the_rate_of_bursts_is_that_of_the_sensor(log, run):
    rows = 50_000
    table = pd.DataFrame({name: np.resize(log[name], rows) for name in log})
    table["t"] = bursts(rows, rate=204.8, spacing=1e-4)
    # a stall of the host, and no row lost
    table.loc[20_000:20_400, "t"] = table.t[20_400] + 1e-6 * np.arange(401)
    table.loc[20_401:, "t"] += 4e-4
    done = run(table, rate=205)
    assert done.quality["clock"]["rebuilt"]
    assert done.quality["rate_hz"] == pytest.approx(204.8, rel=5e-6)


def test_the_rate_does_not_depend_on_where_in_a_transfer_a_log_ends(log, run):
    """Half the log is no whole number of transfers: most pairs of rows are late by one step."""
    table = pd.DataFrame({name: np.resize(log[name], 13_374) for name in log})
    table["t"] = bursts(13_374, spacing=2e-5)
    assert run(table, rate=100).quality["rate_hz"] == pytest.approx(100, rel=1e-5)


@pytest.fixture
def turning(log):
    """The log over 200 s, turned to and fro; stamps are made by the test."""
    table = pd.DataFrame({name: np.resize(log[name], 20_000) for name in log})
    rng = np.random.default_rng(11)
    for name in ("gx", "gy", "gz"):
        table[name] = rng.normal(0, 0.005, len(table))
    return table


def turned(table, t):
    turn = {name: table[name] + 2 * np.sin((k + 2) * t) for k, name in enumerate(("gx", "gz"))}
    return table.assign(**turn)


@pytest.mark.parametrize("std", [0.0005, 0.005])
def test_stamps_that_scatter_are_rebuilt(turning, run, std):
    even = np.arange(20_000) / 100
    stamps = even + np.random.default_rng(12).normal(0, std, 20_000)
    table = turned(turning, even).assign(t=stamps)
    done = run(table)
    assert done.quality["status"] == "ok"
    assert done.quality["clock"]["rebuilt"]
    # rows count in their order, whatever their stamps; a few that run far ahead are missing
    assert done.quality["out_of_order"] == 0
    assert len(done.samples) + done.quality["clock"]["strays"] == 20_000
    assert done.quality["rate_hz"] == pytest.approx(100, rel=1e-5)
    assert np.abs(done.samples.t_logged - done.samples.t).max() < 9 * std
    assert "scatter about a regular clock" in done.quality["warnings"][0]


def test_stamps_that_scatter_stay_where_a_sample_is_lost(turning, run):
    even = np.arange(20_000) / 100
    stamps = even + np.random.default_rng(13).normal(0, 0.002, 20_000)
    table = turned(turning, even).assign(t=stamps).drop(index=[9_000])
    assert not run(table).quality["clock"]["rebuilt"]


def test_stamps_at_which_the_sensor_was_sampled_stay(turning, run):
    stamps = np.arange(20_000) / 100 + np.random.default_rng(14).normal(0, 0.002, 20_000)
    table = turned(turning, stamps).assign(t=stamps)
    done = run(table)
    assert not done.quality["clock"]["rebuilt"]
    assert "t_logged" not in done.samples


@pytest.mark.parametrize("declared", [{}, {"rate": 500}])
def test_rows_lost_or_a_sensor_that_pauses_are_not_rebuilt(quality, declared):
    stamps = bursts(500)
    if not declared:
        stamps[250:] += 3
    done = quality(stamps, **declared)
    assert not done.quality["clock"]["rebuilt"]
    assert done.quality["clock"]["logged"] is None
    np.testing.assert_array_equal(done.samples.t, stamps - stamps[0])


def held_back(log, rows, seed):
    """A log whose transfers come after random pauses of some tenths of a second."""
    rng = np.random.default_rng(seed)
    table = pd.DataFrame({name: np.resize(log[name], rows) for name in log})
    sizes = rng.integers(2, 60, rows)
    first = np.concatenate([[0], np.cumsum(sizes)])
    first = first[first < rows]
    number = np.searchsorted(first, np.arange(rows), side="right") - 1
    # a random walk, on no line
    sent = np.cumsum(rng.exponential(0.31, len(first)))
    table["t"] = sent[number] + 0.002 * (np.arange(rows) - first[number])
    return table.sort_values("t", ignore_index=True)


def test_bursts_that_cannot_be_rebuilt_are_reported_with_what_to_declare(log, run):
    few, many = (held_back(log, rows, 8) for rows in (20_000, 60_000))
    done = run(few).quality
    mean = done["duration_s"] / (done["rows"] - 1)
    assert not done["clock"]["rebuilt"] and done["status"] == "ok"
    [line] = [line for line in done["warnings"] if "bursts" in line]
    assert "columns: {time: null}" in line and f"about rate: {1 / mean:.4g}" in line
    # of a thousand and more nothing is left to work on
    done = run(many).quality
    assert done["gaps"]["count"] > 1000
    assert (done["status"], done["misdeclared"]) == ("rejected", True)
    assert "columns: {time: null}" in done["reasons"][0]
    # and what is declared then is taken
    rate = float(done["reasons"][0].split("about rate: ")[1])
    done = run(many, columns={"time": None}, rate=rate).quality
    assert (done["status"], done["gaps"]["count"]) == ("ok", 0)
