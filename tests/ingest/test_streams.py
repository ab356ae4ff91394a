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


def merged(at, known, values):
    """Return gx of a gyroscope's `values` at stamps `known`, at the accelerometer's `at`."""
    gyro = Stream("gyro", known, dict.fromkeys(GYRO, values))
    log = raw_log([stream("acc", ACC, at), gyro])
    return arrays(log)["gx"], log.notes


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


def test_a_straight_line_is_interpolated_exactly():
    # binary fractions, so that a closed form holds to the last bit
    at, known = np.arange(512) / 64 + 0.0078125, np.arange(1100) / 128
    gx, notes = merged(at, known, 3 - 2 * known)
    np.testing.assert_array_equal(gx, 3 - 2 * at)
    assert notes == [
        "angular_rate of gyro interpolated linearly onto the stamps of acc: "
        "white noise keeps 100% of its variance"
    ]
    gx, _ = merged(at + 0.001, known, 3 - 2 * known)
    np.testing.assert_allclose(gx, 3 - 2 * (at + 0.001), rtol=1e-14)


@pytest.mark.parametrize("share", [0.25, 0.5])
def test_white_noise_keeps_the_share_of_its_variance_that_is_noted(share):
    rows = 200_000
    noise = np.random.default_rng(11).normal(size=rows)
    gx, [note] = merged(np.arange(rows - 1) + share, np.arange(rows), noise)
    kept = share**2 + (1 - share) ** 2
    # the estimate's own standard deviation is below 0.4 %
    np.testing.assert_allclose(gx.var(), kept, rtol=0.016)
    assert note.endswith(f"white noise keeps {kept:.0%} of its variance")


def test_nothing_is_interpolated_over_a_gap_or_beyond_the_ends():
    known = np.delete(np.arange(1, 100.0), slice(39, 49))
    at = np.arange(0, 101, 0.5)
    gx, _ = merged(at, known, known)
    # stamps 40 to 49 are missing; those on the edge of the gap are there
    inside = (at >= 1) & (at <= 99) & ~((at > 39) & (at < 50))
    np.testing.assert_array_equal(np.isnan(gx), ~inside)
    np.testing.assert_array_equal(gx[inside], at[inside])


def test_rows_missing_repeated_or_out_of_order_are_left_out():
    known = np.arange(100.0)
    values = 2 * known
    values[10], values[20], known[30], known[40], known[50] = np.nan, np.inf, np.nan, 39, 45
    at = np.arange(5.5, 95)
    gx, [note] = merged(at, known, values)
    lost = (at > 9) & (at < 11)
    for row in (20, 30, 40, 50):
        lost |= (at > row - 1) & (at < row + 1)
    np.testing.assert_array_equal(np.isnan(gx), lost)
    np.testing.assert_allclose(gx[~lost], 2 * at[~lost], rtol=1e-14)
    assert note.endswith("; 5 of its rows missing, repeated or out of order are left out")


AWAY = np.arange(ROWS) + 1e9, np.full(ROWS, np.nan), np.full(ROWS, 0.005)


@pytest.mark.parametrize("known", [*AWAY, np.geomspace(1e290, 1e308, ROWS)])
def test_clocks_without_a_time_in_common_are_rejected(known):
    with pytest.raises(RejectedLog, match=r"^gyro and acc share no time: their clocks differ$"):
        raw_log([stream("acc", ACC), stream("gyro", GYRO, known)])


def test_whole_nanoseconds_keep_all_their_digits():
    start = 1_700_000_000_123_456_789
    at = start + 10_000_000 * np.arange(200)
    known = start - 5 + 10_000_000 * np.arange(201, dtype=np.uint64)
    acc = stream("acc", ACC, at, time="ns")
    gyro = Stream("gyro", known, dict.fromkeys(GYRO, 10_000_000.0 * np.arange(201)))
    table = arrays(raw_log([acc, gyro]))
    assert table["stamp"].dtype == np.int64
    np.testing.assert_array_equal(table["stamp"], at)
    # five nanoseconds after each of the gyroscope's, of which a double would know nothing
    np.testing.assert_array_equal(table["gx"], 10_000_000.0 * np.arange(200) + 5)


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
    assert 0 < (~np.isfinite(table["gx"])).sum() <= 4
