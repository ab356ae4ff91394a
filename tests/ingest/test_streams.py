"""Several tables or streams in a log: which hold the sensors, and how they come onto one clock."""

from functools import partial

import numpy as np
import pytest

from imuloop.core.errors import ImuloopError, RejectedLog
from imuloop.core.samples import ACCELERATION, ANGULAR_RATE
from imuloop.core.units import STANDARD_GRAVITY
from imuloop.ingest.streams import Stream, raw_log
from ingest.logs import FORCE, RATE, brief
from ingest.test_formats import zipped
from ingest.text_forms import SIX, text
from ingest.written import phyphox, sensor_logger, timed
from ingest.written import table as csv_table

RNG = np.random.default_rng(3)
ROWS = 300
ACC = [f"acc.{axis}" for axis in "xyz"]
GYRO = [f"gyro.{axis}" for axis in "xyz"]


def stream(name="imu", fields=(*ACC, *GYRO), stamps=None, **units):
    stamps = np.arange(ROWS) / 100 if stamps is None else stamps
    return Stream(name, stamps, {key: RNG.normal(size=len(stamps)) for key in fields}, units)


def arrays(log):
    return {name: log.batch[name].to_numpy() for name in log.batch.schema.names}


def two_clocks(at, known, values):
    """Return the table of a gyroscope with stamps `at`, and an accelerometer with `known`."""
    log = raw_log([Stream("acc", known, dict.fromkeys(ACC, values)), stream("gyro", GYRO, at)])
    return arrays(log), log


def two_that_start_again(kind):
    """Return an accelerometer at 100 Hz and a gyroscope at 200 Hz; the clock of one rolls over."""
    streams = []
    for name, fields, step in (("acc", ACC, 10_000), ("gyro", GYRO, 5_000)):
        stamps = 2**30 - 20_000_000 + step * np.arange(40_000_000 // step)
        stamps = stamps % 2**30 if name == kind else stamps
        streams.append(Stream(name, stamps, dict.fromkeys(fields, stamps * 1e-6), {"time": "us"}))
    return streams


# --- which streams

NO_ROWS = np.empty(0)
TWO = [stream(), stream("two", ["lx", "ly", "lz", "rx", "ry", "rz"])]
FROM_IMU = {"acceleration": [f"imu.{a}" for a in ACC], "angular_rate": [f"imu.{g}" for g in GYRO]}
EMPTY = Stream("imu0", np.arange(ROWS) / 100, dict.fromkeys((*ACC, *GYRO), np.zeros(ROWS)))
CHOSEN = [
    # a stream of both sensors goes before streams of one
    ([stream("acc", ACC), stream(), stream("gyro", GYRO)], {}, FROM_IMU),
    # one without rows, or with zeros alone, does not compete with one that measures
    ([stream("imu0", stamps=NO_ROWS), stream()], {}, FROM_IMU),
    ([EMPTY, stream()], {}, FROM_IMU),
    # of clocks as fast the gyroscope's is taken
    ([stream("acc", ACC, np.arange(ROWS) * 0.01 + 0.004), stream("gyro", GYRO)], {},
     {"time": "gyro stamps"}),
    ([stream(), stream("baro", ["temp"]), stream("gps", ["temp"])],
     {"temperature": "gps.temp"}, {"temperature": "gps.temp"}),
]  # fmt: skip


@pytest.mark.parametrize(("streams", "columns", "expected"), CHOSEN)
def test_the_streams_of_the_sensors_are_chosen(streams, columns, expected):
    found = raw_log(streams, columns).found
    assert {name: found[name] for name in expected} == expected


REFUSED = [
    (TWO, {"interval": "dt"}, ImuloopError, "columns.interval: only tables have one"),
    (TWO, {"time": "imu.clock"}, ImuloopError, "columns.time: only tables have one"),
    (TWO, {"acceleration": "imo"}, ImuloopError,
     "columns.acceleration: no stream 'imo'; there are imu, two; did you mean 'imu'"),
    (TWO, {"acceleration": "two"}, ImuloopError, "no columns of acceleration found .two stamps, "),
    (TWO, {"acceleration": ["imu.acc.x", "imu.acc.y", "imu.acc.w"]}, ImuloopError,
     "columns.acceleration: no column 'acc.w'; there are .*; did you mean"),
    (TWO, {"acceleration": ["imu.acc.x", "imu.acc.y", "two.lx"]}, ImuloopError,
     "columns.acceleration: no stream 'imu.acc.x, imu.acc.y, two.lx'; there are imu, two"),
    (TWO, dict.fromkeys(("acceleration", "angular_rate")), ImuloopError, "no sensor: columns.acc"),
    ([stream(stamps=NO_ROWS)], {}, RejectedLog, "the log has no rows$"),
    ([stream("acc", ACC), stream("gyro", GYRO, NO_ROWS)], {}, RejectedLog, "gyro has no rows$"),
    *(([stream("acc", ACC), stream("gyro", GYRO, known)], {}, RejectedLog,
       "(gyro and acc|acc and gyro) share no time: their clocks differ$")
      for known in (np.arange(ROWS) + 1e9, np.geomspace(1e290, 1e308, ROWS))),
    *((two_that_start_again(kind), {}, RejectedLog,
       f"the clock of {kind} starts again within the log") for kind in ("acc", "gyro")),
]  # fmt: skip


@pytest.mark.parametrize(("streams", "columns", "error", "line"), REFUSED)
def test_streams_that_are_no_log_are_one_line(streams, columns, error, line):
    with pytest.raises(error, match=f"^{line}") as caught:
        raw_log(streams, columns)
    assert "\n" not in str(caught.value)


# --- onto one clock


@pytest.mark.parametrize(("fast", "slower"), [(8, "acc"), (6.4, "gyro"), (1.003, "acc")])
def test_each_sample_of_the_slower_is_held_where_it_is_nearest(fast, slower):
    """And nowhere over a gap: three quarters of a step is as far as half a gap goes."""
    known = np.delete(np.arange(200.0), slice(39, 49))
    at = 0.3 / fast + np.arange(int(200 * fast)) / fast
    own, other = (ACC, GYRO) if slower == "acc" else (GYRO, ACC)
    log = raw_log([stream("fast", other, at), Stream("slow", known, dict.fromkeys(own, known))])
    table, far = arrays(log), np.abs(at[:, None] - known).min(axis=1) > 0.75
    held = table["ax" if slower == "acc" else "gx"]
    np.testing.assert_array_equal(table["stamp"], at)
    np.testing.assert_array_equal(np.isnan(held), far)
    # by brute force; the samples of the slower are numbered
    nearest = known[np.abs(at[~far, None] - known).argmin(axis=1)]
    np.testing.assert_array_equal(held[~far], nearest)
    np.testing.assert_array_equal(table["held"][~far], nearest)
    assert {*nearest} == {*known}
    quantity = {"acc": "acceleration", "gyro": "angular_rate"}[slower]
    assert log.slower == {"acc": "accelerometer", "gyro": "gyroscope"}[slower]
    line = "of slow has a clock of its own: each row of fast holds its nearest sample"
    assert log.notes == [f"{quantity} {line}"]


def test_rows_of_a_stream_missing_repeated_or_out_of_order_are_left_out():
    known = np.arange(100.0)
    values = 2 * known
    values[10], values[20], known[30], known[40], known[50] = np.nan, np.inf, np.nan, 39, 45
    table, log = two_clocks(np.arange(5.5, 95, 0.5), known, values)
    at, lost = table["stamp"], np.isnan(table["ax"])
    assert {*at[lost]} == {10.0, 20.0, 30.0, 40.0, 50.0}
    assert not {*table["held"][~lost]} & {10.0, 20.0, 45.5}
    assert log.notes[0].endswith("; 4 of its rows missing, repeated or out of order are left out")
    # and the one without a stamp
    assert log.bad_lines == 1


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


def apart(log):
    """Return tables of an accelerometer at 100 Hz and of a gyroscope that is 1.5 ms later."""
    force, rate = (log[["t", *c]].set_axis([*"txyz"], axis=1) for c in (FORCE, RATE))
    return force, rate.assign(t=log.t + 0.0015)


def pair(folder, log, form):
    """Write a file of each sensor, and return their paths."""
    paths = [folder / f"{name}.{form}" for name in "ab"]
    for path, table, unit in zip(paths, apart(log), ("m/s²", "rad/s"), strict=True):
        if form == "parquet":
            table.to_parquet(path)
        elif form == "txt":
            path.write_text(text(table, header=False, sep=" "))
        else:
            # one file in s, with names that are declared; the other in ms
            ms = {"t": "t (ms)"} if unit == "rad/s" else {}
            table = table.assign(t=table.t * 1000 if ms else table.t, u=1.0, v=2.0, w=3.0)
            path.write_text(text(table.rename(columns=ms)))
    return paths


def in_zip(folder, log, count):
    tables = {"rec/imu.csv": log}
    if count == 2:
        tables = dict(zip(("rec/Accel.txt", "rec/gyro.txt"), apart(log), strict=True))
    members = {
        name: "# made by a logger\n" + text(each, header=count == 1, sep=" ,"[count == 1])
        for name, each in tables.items()
    }
    return [zipped(folder, members | {"rec/notes.md": "at noon"})]


XYZ = {"columns": {"acceleration": [*"xyz"], "angular_rate": [*"xyz"]}}
# how both are written, the declaration, the unit of time and its column
APART = {
    "two files, parquet": (partial(pair, form="parquet"), {}, "s", "t"),
    "two files, headless": (partial(pair, form="txt"), {}, "s", "0"),
    "two files, two units": (partial(pair, form="csv"), XYZ, "ns",
                             {"acceleration": "t", "angular_rate": "t (ms)"}),
    "one table in a zip": (partial(in_zip, count=1), {}, "s", "t"),
    "two tables in a zip": (partial(in_zip, count=2), {}, "s", "0"),
}  # fmt: skip


@pytest.mark.parametrize("name", APART)
def test_sensors_apart_are_one_log(log, run, tmp_path, name):
    write, declared, unit, time = APART[name]
    done = run(*write(tmp_path, log), **declared)
    assert done.quality["status"] == "ok", done.quality["reasons"]
    assert 480 <= len(done.samples) <= len(log) and 4.9 < done.quality["duration_s"] < 5
    # the sensor whose clock is the log's keeps its values
    assert max(np.isin(done.samples[c], log[c]).mean() for c in ("ax", "gx")) == 1
    assert (done.metadata["units"]["time"], done.quality["columns"]["time"]) == (unit, time)


# --- phones

RAW = ("Acceleration", "Gyroscope")


def in_one_table(log):
    header = ["Time (s)", *(f"Acceleration {a} (m/s^2)" for a in "xyz"), "Absolute (m/s^2)"]
    header += [f"Gyroscope {a} (rad/s)" for a in "xyz"]
    columns = [log.t, *(log[a] for a in FORCE), log.az, *(log[a] for a in RATE)]
    return {"run/Raw Data.csv": csv_table(header, columns), "__MACOSX/run/._a.csv": "\0"}


def with_linear(log, alone=False):
    members, linear = phyphox(log), phyphox(log * 0.1, ("Linear Acceleration", ""))
    if alone:
        return members | {"Accelerometer.csv": linear["Accelerometer.csv"]}
    return {"Linear Acceleration.csv": linear["Accelerometer.csv"], **members}


def with_second(log):
    members = phyphox(log)
    return members | {"Second.csv": members["Gyroscope.csv"]}


def corrected(log, about=("android", "false"), scale=1.0, **named):
    """Sensor Logger, with values that the phone has corrected and uncalibrated ones."""
    wrong = log.assign(bx=log.ax + 1, by=log.ay + 1, bz=log.az + 1, hx=0.5, hy=0.5, hz=0.5)
    wrong[FORCE] = np.round(wrong[FORCE] * scale, 6)
    usual = {"Accelerometer": ["hx", "hy", "hz"], "TotalAcceleration": ["bx", "by", "bz"]}
    usual |= {"AccelerometerUncalibrated": FORCE, "Gyroscope": ["hx", "hy", "hz"]}
    usual |= {"GyroscopeUncalibrated": RATE}
    return sensor_logger(wrong, {k: x for k, x in (usual | named).items() if x}, about)


ONLY = {"AccelerometerUncalibrated": None, "GyroscopeUncalibrated": None, "Gyroscope": RATE}
TOTAL = {**ONLY, "TotalAcceleration": FORCE}
IOS, G = "iOS logs the opposite of specific force: its sign is turned", -1 / STANDARD_GRAVITY
# members of the zip, the declaration, and a line
PHONES = {
    **{f"phyphox {separator!r}": (
           lambda log, s=separator: phyphox(log, ("", ""), *s), {}, "the tables Accelerometer and")
       for separator in (",.", "\t.", ";,")},
    "phyphox in one table": (in_one_table, {}, "the table Raw Data of the zip"),
    "with linear acceleration": (with_linear, {}, "Accelerometer and Gyroscope"),
    "the second": (with_second, {"columns": {"angular_rate": "Second"}}, "Accelerometer and Sec"),
    "Sensor Logger": (corrected, {}, "the tables AccelerometerUncalibrated and GyroscopeUncalib"),
    "Sensor Logger, total": (lambda log: corrected(log, **TOTAL), {}, "TotalAcceleration and Gyro"),
    "standard iOS": (lambda log: corrected(log, ("ios", "true")), {}, "the tables Acc"),
    "unknown": (lambda log: corrected(log, None), {}, "no Metadata.csv: taken as SI"),
    "iOS, columns": (
        lambda log: corrected(log, ("ios", "false"), G),
        {"columns": {"acceleration": [f"AccelerometerUncalibrated.{a}" for a in "xyz"]}}, IOS),
}  # fmt: skip


@pytest.mark.parametrize("name", PHONES)
def test_a_zip_of_a_phone_is_read(log, run, tmp_path, same, name):
    members, declared, said = PHONES[name]
    done = run(zipped(tmp_path, members(log)), **declared)
    turned = name.startswith("iOS")
    if turned:
        log[FORCE] = -np.round(log[FORCE] * G, 6) * STANDARD_GRAVITY
    same(done, log)
    assert any(said in line for line in done.quality["warnings"])
    assert (IOS in done.quality["warnings"]) == turned
    assert done.metadata["units"]["acceleration"] == ("g" if turned else "m/s^2")


NO_PHONES = [
    (lambda log: with_linear(log, alone=True), {}, "no acceleration found; the log holds Accel"),
    (with_second, {}, "Gyroscope and Second all look like angular_rate; name one of them"),
    (with_second, {"columns": {"angular_rate": "Secnod"}}, "no stream 'Secnod'.*did you mean 'Sec"),
    (lambda log: dict.fromkeys(("a.csv", "b.csv"), log.to_csv(index=False)), {},
     "a and b all look like acceleration"),
]  # fmt: skip


@pytest.mark.parametrize(("members", "declared", "line"), NO_PHONES)
def test_a_zip_without_a_choice_is_one_line(log, refused, tmp_path, members, declared, line):
    refused(line, zipped(tmp_path, members(log)), **declared)


@pytest.mark.parametrize(("separator", "decimal"), [",.", ";,"])
def test_a_pause_of_phyphox_is_a_gap(log, run, tmp_path, separator, decimal):
    members = phyphox(log, RAW, separator, decimal)
    # the phone's clock is set back by a minute, then the experiment pauses for 30 s and 7 s
    starts = [(0, 1.7e9), (1.005, 1.7e9 - 59), (2.005, 1.7e9 + 32.005), (3.005, 1.7e9 + 40.005)]
    members["meta/time.csv"] = timed(separator, decimal, *starts)
    done = run(zipped(tmp_path, members))
    later = np.select([log.t > 3.005, log.t > 2.005], [37, 30], 0)
    np.testing.assert_allclose(done.samples.t, log.t + later, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(done.samples.t[:200], log.t[:200])
    assert done.quality["gaps"]["count"] == 2
    lines = [x for x in done.quality["warnings"] if x.startswith("paused 2 times, 37 s together")]
    assert len(lines) == 1


def test_damage_to_an_export_is_counted_or_named(log, run, refused, tmp_path):
    members = phyphox(log)
    rows = members["Accelerometer.csv"].splitlines()
    rows[3], rows[5], rows[7] = "what", "x,1,2,3", "0.06,1,NaN,3"
    members["Accelerometer.csv"] = "\n".join(rows)
    path = zipped(tmp_path, members)
    done = run(path)
    # no sample of the accelerometer is near three rows
    assert (done.quality["bad_lines"], done.quality["non_finite"]) == (2, 3)
    np.testing.assert_array_equal(done.samples.gx, log.gx.drop([2, 4, 6]))
    data = bytearray(path.read_bytes())
    # of the first entry of the directory, the flag of encryption
    data[data.index(b"PK\1\2") + 8] = 1
    path.write_bytes(data)
    refused("format phone .RuntimeError: .*encrypted", path, error=False)
