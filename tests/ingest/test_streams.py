"""Logs of several streams: which are chosen, and how they come onto one clock."""

import numpy as np
import pyarrow as pa
import pytest

from imuloop.core.errors import ImuloopError, RejectedLog
from imuloop.ingest.streams import Stream, raw_log

RNG = np.random.default_rng(3)
ROWS = 300
ACC = [f"acc.{axis}" for axis in "xyz"]
GYRO = [f"gyro.{axis}" for axis in "xyz"]


def stream(name="imu", fields=(*ACC, *GYRO), stamps=None, **units):
    stamps = np.arange(ROWS) / 100 if stamps is None else stamps
    return Stream(name, stamps, {key: RNG.normal(size=len(stamps)) for key in fields}, units)


def arrays(log):
    table = pa.Table.from_batches(list(log.batches))
    return {name: table[name].to_numpy() for name in table.column_names}


def two_clocks(at, known, values):
    """Return the table of a gyroscope with stamps `at`, and an accelerometer with `known`."""
    acc = Stream("acc", known, dict.fromkeys(ACC, values))
    log = raw_log([acc, stream("gyro", GYRO, at)])
    return arrays(log), log


def test_one_stream_is_given_as_it_is():
    imu, other = stream(acceleration="g", time="ns"), stream("gps", ["lat", "lon"])
    log = raw_log([other, imu])
    table = arrays(log)
    for name, field in zip("ax ay az gx gy gz".split(), [*ACC, *GYRO], strict=True):
        np.testing.assert_array_equal(table[name], imu.fields[field])
    np.testing.assert_array_equal(table["stamp"], imu.stamps)
    assert log.found == {
        "acceleration": [f"imu.{name}" for name in ACC],
        "angular_rate": [f"imu.{name}" for name in GYRO],
        "time": "imu stamps",
    }
    assert (log.units, log.notes, log.temperature) == ({"acceleration": "g", "time": "ns"}, [], 0)


def test_a_stream_of_both_sensors_goes_before_those_of_one():
    log = raw_log([stream("acc", ACC), stream("imu"), stream("gyro", GYRO)])
    assert log.found["acceleration"][0] == "imu.acc.x"
    assert log.found["angular_rate"][0] == "imu.gyro.x"


def test_two_that_are_alike_must_be_distinguished():
    streams = [stream("imu0"), stream("imu1")]
    text = r"^imu0 \(acc\.x, acc\.y, acc\.z\) and imu1 .* name one of them in columns\.acceleration"
    with pytest.raises(ImuloopError, match=text):
        raw_log(streams)
    fields = [f"imu1.{name}" for name in ACC]
    assert raw_log(streams, {"acceleration": fields}).found["acceleration"] == fields


def test_a_declared_stream_needs_no_usual_names():
    streams = [stream("left", ["x", "y", "z"]), stream("right", ["v_x", "v_y", "v_z", "w_x"])]
    log = raw_log(streams, {"acceleration": "left", "angular_rate": "right"})
    assert log.found["acceleration"] == ["left.x", "left.y", "left.z"]
    assert log.found["angular_rate"] == ["right.v_x", "right.v_y", "right.v_z"]


@pytest.mark.parametrize(
    ("columns", "line"),
    [
        ({"acceleration": "imo"}, "no stream 'imo'; there are imu, two; did you mean 'imu'?"),
        (
            {"acceleration": "two"},
            "two holds lx, ly, lz, rx, ry, rz; name x, y and z of it as two.FIELD",
        ),
        (
            {"acceleration": ["imu.acc.x", "imu.acc.y", "imu.acc.w"]},
            "no column 'imu.acc.w'; did you mean .*; the log's streams are imu, two",
        ),
        ({"acceleration": ["imu.acc.x", "imu.acc.y", "two.lx"]}, "x, y and z are not in one str"),
        ({"acceleration": ["imu.acc.x"]}, r"\['imu.acc.x'\] is not a list of three columns"),
        ({"acceleration": [0, 1, 2]}, "no column '0'"),
        ({"time": "two.lx"}, "two.lx is not in imu"),
        ({"temperature": "imu.temp"}, "no column 'imu.temp'"),
    ],
)
def test_what_is_declared_wrongly_is_one_line(columns, line):
    streams = [stream(), stream("two", ["lx", "ly", "lz", "rx", "ry", "rz"])]
    [quantity] = columns
    with pytest.raises(ImuloopError, match=rf"^columns\.{quantity}: {line}") as caught:
        raw_log(streams, columns)
    assert "\n" not in str(caught.value)


def test_streams_without_rows():
    none = np.empty(0)
    half = [stream("acc", ACC), stream("gyro", GYRO, none)]
    for streams, what in (([], "the log"), ([stream(stamps=none)], "the log"), (half, "gyro")):
        with pytest.raises(RejectedLog, match=f"^{what} has no rows$"):
            raw_log(streams)
    # an empty one does not stand beside one with rows
    log = raw_log([stream("imu0", stamps=none), stream("imu1")])
    assert log.found["acceleration"][0] == "imu1.acc.x"


@pytest.mark.parametrize(
    ("slow", "fast", "slower"),
    [
        *((1, fast, slower) for fast in (8, 6.4, 4 / 3) for slower in ("acc", "gyro")),
        (1, 1.003, "acc"),
    ],
)
def test_each_sample_of_the_slower_is_held_where_it_is_nearest(slow, fast, slower):
    at, known = 0.3 / fast + np.arange(int(200 * fast)) / fast, np.arange(int(200 * slow)) / slow
    value = np.arange(len(known), dtype=float)
    own, other = (ACC, GYRO) if slower == "acc" else (GYRO, ACC)
    log = raw_log([stream("fast", other, at), Stream("slow", known, dict.fromkeys(own, value))])
    table = arrays(log)
    held = table["ax" if slower == "acc" else "gx"]
    np.testing.assert_array_equal(table["stamp"], at)
    near = np.isfinite(held)
    assert near[at <= known[-1]].all()
    # by brute force; the samples of the slower are numbered
    nearest = np.abs(at[near, None] - known).argmin(axis=1)
    np.testing.assert_array_equal(held[near], nearest)
    np.testing.assert_array_equal(table["held"][near], known[nearest])
    assert set(held[near]) == set(value)
    assert log.slower == {"acc": "accelerometer", "gyro": "gyroscope"}[slower]
    assert log.notes == [
        f"{'acceleration' if slower == 'acc' else 'angular_rate'} of slow has a clock of its own: "
        "each row of fast holds its nearest sample"
    ]


def test_of_clocks_as_fast_the_gyroscope_s_is_taken():
    acc = Stream("acc", np.arange(ROWS) * 0.01 + 0.004, dict.fromkeys(ACC, np.zeros(ROWS)))
    assert raw_log([acc, stream("gyro", GYRO)]).found["time"] == "gyro stamps"


def test_nothing_is_held_over_a_gap_or_beyond_the_ends():
    known = np.delete(np.arange(1, 100.0), slice(39, 49))
    at = np.arange(0, 101, 0.5)
    table, _ = two_clocks(at, known, known)
    # three quarters of a step is as far as half a gap goes
    far = np.abs(at[:, None] - known).min(axis=1) > 0.75
    np.testing.assert_array_equal(np.isnan(table["ax"]), far)
    assert far.sum() == 2 * 9 + 1 + 1 + 2


def test_rows_missing_repeated_or_out_of_order_are_left_out():
    known = np.arange(100.0)
    values = 2 * known
    values[10], values[20], known[30], known[40], known[50] = np.nan, np.inf, np.nan, 39, 45
    table, log = two_clocks(np.arange(5.5, 95, 0.5), known, values)
    at, lost = table["stamp"], np.isnan(table["ax"])
    assert set(at[lost]) == {10.0, 20.0, 30.0, 40.0, 50.0}
    assert not set(table["held"][~lost]) & {10.0, 20.0, 45.5}
    assert log.notes[0].endswith("; 5 of its rows missing, repeated or out of order are left out")


def test_a_time_cannot_be_declared_of_two_clocks():
    streams = [stream("acc", ACC, np.arange(ROWS) / 50), stream("gyro", [*GYRO, "clock"])]
    with pytest.raises(ImuloopError, match=r"^columns\.time: each sensor has a clock of its own"):
        raw_log(streams, {"time": "gyro.clock"})


AWAY = np.arange(ROWS) + 1e9, np.full(ROWS, np.nan), np.full(ROWS, 0.005)


@pytest.mark.parametrize("known", [*AWAY, np.geomspace(1e290, 1e308, ROWS)])
def test_clocks_without_a_time_in_common_are_rejected(known):
    with pytest.raises(RejectedLog, match=r"^gyro and acc share no time: their clocks differ$"):
        raw_log([stream("acc", ACC), stream("gyro", GYRO, known)])


def test_whole_nanoseconds_keep_all_their_digits():
    start = 1_700_000_000_123_456_789
    at = start + 10_000_000 * np.arange(200)
    known = start - 5 + 10_000_000 * np.arange(201, dtype=np.uint64)
    table, _ = two_clocks(at, known, np.arange(201.0))
    assert table["stamp"].dtype == table["held"].dtype == np.int64
    np.testing.assert_array_equal(table["stamp"], at)
    # five nanoseconds after each of the accelerometer's, of which a double would know nothing
    np.testing.assert_array_equal(table["held"], at - 5)


def test_temperature_of_a_slow_clock():
    slow = np.arange(0.25, 2.5, 0.5)
    thermometer = Stream("baro", slow, {"temperature": 20 + 4 * slow}, {"temperature": "K"})
    log = raw_log([stream(), thermometer])
    table = arrays(log)
    inside = (table["stamp"] >= 0.25) & (table["stamp"] <= 2.25)
    np.testing.assert_array_equal(np.isfinite(table["temperature"]), inside)
    np.testing.assert_allclose(table["temperature"][inside], 20 + 4 * table["stamp"][inside])
    assert log.found["temperature"] == "baro.temperature"
    assert log.units == {"temperature": "K"}
    assert log.notes == ["temperature of baro interpolated linearly onto the stamps of imu"]
    assert not raw_log([stream(), thermometer], {"temperature": None}).temperature


def test_of_several_temperatures_none_is_taken_unless_declared():
    streams = [stream(), stream("baro", ["temp"]), stream("gps", ["temp"])]
    log = raw_log(streams)
    assert not log.temperature
    assert log.notes == [
        "temperature not read: baro.temp, gps.temp; name one of them in columns.temperature"
    ]
    assert raw_log(streams, {"temperature": "gps.temp"}).found["temperature"] == "gps.temp"


def clocks(kind, **changed):
    """Return an accelerometer at 100 Hz and a gyroscope at 200 Hz; one has a clock that changes."""
    streams = []
    for name, fields, step in (("acc", ACC, 10_000), ("gyro", GYRO, 5_000)):
        stamps = 2**30 - 20_000_000 + step * np.arange(40_000_000 // step)
        if name == kind:
            stamps = changed["change"](stamps)
        streams.append(Stream(name, stamps, dict.fromkeys(fields, stamps * 1e-6), {"time": "us"}))
    return streams


@pytest.mark.parametrize("kind", ["acc", "gyro"])
@pytest.mark.parametrize("width", [2**30, 2**30 + 5_000_077])
def test_a_clock_that_starts_again_beside_another_is_rejected(kind, width):
    with pytest.raises(RejectedLog, match=f"the clock of {kind} starts again within the log"):
        raw_log(clocks(kind, change=lambda stamps: stamps % width))


@pytest.mark.parametrize("kind", ["acc", "gyro"])
def test_a_stray_stamp_of_one_stream_costs_its_row_alone(kind):
    far = 10**12 * (np.arange(8000) == 700)
    table = arrays(raw_log(clocks(kind, change=lambda stamps: stamps + far[: len(stamps)])))
    assert 0 < (~np.isfinite(table["ax"])).sum() <= 4
