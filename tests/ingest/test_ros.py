"""Logs of robots, beside the round trip: ROS bags."""

import re
import shutil
import sqlite3
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from backports import zstd
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import Writer as Writer2

from imuloop.core.errors import ImuloopError, RejectedLog
from imuloop.core.samples import CHANNELS
from imuloop.ingest import ros
from ingest import written
from ingest.written import IMU, ROS2, START, TEMPERATURE, VECTOR

SIX = [*CHANNELS]


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
