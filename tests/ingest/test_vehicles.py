"""Logs of autopilots and robots, beside the round trip of each: ULog, DataFlash and ROS bags."""

import re
import shutil
import sqlite3
import struct
from fractions import Fraction
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from backports import zstd
from pyulog import ULog
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import Writer as Writer2

from imuloop.core.errors import ImuloopError, RejectedLog
from imuloop.core.samples import CHANNELS
from imuloop.ingest import ros
from imuloop.ingest import ulog as reader
from ingest import written
from ingest.written import ACCELERATION, IMU, RATE, ROS2, START, TEMPERATURE, VECTOR

pytestmark = pytest.mark.usefixtures("in_process")
SIX = [*CHANNELS]
# PX4 counts from its start; odd, so that no stamp is a whole number of anything
STAMPS = (12_345_678_901 + 10_003 * np.arange(500)).astype("u8")
WARM = np.linspace(20, 30, 500, dtype=np.float32)


@pytest.fixture
def single(log):
    """The log as autopilots keep it: single precision, whole microseconds."""
    return log.astype(np.float32).assign(t=np.arange(500) * 10_003 * 1e-6)


def of_own_interval(increments, ticks, per_s):
    """Return the float64 nearest to each increment over its interval; without one, no row."""
    return [
        [float(Fraction(x) * per_s / Fraction(dt)) for x, dt in zip(*row, strict=True)]
        for row in zip(increments.tolist(), ticks.tolist(), strict=True)
        if all(row[1])
    ]


# --- ULog

# bytes of a row of `combined`: header, number of the topic, stamp, six axes
ROW = 3 + 2 + 8 + 6 * 4


@pytest.fixture
def ulog(tmp_path):
    return partial(written.ulog, tmp_path / "log.ulg")


def combined(table, **more):
    return written.combined(STAMPS, table[SIX].to_numpy(), **more)


def sensor(table, kind, instance, **more):
    columns = ACCELERATION if kind == "accel" else RATE
    delay = 100 * len(kind)
    return written.px4_sensor(kind, instance, STAMPS, table[columns].to_numpy(), delay, **more)


def test_topics_of_px4_and_their_warmth_are_read(run, single, ulog, same):
    done = run(ulog(combined(single)))
    same(done, single)
    assert done.quality["columns"]["acceleration"][0] == "sensor_combined_0.acceleration.x"
    assert any("PX4's own calibration" in note for note in done.quality["warnings"])
    done = run(ulog(sensor(single, "accel", 2, temperature=WARM), sensor(single, "gyro", 1)))
    same(done, single)
    np.testing.assert_array_equal(done.samples.temperature, WARM)
    assert done.quality["columns"]["angular_rate"][2] == "sensor_gyro_1.angular_rate.z"
    assert done.quality["warnings"] == []
    fields = {"timestamp": STAMPS, **written.vector(single[ACCELERATION].to_numpy(), "force[{}]")}
    fields |= written.vector(single[RATE].to_numpy(), "turn_{}")
    path = ulog(("my_imu", 3, fields))
    columns = {"acceleration": [f"my_imu_3.force[{i}]" for i in range(3)]}
    columns["angular_rate"] = [f"my_imu_3.turn_{i}" for i in range(3)]
    same(run(path, columns=columns), single)
    assert "no rows of sensor_combined, sensor_accel" in run(path).quality["reasons"][0]


def test_px4s_own_numbers_of_its_sensors_are_kept(run, single, ulog):
    """The topic's device id, and its slot; of a topic without one the only calibrated sensor."""

    def ids(*topics, **parameters):
        return run(ulog(*topics, parameters=parameters)).metadata["sensor_ids"]

    number = {"device_id": np.full(500, 1310988, dtype="u4")}
    accel, gyro = sensor(single, "accel", 0, **number), sensor(single, "gyro", 0)
    found = ids(accel, gyro, CAL_ACC0_ID=7, CAL_ACC1_ID=1310988, CAL_GYRO0_ID=9, CAL_GYRO1_ID=0)
    assert found == {"accelerometer": {"id": 1310988, "slot": 1}, "gyroscope": {"id": 9, "slot": 0}}
    # which of two was logged is not known
    assert ids(combined(single), CAL_ACC0_ID=7, CAL_ACC1_ID=8, CAL_GYRO2_ID=9) == {
        "gyroscope": {"id": 9, "slot": 2}
    }
    assert ids(combined(single)) == {}


def test_an_accelerometer_read_later_than_the_gyroscope_keeps_its_time(run, single, ulog):
    relative = np.full(500, -2_500, "i4")
    done = run(ulog(combined(single, accelerometer_timestamp_relative=relative)))
    np.testing.assert_array_equal(done.samples.ay, single.ay)
    np.testing.assert_allclose(done.samples.t_accelerometer, done.samples.t - 2.5e-3, atol=1e-12)
    relative = np.where(np.isin(np.arange(500), [3, 4]), 0x7FFFFFFF, 0).astype("i4")
    done = run(ulog(combined(single, accelerometer_timestamp_relative=relative)))
    np.testing.assert_array_equal(done.samples.ay, single.ay.drop([3, 4]))
    assert done.quality["non_finite"] == 2


def test_increments_of_px4_are_of_their_own_interval(run, single, ulog):
    us = np.random.default_rng(3).integers(4000, 6000, (500, 2)).astype("u4")
    ticks = us[:, [0, 0, 0, 1, 1, 1]]
    increments = (single[SIX].to_numpy() * ticks * 1e-6).astype("f4")
    us[7, 1] = 0
    fields = {"timestamp": STAMPS + np.uint64(90), "timestamp_sample": STAMPS}
    for i, (name, part) in enumerate((("velocity", slice(0, 3)), ("angle", slice(3, 6)))):
        fields |= written.vector(increments[:, part], f"delta_{name}[{{}}]")
        fields[f"delta_{name}_dt"] = us[:, i].copy()
    done = run(ulog(("vehicle_imu", 0, fields)))
    expected = of_own_interval(increments, us[:, [0, 0, 0, 1, 1, 1]], 10**6)
    np.testing.assert_array_equal(done.samples[SIX], expected)
    assert done.quality["non_finite"] == 1
    # rates of a still sensor whose interval jitters by 20 % are as quiet as the log's
    np.testing.assert_allclose(done.samples.az, single.az.drop(7), rtol=1e-6)


def test_buffers_of_px4_are_one_row_a_sample(run, ulog):
    counts = np.random.default_rng(1).integers(-3000, 3000, (6, 500)).astype("i2")
    sizes = np.tile([2, 4, 3, 1], 50)
    ends = np.cumsum(sizes)
    times = 12_345_678_901 + 125.5 * np.arange(500)
    topics = []
    for name, rows in (("accel", counts[:3]), ("gyro", counts[3:])):
        buffers = np.zeros((3, 4, 200), "i2")
        for i, (end, size) in enumerate(zip(ends, sizes, strict=True)):
            buffers[:, :size, i] = rows[:, end - size : end]
        fields = {"timestamp": STAMPS[:200], "timestamp_sample": times[ends - 1].astype("u8")}
        fields |= {"dt": np.full(200, 125.5, "f4"), "scale": np.full(200, 0.1, "f4")}
        fields["samples"] = sizes.astype("u1")
        fields |= {f"{axis}[{k}]": buffers[a, k] for a, axis in enumerate("xyz") for k in range(4)}
        topics.append((f"sensor_{name}_fifo", 0, fields))
    done = run(ulog(*topics), units={"time": "ms"})
    np.testing.assert_array_equal(done.samples[SIX], counts.T * float(np.float32(0.1)))
    # stamps of whole microseconds, steps of 125.5
    np.testing.assert_allclose(np.diff(done.samples.t) * 1e3, 125.5, atol=1)


def test_a_ulog_cut_off_is_read_up_to_there_and_dropouts_are_named(run, single, ulog):
    path = ulog(combined(single), dropouts=[(30, STAMPS[100]), (1500, STAMPS[200])])
    assert "2 dropouts while logging, 1.53 s together" in run(path).quality["warnings"]
    path = ulog(combined(single))
    content = path.read_bytes()
    for lost in (1, ROW, 100 * ROW + 5):
        path.write_bytes(content[:-lost])
        done = run(path)
        np.testing.assert_array_equal(done.samples.az, single.az[: (500 * ROW - lost) // ROW])
        reported = "the file ends inside a message: the log was cut off" in done.quality["warnings"]
        assert reported == bool(lost % ROW)
    for size in (5, len(content) - 500 * ROW):
        path.write_bytes(content[:size])
        with pytest.raises(RejectedLog):
            reader.read({"log": path})


def test_damage_to_a_ulog_costs_its_rows(run, single, ulog):
    path = ulog(combined(single))
    content = path.read_bytes()
    # PX4 marks a place to go on from several times a second
    mark = struct.pack("<HB", len(ULog.SYNC_BYTES), ord("S")) + ULog.SYNC_BYTES
    rows = [content[at : at + ROW] for at in range(len(content) - 500 * ROW, len(content), ROW)]
    marked = (b"".join([*rows[i : i + 20], mark]) for i in range(0, 500, 20))
    content = content[: -500 * ROW] + b"".join(marked)
    half = len(content) // 2
    path.write_bytes(content[:half] + b"\x03" * 200 + content[half + 200 :])
    done = run(path)
    assert 460 <= len(done.samples) < 500 and done.quality["gaps"]["count"] == 1
    assert "parts of the file are damaged" in " ".join(done.quality["warnings"])
    # a row whose end alone is overwritten cannot be known
    assert np.isin(done.samples.az, single.az).sum() >= len(done.samples) - 1


# --- DataFlash: format and names of the fields of messages of ArduPilot

MESSAGE = "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"
OLD = "Iffffff", "TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"
ACC = "QBQfff", "TimeUS,I,SampleUS,AccX,AccY,AccZ"
GYR = "QBQfff", "TimeUS,I,SampleUS,GyrX,GyrY,GyrZ"
IMT = "QBfffffffff", "TimeUS,I,DelT,DelvT,DelaT,DelAX,DelAY,DelAZ,DelVX,DelVY,DelVZ"


def imu(table, instance=0):
    rows = zip(STAMPS, table[RATE + ACCELERATION].to_numpy(), WARM, strict=True)
    return [(t, instance, *x, 0, 0, w, 1, 1, 1000, 1000) for t, x, w in rows]


def sampled(table, columns, shift=0):
    rows = zip(STAMPS.tolist(), table[columns].to_numpy(), strict=True)
    return [(t + 5000, 0, t + shift, *x) for t, x in rows]


@pytest.fixture
def write(tmp_path):
    def call(content):
        (tmp_path / "log.bin").write_bytes(content)
        return tmp_path / "log.bin"

    return call


@pytest.fixture
def dataflash(write):
    return lambda *messages: write(written.binary(*messages))


def test_messages_of_ardupilot_are_read_and_chosen_by_instance(run, single, dataflash, same):
    done = run(dataflash(("IMU", MESSAGE, imu(single))))
    same(done, single)
    np.testing.assert_array_equal(done.samples.temperature, WARM)
    assert done.quality["columns"]["acceleration"] == [f"IMU_0.Acc{axis}" for axis in "XYZ"]
    assert done.quality["bad_lines"] == 0
    [note] = done.quality["warnings"]
    assert "after its own calibration" in note
    path = dataflash(("IMU", MESSAGE, [*imu(single + 1, 0), *imu(single, 2)]))
    with pytest.raises(ImuloopError, match=r"IMU_0 \(AccX.* and IMU_2 \(AccX.*all look like acc"):
        run(path)
    for acceleration in ("IMU_2", [f"IMU_2.Acc{axis}" for axis in "XYZ"]):
        columns = {"acceleration": acceleration, "angular_rate": "IMU_2"}
        same(run(path, columns=columns), single)
    # older logs number the message, and count ms
    ms = (STAMPS // 1000).astype(int)
    rows = [(t, *x) for t, x in zip(ms, single[RATE + ACCELERATION].to_numpy(), strict=True)]
    columns = {"acceleration": "IMU2", "angular_rate": "IMU2"}
    done = run(dataflash(("IMU", OLD, rows), ("IMU2", OLD, rows)), columns=columns)
    same(done, single.assign(t=(ms - ms[0]) * 1e-3))


def test_raw_messages_are_stamped_by_the_sample(run, single, dataflash, same):
    force = "ACC", ACC, sampled(single, ACCELERATION)
    same(run(dataflash(force, ("GYR", GYR, sampled(single, RATE)))), single)
    done = run(dataflash(force, ("GYR", GYR, sampled(single, RATE, shift=2_500))))
    np.testing.assert_array_equal(done.samples.ax, single.ax)
    np.testing.assert_allclose(done.samples.t_accelerometer, done.samples.t - 2.5e-3, atol=1e-12)
    line = "acceleration of ACC_0 has a clock of its own: each row of GYR_0 holds its nearest samp"
    assert any(text.startswith(line) for text in done.quality["warnings"])


def test_increments_of_ardupilot_are_of_their_own_interval(run, single, dataflash):
    dt = np.random.default_rng(3).uniform(0.009, 0.011, (500, 2)).astype("f4")
    dt[7] = 0
    change = single[RATE + ACCELERATION].to_numpy() * dt[:, [1, 1, 1, 0, 0, 0]]
    rows = [(t, 0, 0.01, *d, *x) for t, d, x in zip(STAMPS, dt, change, strict=True)]
    done = run(dataflash(("IMT", IMT, rows)))
    expected = of_own_interval(change, dt[:, [1, 1, 1, 0, 0, 0]], 1)
    np.testing.assert_array_equal(done.samples[RATE + ACCELERATION], expected)
    assert done.quality["non_finite"] == 1


def test_a_dataflash_log_cut_off_is_read_up_to_there(run, single, write):
    content, row = written.binary(("IMU", MESSAGE, imu(single))), written.packed(MESSAGE[0]).size
    for lost in (1, row - 1, row, 100 * row + 5):
        done = run(write(content[:-lost]))
        np.testing.assert_array_equal(done.samples.az, single.az[: (500 * row - lost) // row])
        reported = f"{-lost % row} of {len(content) - lost} bytes are no message"
        assert (reported in done.quality["warnings"]) == bool(lost % row)
    for size in (1, 89, 89 * 3 + 20):
        assert run(write(content[:size])).quality["status"] == "rejected"
    content = written.text(("IMU", MESSAGE, imu(single)))
    damaged = content.replace(b"\nIMU, 12345", b"\nIMU, x\xff12345", 3)
    for text, lost in ((content[:-5], 1), (damaged, 3)):
        done = run(write(text), format="dataflash")
        assert (len(done.samples), done.quality["bad_lines"]) == (500 - lost, lost)


def test_damage_to_a_dataflash_log_costs_its_rows(run, single, write):
    content, row = written.binary(("IMU", MESSAGE, imu(single))), written.packed(MESSAGE[0]).size
    begin = len(content) - 250 * row + 7
    noise = np.random.default_rng(2).bytes(200).replace(b"\xa3", b"\xa4")
    done = run(write(content[:begin] + noise + content[begin + 200 :]))
    lost = 1 + (7 + 200 - 1) // row
    # the row before the damage is whole: a header follows it
    rows = np.r_[0:250, 250 + lost : 500]
    np.testing.assert_array_equal(done.samples.az, single.az.to_numpy(float)[rows])
    assert f"{lost * row} of {len(content)} bytes are no message" in done.quality["warnings"]
    # a message of an unknown number ends the library's index, not the log
    at = len(content) - 100 * row + 2
    done = run(write(content[:at] + b"\x11" + content[at + 1 :]))
    assert len(done.samples) == 499
    # an instance that is there once is no second sensor
    done = run(write(content[: at + 9] + b"\x4d" + content[at + 10 :]))
    assert len(done.samples) == 499 and done.quality["bad_lines"] == 1


@pytest.mark.parametrize("noise", [b"", bytes(5000), b"\xa3\x95" * 3000, b"FMT, 1\n" * 9])
def test_what_is_no_dataflash_log_is_rejected(run, write, dataflash, noise):
    done = run(dataflash(("MINE", ACC, [])))
    assert done.quality["reasons"] == ["the log holds no rows of IMU, ACC, GYR or IMT"]
    [reason] = run(write(noise)).quality["reasons"]
    assert "\n" not in reason


def test_a_message_that_is_defined_twice_with_other_fields_rejects_the_log(run, single, write):
    codes, names = MESSAGE
    other = codes, names.replace("Gyr", "?").replace("Acc", "Gyr").replace("?", "Acc")
    rows = imu(single)
    halves = ("IMU", MESSAGE, rows[:250]), ("IMU", other, rows[250:])
    line = "IMU is defined twice, with other fields: the log is of two kinds"
    for content in (written.binary(*halves), b"".join(map(written.text, halves))):
        assert run(write(content)).quality["reasons"] == [line]


# --- ROS


@pytest.fixture
def stamps(log):
    return START + np.rint(log.t.to_numpy() * 1e9).astype(np.int64) + np.arange(len(log)) % 7


@pytest.fixture
def timed(log, stamps):
    return log.assign(t=(stamps - stamps[0]) * 1e-9)


@pytest.fixture
def bag(tmp_path):
    return partial(written.bag, tmp_path)


@pytest.fixture
def topic(log, stamps):
    return {"/imu/data": (IMU, stamps, log[SIX].to_numpy())}


@pytest.mark.parametrize("kind", ["db3", "mcap"])
def test_a_bare_storage_file_of_any_name_is_read(timed, topic, run, bag, tmp_path, same, kind):
    (inner,) = bag(kind, topic).glob(f"*.{kind}")
    done = run(shutil.copy(inner, tmp_path / f"run #3 100% a?b.{kind}"))
    same(done, timed)
    assert done.quality["columns"]["time"] == "/imu/data stamps"
    packed = tmp_path / f"log.{kind}.zst"
    packed.write_bytes(zstd.compress(inner.read_bytes()))
    same(run(packed), timed)


def test_bags_that_are_older_than_definitions_are_read(timed, topic, run, bag, same):
    # as ROS 2 wrote SQLite until Humble
    path = bag("db3", topic) / "log.db3"
    with sqlite3.connect(path) as base:
        base.executescript(
            "DROP TABLE schema; DROP TABLE metadata; DROP TABLE message_definitions;"
            "ALTER TABLE topics DROP COLUMN type_description_hash;"
        )
    base.close()
    same(run(path), timed)


def test_a_recording_in_several_files_is_one_log(timed, topic, run, bag, tmp_path, same):
    folder = tmp_path / "split"
    folder.mkdir()
    kind, times, rows = topic["/imu/data"]
    for part, name in (((0, 200), "log_2"), ((200, 400), "log_10"), ((400, 500), "log_11")):
        piece = bag(
            "mcap", {"/imu/data": (kind, times[slice(*part)], rows[slice(*part)])}, name=name
        )
        shutil.copy(piece / f"{name}.mcap", folder)
    done = run(folder)
    same(done, timed)
    assert "the folder has no metadata.yaml" in done.quality["warnings"][0]


@pytest.mark.parametrize("damage", ["empty", "gone", "no words"])
def test_a_folder_that_is_no_whole_bag_is_rejected(topic, bag, damage, tmp_path):
    path, line = bag("mcap", topic), r"^log is not a whole bag \(ReaderError: "
    if damage == "gone":
        (path / "log.mcap").unlink()
    elif damage == "no words":
        (path / "metadata.yaml").write_text("a: b")
    else:
        path, line = tmp_path, "the folder holds no bag"
    with pytest.raises(RejectedLog, match=line):
        ros.read({"log": path})


def test_topics_of_one_sensor_each_are_declared_by_name(log, timed, stamps, run, bag, same):
    table = log[SIX].to_numpy()
    topics = {
        "/acc": (VECTOR, stamps, table[:, :3]),
        "/rate": ("geometry_msgs/msg/TwistStamped", stamps, table),
        "/both": ("geometry_msgs/msg/AccelStamped", stamps, table),
        "/temp": (TEMPERATURE, stamps, 20 + log[["t"]].to_numpy()),
    }
    path = bag("db3", topics)
    rate = [f"/rate.twist.angular.{axis}" for axis in "xyz"]
    three = [f"/both.accel.linear.{axis}" for axis in "xyz"]
    for acceleration in ("/acc", three):
        done = run(path, columns={"acceleration": acceleration, "angular_rate": rate})
        same(done, timed)
        np.testing.assert_array_equal(done.samples.temperature, 20 + log.t)
    with pytest.raises(ImuloopError, match=r"no stream '/accel'.*did you mean '/acc'"):
        run(path, columns={"acceleration": "/accel"})


def test_fields_that_are_all_zero_were_not_measured(log, timed, stamps, run, bag, same):
    table, none = log[SIX].to_numpy(), np.zeros((len(log), 3))
    topics = {
        "/accel": (IMU, stamps, np.hstack([table[:, :3], none])),
        "/gyro": (IMU, stamps, np.hstack([none, table[:, 3:]])),
    }
    done = run(bag("bag lz4", topics))
    same(done, timed)
    assert sorted(done.quality["warnings"]) == [
        f"{topic}: {', '.join(f'{name}.{axis}' for axis in 'xyz')} are all zero, so not measured"
        for topic, name in (("/accel", "angular_velocity"), ("/gyro", "linear_acceleration"))
    ]


def test_times_of_receipt_are_used_where_headers_have_none(log, topic, run, bag, same):
    kind, _, rows = topic["/imu/data"]
    done = run(bag("mcap", {"/imu/data": (kind, np.zeros(len(log)), rows)}))
    same(done, log)
    note = "/imu/data: its header stamps never change; times of receipt are used"
    assert note in done.quality["warnings"]


def test_other_types_are_passed_over_and_no_definition_of_the_bag_is_run(run, tmp_path):
    path = tmp_path / "log.bag"
    with Writer1(path) as writer:
        text = "this is (no definition"
        other = writer.add_connection("/a", "x/msg/Y", msgdef=text, md5sum="0" * 32)
        writer.write(other, START, b"\x01")
        false = writer.add_connection("/b", IMU, msgdef="float64 x\n", md5sum="1" * 32)
        writer.write(false, START, b"\x01" * 8)
    assert run(path).quality["reasons"] == [f"/b: its {IMU} is not the one that ROS defines"]


def test_a_damaged_message_is_left_out_and_counted(timed, stamps, run, tmp_path, same):
    with Writer2(tmp_path / "log", version=9) as writer:
        connection = writer.add_connection("/imu", IMU, typestore=ROS2)
        for i, (stamp, row) in enumerate(zip(stamps, timed[SIX].to_numpy(), strict=True)):
            data = ROS2.serialize_cdr(written.message(ROS2, IMU, stamp, row), IMU)
            writer.write(connection, START + i, b"\x00" if i in (0, 7) else data)
    done = run(tmp_path / "log")
    same(done, timed.drop([0, 7]))
    assert "/imu: 2 messages are damaged and left out" in done.quality["warnings"]


def test_a_topic_lost_to_damage_is_a_fault_of_the_data(topic, run, bag):
    path = bag("db3", topic) / "log.db3"
    declared = {"angular_rate": "/gyro"}
    with pytest.raises(ImuloopError, match="no stream '/gyro'"):
        run(path, columns=declared)
    Path(f"{path}-wal").write_bytes(b"x")
    [reason] = run(path, columns=declared).quality["reasons"]
    assert "no stream '/gyro'" in reason and "it may be lost to damage: log.db3-wal" in reason


@pytest.mark.parametrize(
    ("kind", "tool"),
    [("bag", "rosbag reindex"), ("db3", "sqlite3 with .recover"), ("mcap", "mcap recover")],
)
def test_a_bag_cut_off_is_rejected_with_what_mends_it(topic, run, bag, kind, tool):
    path = bag(kind, topic)
    path = path if kind == "bag" else path / f"log.{kind}"
    whole = path.read_bytes()
    for share in (0.0, 0.0001, 0.3, 0.99):
        path.write_bytes(whole[: int(share * len(whole))])
        [reason] = run(path).quality["reasons"]
        mended = f"; copy it again, or if its recording was cut off, mend it with {tool}"
        assert re.fullmatch(rf"log.{kind} is (neither .*|not a whole bag \(.*\){mended})", reason)
