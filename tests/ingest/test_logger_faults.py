"""Faults of loggers as public reports describe them: each read, or rejected with its own cause."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import butter, lfilter

from calibrate.devices import planned
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE, CHANNELS
from imuloop.core.units import DEGREE, STANDARD_GRAVITY
from imuloop.noise.noise import estimate_noise
from imuloop.noise.records import RecordedSession
from imuloop.noise.settings import NoiseSettings
from imuloop.segment.segment import segment_session
from imuloop.segment.settings import SegmentSettings
from imuloop.simulate.simulate import simulate_session
from imuloop.simulate.truth import example_truth

STEPS = [1 / 2048] * 3 + [0.001] * 3


def poses(rate=100.0, seed=3, count=9):
    """Poses by hand, in steps of an integer's last bit, from t = 0."""
    truth = planned(example_truth(rate=rate), "multi_position", poses=count)
    log = simulate_session(truth, "multi_position", seed)
    log[list(CHANNELS)] = np.round(log[list(CHANNELS)] / STEPS) * STEPS
    return log.assign(t=np.arange(len(log)) / rate)


@pytest.fixture(scope="module")
def log():
    return poses()


@pytest.fixture
def taken(run):
    def call(log, **declared):
        found = run(log, **declared).quality
        return found["reasons"], found["warnings"], found

    return call


@pytest.mark.parametrize(
    ("every", "value", "names", "said"),
    [
        (2, 32767 * 0.001, ["gy", "gz"], "gy, gz: every other row holds"),
        (3, 32767 * 0.001, ["gx"], "gx: 33% of rows hold"),
        (2, -1 / 2048, ACCELERATION, "ax, ay, az: every other row holds"),
        (2, 0.0, ACCELERATION, "ax, ay, az: every other row holds"),
        (3, 0.0, ANGULAR_RATE, "gx, gy, gz: 33% of rows hold"),
        (2, 0.0, CHANNELS, "ax, ay, az, gx, gy, gz: every other row holds"),
    ],
)
def test_reads_that_fail_again_and_again(log, taken, every, value, names, said):
    """Protects from a calibration of half a log: such rows pass for clipped ones, or padding."""
    log = log.copy()
    log.loc[1::every, list(names)] = value
    [reason], warnings, _ = taken(log)
    assert reason.startswith(said) and "failed reads" in reason
    assert warnings == []


def test_turns_that_are_clipped_are_no_failed_reads(log, taken):
    log = log.copy()
    log[list(ANGULAR_RATE)] = log[list(ANGULAR_RATE)].clip(-0.5, 0.5)
    reasons, _, found = taken(log)
    assert reasons == [] and not any(found["faults"]["failed_reads"].values())


def test_a_gyroscope_of_coarse_steps_is_not_in_turn(log, taken):
    log = log.copy()
    log[list(ANGULAR_RATE)] = np.round(log[list(ANGULAR_RATE)] / 0.2) * 0.2
    assert not any("in turn" in line for line in taken(log)[0])


@pytest.mark.parametrize("factor", [100.0, 20.0])
def test_gravity_off_by_a_factor_is_not_taken_out(log, taken, factor):
    """Protects a log whose force is the same in every attitude: gravity is in it."""
    log = log.copy()
    log[list(ACCELERATION)] /= factor
    reasons, warnings, _ = taken(log)
    [line] = reasons or warnings
    assert f"gravity is in it, in 10 attitudes, {1 / factor:.2g}" in line


@pytest.mark.parametrize("seed", range(6))
def test_white_noise_of_a_few_blocks_is_not_filtered(taken, seed):
    noise = np.random.default_rng(seed).normal(size=(1100, 6)) * ([0.03] * 3 + [0.002] * 3)
    log = pd.DataFrame(np.add(noise, [0.1, 0.2, 9.7, 0, 0, 0]), columns=CHANNELS)
    log.insert(0, "t", np.arange(1100) / 350)
    assert taken(log, kind="static")[:2] == ([], [])


def filter_notes(log, kind):
    """Return what the noise of a log says of power that a filter took."""
    segments, _ = segment_session(log, kind, SegmentSettings())
    session = RecordedSession("log", kind, log, segments)
    found = estimate_noise("imu", [session], NoiseSettings(), views=False)
    return [note for note in found.notes if "power is lacking" in note]


@pytest.mark.parametrize("rate", [10.0, 25.0, 40.0])
def test_short_rests_at_a_low_rate_are_not_filtered(rate):
    """Protects from motion between short rests passing for noise without its upper half."""
    for seed in range(3):
        assert not filter_notes(poses(rate, 30 + seed, 12), "multi_position")


@pytest.mark.parametrize(("rate", "seconds"), [(20.0, 120), (400.0, 8)])
def test_a_filter_is_named_where_rests_carry_it(rate, seconds):
    n = round(rate * seconds)
    noise = lfilter(*butter(2, 0.3), np.random.default_rng(8).normal(size=(n, 6)), axis=0)
    values = noise * ([0.03] * 3 + [0.002] * 3) + [0.1, 0.2, 9.7, 0, 0, 0]
    log = pd.DataFrame(values, columns=CHANNELS).assign(t=np.arange(n) / rate)
    notes = filter_notes(log, "static")
    assert [note[:2] for note in notes] == [*CHANNELS]


@pytest.mark.parametrize(("first", "every", "rows"), [(0, 3, 64), (1, 2, 1 << 16)])
def test_rows_that_are_written_twice(log, taken, first, every, rows):
    again = log.iloc[np.sort(np.r_[np.arange(len(log)), np.arange(first, len(log), every)])]
    reasons, [line], found = taken(again, batch_rows=rows)
    count = len(again) - len(log)
    assert reasons == [] and line.startswith(f"{count} rows identical to the one before")
    assert (found["identical"], found["duplicates"], found["rows"]) == (count, 0, len(log))
    assert found["rows_read"] == len(again)


def test_a_repeated_stamp_with_other_values_is_not_identical(log, taken):
    other = log.copy()
    other.loc[500:501, "t"] = log.t[499]
    found = taken(other)[2]
    assert (found["identical"], found["duplicates"]) == (0, 2)


def in_packets(log, size, share, late, end=True):
    """Stamps of a host: some packets have one, that of their last row or of their first."""
    rng = np.random.default_rng(5)
    t = log.t.to_numpy() + late * rng.random(len(log))
    for start in range(0, len(log) - size, size):
        if rng.random() < share:
            t[start : start + size] = t[start + (size - 1) * end]
    return log.assign(t=t)


@pytest.mark.parametrize(
    ("size", "share", "late"), [(5, 0.2, 2e-3), (8, 1.0, 0.0), (3, 0.6, 1e-4), (2, 0.005, 1e-4)]
)
@pytest.mark.parametrize("end", [True, False])
def test_packets_that_share_a_stamp_are_rebuilt(log, taken, size, share, late, end):
    """Protects their samples: those that repeat a stamp were dropped, and gaps and scales found."""
    packets = in_packets(log, size, share, late, end)
    reasons, [line], found = taken(packets)
    assert reasons == [] and "as of packets of samples: t is rebuilt from the row number" in line
    assert found["rows"] == len(log) and found["gaps"]["count"] == found["duplicates"] == 0
    assert found["rate_hz"] == pytest.approx(100, rel=1e-3)
    assert taken(packets, rate=100)[:2] == ([], [line])


@pytest.mark.parametrize("end", [True, False])
@pytest.mark.parametrize("rate", [None, 100, 50])
def test_packets_are_spread_where_samples_are_lost_or_the_sensor_pauses(log, run, end, rate):
    packets = in_packets(log, 4, 0.3, 1e-4, end)
    packets.loc[4000:, "t"] += 3.0
    packets = packets[np.random.default_rng(1).random(len(log)) > 0.01]
    done = run(packets, rate=rate)
    found = done.quality
    assert found["reasons"] == [] and found["duplicates"] == found["out_of_order"] == 0
    assert found["rows"] == len(packets)
    true = (packets.t.index.to_numpy() + 300 * (packets.t.index >= 4000)) / 100
    # a packet that lost a row is off by a step
    away = np.abs(done.samples.t - (true - true[0]))
    assert np.quantile(away, 0.97) < 0.002 and away.max() < 0.05
    assert any("s apart within each packet" in line for line in found["warnings"])
    assert not any("scale" in line for line in found["warnings"])
    again = run(packets, rate=rate, batch_rows=77)
    np.testing.assert_array_equal(again.samples, done.samples)


@pytest.mark.parametrize("count", [3, 12])
def test_wraps_do_not_hide_the_units(log, taken, count):
    """Protects the unit checks of a log of which an integer wrapped around a few times."""
    log = log.copy()
    log[list(ACCELERATION)] /= STANDARD_GRAVITY
    log[list(ANGULAR_RATE)] /= DEGREE
    fastest = log.gx.abs().rolling(9, center=True).mean().nlargest(200).index
    for k in range(count):
        at = fastest[0] + 40 * k
        log.loc[at, "gx"], log.loc[at + 1 : at + 20, "gx"] = 3276.7, -3276.7
        log.loc[at + 2 : at + 20, "gx"] += np.arange(19) * 0.3
        log.loc[at - 3 : at - 1, "gx"] = [3276.0, 3276.2, 3276.5]
        log.loc[at + 21 : at + 22, "gx"] = [3276.2, 3275.5]
    reasons, warnings, found = taken(log)
    assert found["faults"]["wraps"]["gx"] >= count
    assert any("an integer that wraps around" in line for line in warnings)
    assert "taken as m/s^2, it looks like g" in reasons[0]
    assert "taken as rad/s, it looks like deg/s" in reasons[1]


@pytest.mark.parametrize("seed", [4, 5])
def test_a_turn_within_a_gap_is_no_change_of_the_sensor(taken, seed):
    log = poses(seed=seed)
    spread = log[list(ANGULAR_RATE)].abs().max(axis=1).rolling(50, center=True).max()
    moving = np.flatnonzero(spread > 0.3)
    # from half a second before the first move to half a second after its end
    end = moving[np.flatnonzero(np.diff(moving) > 50)[0]] + 50
    kept = log.drop(index=range(moving[0] - 50, end))
    reasons, warnings, found = taken(kept)
    assert reasons == [] and len(warnings) == 2 and warnings[0].startswith("1 gap")
    assert "was turned while nothing was logged" in warnings[1]
    at = found["faults"]["rests"]["gap_s"]
    assert at == pytest.approx(log.t[moving[0] - 51])


def test_lost_samples_do_not_hide_turns(log, taken):
    """Protects the scale by turns of a log of which one sample in thirty is lost, in moves too."""
    kept = log[np.random.default_rng(2).random(len(log)) > 0.03]
    reasons, warnings, found = taken(kept)
    assert reasons == [] and len(warnings) == 1 and "gaps" in warnings[0]
    assert found["faults"]["rests"]["turn_ratio"]["moves"] >= 8


@pytest.mark.parametrize(("rate", "first"), [(40.0, 0.007), (125.0, 0.0004)])
def test_nanoseconds_without_leading_zeros(log, tmp_path, run, rate, first):
    """Protects from a log in pieces: such stamps pass for a clock that starts again each second."""
    ns = np.round((first + np.arange(len(log)) / rate) * 1e9).astype(int) + 1_700_000_000 * 10**9
    stamps = [f"{n // 10**9}.{n % 10**9}" for n in ns.tolist()]
    log.assign(t=stamps).to_csv(tmp_path / "log.csv", index=False)
    found = run(tmp_path / "log.csv").quality
    [reason] = found["reasons"]
    assert "parts of a second were joined without leading zeros" in reason
    assert found["warnings"] == []
    padded = [f"{n // 10**9}.{n % 10**9:09d}" for n in ns.tolist()]
    log.assign(t=padded).to_csv(tmp_path / "log.csv", index=False)
    assert run(tmp_path / "log.csv").quality["reasons"] == []


@pytest.mark.parametrize("ms", [0, 5])
def test_milliseconds_of_dates_without_leading_zeros(log, tmp_path, run, ms):
    """Protects from a log in pieces, each from one tenth of a second to the next."""
    moments = pd.Timestamp("2024-11-18 14:58:30") + pd.to_timedelta(log.t + ms / 1000, unit="s")
    stamps = [f"{m:%Y-%m-%d %H:%M:%S}.{m.microsecond // 1000}" for m in moments]
    log.assign(t=stamps).to_csv(tmp_path / "log.csv", index=False)
    found = run(tmp_path / "log.csv").quality
    assert found["warnings"] == []
    assert "without leading zeros (3 ms as .3)" in found["reasons"][0]
    log.assign(t=moments).to_csv(tmp_path / "log.csv", index=False)
    assert run(tmp_path / "log.csv").quality["reasons"] == []


@pytest.mark.parametrize(("rate", "grid"), [(90.0, 0.01), (62.5, 0.01), (26.0, 0.02)])
def test_stamps_on_a_grid_as_wide_as_a_step(run, rate, grid):
    """Protects from gaps in every ninth row, and a rate, and a scale, that are those of 100 Hz.

    Where samples are lost stamps stay as they are.
    """
    log = poses(rate)
    log.t = np.floor(log.t / grid + 0.3) * grid
    found = run(log).quality
    assert found["rate_hz"] == pytest.approx(rate, rel=1e-4)
    assert found["gaps"]["count"] == 0 and found["clock"]["jitter_ppm"] < 1
    [line] = found["warnings"]
    assert "scatter about a regular clock, no sample is lost" in line
    kept = log[np.random.default_rng(3).random(len(log)) > 0.05]
    assert not run(kept).quality["clock"]["rebuilt"]


def test_samples_that_are_lost_at_even_intervals_are_no_rounded_stamps(log, run):
    """Protects stamps that only the turns tell from those of 90 Hz on a grid of 10 ms."""
    assert not run(log[log.index % 10 > 0]).quality["clock"]["rebuilt"]
