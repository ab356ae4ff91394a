"""Which streams of a log are chosen, and how streams come onto one clock."""

import numpy as np
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
    table = log.batch
    return {name: table[name].to_numpy() for name in table.column_names}


def two_clocks(at, known, values):
    """Return the table of a gyroscope with stamps `at`, and an accelerometer with `known`."""
    acc = Stream("acc", known, dict.fromkeys(ACC, values))
    log = raw_log([acc, stream("gyro", GYRO, at)])
    return arrays(log), log


NO_ROWS = np.empty(0)


@pytest.mark.parametrize(
    ("streams", "columns", "expected"),
    [
        ([stream("gps", ["lat", "lon"]), stream()], {},
         {"acceleration": [f"imu.{a}" for a in ACC], "time": "imu stamps"}),
        # a stream of both sensors goes before those of one
        ([stream("acc", ACC), stream("imu"), stream("gyro", GYRO)], {},
         {"acceleration": [f"imu.{a}" for a in ACC], "angular_rate": [f"imu.{g}" for g in GYRO]}),
        ([stream("imu0"), stream("imu1")], {"acceleration": [f"imu1.{a}" for a in ACC]},
         {"acceleration": [f"imu1.{a}" for a in ACC]}),
        # a declared stream needs no usual names
        ([stream("left", [*"xyz"]), stream("right", ["v_x", "v_y", "v_z", "w_x"])],
         {"acceleration": "left", "angular_rate": "right"},
         {"acceleration": ["left.x", "left.y", "left.z"],
          "angular_rate": ["right.v_x", "right.v_y", "right.v_z"]}),
        # an empty one does not stand beside one with rows
        ([stream("imu0", stamps=NO_ROWS), stream("imu1")], {},
         {"acceleration": [f"imu1.{a}" for a in ACC]}),
        # of clocks as fast the gyroscope's is taken
        ([stream("acc", ACC, np.arange(ROWS) * 0.01 + 0.004), stream("gyro", GYRO)], {},
         {"time": "gyro stamps"}),
        ([stream(), stream("baro", ["temp"]), stream("gps", ["temp"])],
         {"temperature": "gps.temp"}, {"temperature": "gps.temp"}),
    ],
)  # fmt: skip
def test_the_streams_of_the_sensors_are_chosen(streams, columns, expected):
    found = raw_log(streams, columns).found
    assert {name: found[name] for name in expected} == expected


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
def test_what_is_declared_wrongly_of_streams_is_one_line(columns, line):
    streams = [stream(), stream("two", ["lx", "ly", "lz", "rx", "ry", "rz"])]
    [quantity] = columns
    with pytest.raises(ImuloopError, match=rf"^columns\.{quantity}: {line}") as caught:
        raw_log(streams, columns)
    assert "\n" not in str(caught.value)


def clocks(kind, change):
    """Return an accelerometer at 100 Hz and a gyroscope at 200 Hz; one has a clock that changes."""
    streams = []
    for name, fields, step in (("acc", ACC, 10_000), ("gyro", GYRO, 5_000)):
        stamps = 2**30 - 20_000_000 + step * np.arange(40_000_000 // step)
        stamps = change(stamps) if name == kind else stamps
        streams.append(Stream(name, stamps, dict.fromkeys(fields, stamps * 1e-6), {"time": "us"}))
    return streams


ALIKE = r"imu0 \(acc\.x, acc\.y, acc\.z\) and imu1 .* name one of them in columns\.acceleration"
OWN_CLOCK = r"columns\.time: each sensor has a clock of its own"
NO_COMMON = "gyro and acc share no time: their clocks differ$"
AWAY = [np.arange(ROWS) + 1e9, np.full(ROWS, np.nan), np.full(ROWS, 0.005),
        np.geomspace(1e290, 1e308, ROWS)]  # fmt: skip


@pytest.mark.parametrize(
    ("streams", "columns", "error", "line"),
    [
        ([stream("imu0"), stream("imu1")], {}, ImuloopError, ALIKE),
        ([stream("acc", ACC, np.arange(ROWS) / 50), stream("gyro", [*GYRO, "clock"])],
         {"time": "gyro.clock"}, ImuloopError, OWN_CLOCK),
        ([], {}, RejectedLog, "the log has no rows$"),
        ([stream(stamps=NO_ROWS)], {}, RejectedLog, "the log has no rows$"),
        ([stream("acc", ACC), stream("gyro", GYRO, NO_ROWS)], {}, RejectedLog, "gyro has no rows$"),
        *(([stream("acc", ACC), stream("gyro", GYRO, known)], {}, RejectedLog, NO_COMMON)
          for known in AWAY),
        *((clocks(kind, lambda stamps, w=width: stamps % w), {}, RejectedLog,
           f"the clock of {kind} starts again within the log")
          for kind in ("acc", "gyro") for width in (2**30, 2**30 + 5_000_077)),
    ],
)  # fmt: skip
def test_streams_that_are_no_log_are_one_line(streams, columns, error, line):
    with pytest.raises(error, match=f"^{line}"):
        raw_log(streams, columns)


@pytest.mark.parametrize(
    ("fast", "slower"),
    [*((fast, slower) for fast in (8, 6.4, 4 / 3) for slower in ("acc", "gyro")), (1.003, "acc")],
)
def test_each_sample_of_the_slower_is_held_where_it_is_nearest(fast, slower):
    at, known = 0.3 / fast + np.arange(int(200 * fast)) / fast, np.arange(200.0)
    own, other = (ACC, GYRO) if slower == "acc" else (GYRO, ACC)
    log = raw_log([stream("fast", other, at), Stream("slow", known, dict.fromkeys(own, known))])
    table = arrays(log)
    held = table["ax" if slower == "acc" else "gx"]
    np.testing.assert_array_equal(table["stamp"], at)
    near = np.isfinite(held)
    assert near[at <= known[-1]].all()
    # by brute force; the samples of the slower are numbered
    nearest = np.abs(at[near, None] - known).argmin(axis=1)
    np.testing.assert_array_equal(held[near], nearest)
    np.testing.assert_array_equal(table["held"][near], known[nearest])
    assert {*held[near]} == {*known}
    assert log.slower == {"acc": "accelerometer", "gyro": "gyroscope"}[slower]
    quantity = {"acc": "acceleration", "gyro": "angular_rate"}[slower]
    assert log.notes == [
        f"{quantity} of slow has a clock of its own: each row of fast holds its nearest sample"
    ]


def test_nothing_is_held_over_a_gap_or_beyond_the_ends():
    known = np.delete(np.arange(1, 100.0), slice(39, 49))
    at = np.arange(0, 101, 0.5)
    table, _ = two_clocks(at, known, known)
    # three quarters of a step is as far as half a gap goes
    far = np.abs(at[:, None] - known).min(axis=1) > 0.75
    np.testing.assert_array_equal(np.isnan(table["ax"]), far)
    assert far.sum() == 2 * 9 + 1 + 1 + 2


def test_rows_of_a_stream_missing_repeated_or_out_of_order_are_left_out():
    known = np.arange(100.0)
    values = 2 * known
    values[10], values[20], known[30], known[40], known[50] = np.nan, np.inf, np.nan, 39, 45
    table, log = two_clocks(np.arange(5.5, 95, 0.5), known, values)
    at, lost = table["stamp"], np.isnan(table["ax"])
    assert {*at[lost]} == {10.0, 20.0, 30.0, 40.0, 50.0}
    assert not {*table["held"][~lost]} & {10.0, 20.0, 45.5}
    assert log.notes[0].endswith("; 5 of its rows missing, repeated or out of order are left out")


@pytest.mark.parametrize("kind", ["acc", "gyro"])
def test_a_stray_stamp_of_one_stream_costs_its_row_alone(kind):
    far = 10**12 * (np.arange(8000) == 700)
    table = arrays(raw_log(clocks(kind, lambda stamps: stamps + far[: len(stamps)])))
    assert 0 < (~np.isfinite(table["ax"])).sum() <= 4


def test_whole_nanoseconds_of_two_clocks_keep_all_their_digits():
    start = 1_700_000_000_123_456_789
    at = start + 10_000_000 * np.arange(200)
    known = start - 5 + 10_000_000 * np.arange(201, dtype=np.uint64)
    table, _ = two_clocks(at, known, np.arange(201.0))
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
    assert log.found["temperature"] == "baro.temperature" and log.units == {"temperature": "K"}
    assert log.notes == ["temperature of baro interpolated linearly onto the stamps of imu"]
    assert not raw_log([stream(), thermometer], {"temperature": None}).temperature
    log = raw_log([stream(), stream("baro", ["temp"]), stream("gps", ["temp"])])
    line = "temperature not read: baro.temp, gps.temp; name one of them in columns.temperature"
    assert not log.temperature and log.notes == [line]
