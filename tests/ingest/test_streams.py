"""Several tables or streams in a log: which hold the sensors, and how they come onto one clock."""

import numpy as np
import pytest

from imuloop.core.errors import RejectedLog
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.ingest.streams import Stream, raw_log
from ingest.logs import RATE, brief
from ingest.phone_forms import zipped
from ingest.text_forms import SIX
from ingest.written import phyphox, timed

RNG = np.random.default_rng(3)
ROWS = 300
ACC = [f"acc.{axis}" for axis in "xyz"]
GYRO = [f"gyro.{axis}" for axis in "xyz"]


def stream(name="imu", fields=(*ACC, *GYRO), stamps=None, **units):
    stamps = np.arange(ROWS) / 100 if stamps is None else stamps
    return Stream(name, stamps, {key: RNG.normal(size=len(stamps)) for key in fields}, units)


def arrays(log):
    return {name: log.batch[name].to_numpy() for name in log.batch.schema.names}


def two_clocks(at, times, values):
    """Return the table of a gyroscope with stamps `at`, and an accelerometer with `times`."""
    log = raw_log([Stream("acc", times, dict.fromkeys(ACC, values)), stream("gyro", GYRO, at)])
    return arrays(log), log


REFUSED = [
    (GYRO, np.empty(0), "gyro has no rows$"),
    (GYRO, np.arange(ROWS) % 200 / 100, "the clock of gyro starts again within the log"),
    *((GYRO, times, "(gyro and acc|acc and gyro) share no time: their clocks differ$")
      for times in (np.arange(ROWS) + 1e9, np.geomspace(1e290, 1e308, ROWS))),
]  # fmt: skip


@pytest.mark.parametrize(("fields", "stamps", "line"), REFUSED)
def test_streams_that_share_no_time_are_one_line(fields, stamps, line):
    with pytest.raises(RejectedLog, match=f"^{line}"):
        raw_log([stream("acc", ACC), stream("gyro", fields, stamps)])


# a stream without rows, or with zeros alone, does not compete with one that measures
@pytest.mark.parametrize("stamps", [np.empty(0), np.arange(ROWS) / 100])
def test_a_stream_that_measures_is_chosen(stamps):
    empty = Stream("imu0", stamps, dict.fromkeys((*ACC, *GYRO), np.zeros(len(stamps))))
    streams = [empty, stream("acc", ACC), stream(), stream("gyro", GYRO)]
    assert raw_log(streams).names["acceleration"] == [f"imu.{a}" for a in ACC]


# --- onto one clock


@pytest.mark.parametrize(("fast", "slower"), [(8, "acc"), (6.4, "gyro"), (1.003, "acc")])
def test_each_sample_of_the_slower_is_held_where_it_is_nearest(fast, slower):
    """And nowhere over a gap: three quarters of a step is as far as half a gap goes."""
    times = np.delete(np.arange(200.0), slice(39, 49))
    at = 0.3 / fast + np.arange(int(200 * fast)) / fast
    fields, others = (ACC, GYRO) if slower == "acc" else (GYRO, ACC)
    log = raw_log([stream("fast", others, at), Stream("slow", times, dict.fromkeys(fields, times))])
    table, far = arrays(log), np.abs(at[:, None] - times).min(axis=1) > 0.75
    samples = table["ax" if slower == "acc" else "gx"]
    np.testing.assert_array_equal(table["stamp"], at)
    np.testing.assert_array_equal(np.isnan(samples), far)
    # by brute force; the samples of the slower are numbered
    nearest = times[np.abs(at[~far, None] - times).argmin(axis=1)]
    np.testing.assert_array_equal(samples[~far], nearest)
    np.testing.assert_array_equal(table["held"][~far], nearest)
    assert {*nearest} == {*times}
    quantity = {"acc": "acceleration", "gyro": "angular_rate"}[slower]
    assert log.slower == {"acc": "accelerometer", "gyro": "gyroscope"}[slower]
    line = "of slow has a clock of its own: each row of fast holds its nearest sample"
    assert log.notes == [f"{quantity} {line}"]


def test_rows_of_a_stream_missing_repeated_or_out_of_order_are_left_out():
    times = np.arange(100.0)
    values = 2 * times
    values[10], values[20], times[30], times[40], times[50] = np.nan, np.inf, np.nan, 39, 45
    table, log = two_clocks(np.arange(5.5, 95, 0.5), times, values)
    at, lost = table["stamp"], np.isnan(table["ax"])
    assert {*at[lost]} == {10.0, 20.0, 30.0, 40.0, 50.0}
    assert not {*table["held"][~lost]} & {10.0, 20.0, 45.5}
    assert log.notes[0].endswith("; 4 of its rows missing, repeated or out of order are left out")
    # and the one without a stamp
    assert log.bad_lines == 1


def test_whole_nanoseconds_of_two_clocks_keep_all_their_digits():
    start = 1_700_000_000_123_456_789
    at = start + 10_000_000 * np.arange(200)
    times = start - 5 + 10_000_000 * np.arange(201, dtype=np.uint64)
    table, _ = two_clocks(at, times, np.arange(201.0))
    assert table["stamp"].dtype == table["held"].dtype == np.int64
    np.testing.assert_array_equal(table["stamp"], at)
    # five nanoseconds after each of the accelerometer's, of which a double would know nothing
    np.testing.assert_array_equal(table["held"], at - 5)


def test_a_temperature_of_a_slow_clock_is_interpolated_and_of_several_none_is_taken():
    slow = np.arange(0.25, 2.5, 0.5)
    thermometer = Stream("baro", slow, {"temperature": 20 + 4 * slow}, {"temperature": "K"})
    log = raw_log([stream(), thermometer])
    table = arrays(log)
    inside = (table["stamp"] >= 0.25) & (table["stamp"] <= 2.25)
    np.testing.assert_array_equal(np.isfinite(table["temperature"]), inside)
    np.testing.assert_allclose(table["temperature"][inside], 20 + 4 * table["stamp"][inside])
    assert log.names["temperature"] == "baro.temperature" and log.units == {"temperature": "K"}
    assert log.notes == ["temperature of baro interpolated linearly onto the stamps of imu"]
    assert not raw_log([stream(), thermometer], {"temperature": None}).temperature
    log = raw_log([stream(), stream("baro", ["temp"]), stream("gps", ["temp"])])
    line = "temperature not read: baro, gps hold one; name it in columns.temperature"
    assert not log.temperature and log.notes == [line]


# --- tables of each sensor, or rows of each in one


def in_turn(count=3000, rate=250.0, share=3, empty=np.nan, both=False):
    """A table of which each row holds one sensor alone, or of which every few hold the force."""
    log, force = brief(count), np.arange(count) % share == share - 1
    log["t"] = np.arange(count) / rate
    log.loc[~force, [*ACCELERATION]] = empty
    if not both:
        log.loc[force, [*ANGULAR_RATE]] = empty
    return log


@pytest.mark.parametrize("empty", [0.0, np.nan])
def test_rows_of_two_sensors_in_turn_are_two_streams(run, empty):
    table = in_turn(empty=empty)
    done = run(table)
    assert done.quality["status"] == "ok"
    assert "the rows hold the accelerometer and the gyroscope in turn" in done.quality["warnings"]
    # the sensor whose clock is the log's keeps its values
    assert max(np.isin(done.samples[c], table[c]).mean() for c in ("ax", "gx")) == 1


def test_an_outer_join_of_two_rates_keeps_all_samples_zeros_too(log, run):
    table = in_turn(2000, 200.0, 4, both=True)
    done = run(table)
    assert done.quality["status"] == "ok"
    assert all(np.isin(done.samples[c], table[c]).all() for c in SIX)
    # a gyroscope of whole degrees at rest takes no turns
    log[RATE] = 0.0
    log.loc[::2, "gz"] = 1.0
    quality = run(log, units={"angular_rate": "deg/s"}).quality
    assert not any("in turn" in line for line in quality["warnings"])


# --- phones


@pytest.mark.parametrize(("separator", "decimal"), [",.", ";,"])
def test_a_pause_of_phyphox_is_a_gap(log, run, tmp_path, separator, decimal):
    members = phyphox(log, separator=separator, decimal=decimal)
    # the phone's clock is set back by a minute, then the experiment pauses for 30 s and 7 s
    starts = [(0, 1.7e9), (1.005, 1.7e9 - 59), (2.005, 1.7e9 + 32.005), (3.005, 1.7e9 + 40.005)]
    members["meta/time.csv"] = timed(separator, decimal, *starts)
    zipped(tmp_path / "log.zip", members)
    done = run(tmp_path / "log.zip")
    later = np.select([log.t > 3.005, log.t > 2.005], [37, 30], 0)
    np.testing.assert_allclose(done.samples.t, log.t + later, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(done.samples.t[:200], log.t[:200])
    assert done.quality["gaps"]["count"] == 2
    lines = [x for x in done.quality["warnings"] if x.startswith("paused 2 times, 37 s together")]
    assert len(lines) == 1


def test_damage_to_an_export_is_counted(log, run, tmp_path):
    members = phyphox(log)
    rows = members["Accelerometer.csv"].splitlines()
    rows[3], rows[5], rows[7] = "what", "x,1,2,3", "0.06,1,NaN,3"
    members["Accelerometer.csv"] = "\n".join(rows)
    zipped(path := tmp_path / "log.zip", members)
    done = run(path)
    # no sample of the accelerometer is near three rows
    assert (done.quality["bad_lines"], done.quality["non_finite"]) == (2, 3)
    np.testing.assert_array_equal(done.samples.gx, log.gx.drop([2, 4, 6]))
