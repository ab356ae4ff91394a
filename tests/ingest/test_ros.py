"""ROS 1 bags, ROS 2 bags and MCAP files."""

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
from imuloop.ingest import ros
from ingest.tables import same
from ingest.written import IMU, ROS2, START, TEMPERATURE, VECTOR, bag, message

pytestmark = pytest.mark.usefixtures("in_process")

KINDS = ["bag", "bag bz2", "bag lz4", "db3", "db3 message", "db3 file", "mcap", "mcap storage"]
BOTH = ["acceleration", "angular_rate"]


@pytest.fixture
def stamps(log):
    return START + np.rint(log.t.to_numpy() * 1e9).astype(np.int64) + np.arange(len(log)) % 7


@pytest.fixture
def write(tmp_path):
    return partial(bag, tmp_path)


@pytest.fixture
def imu(log, stamps):
    return {"/imu/data": (IMU, stamps, log.to_numpy()[:, 1:])}


def reasons(done):
    assert done.quality["status"] == "rejected"
    return done.quality["reasons"]


def is_log(done, log, stamps):
    assert same(done.samples, log.assign(t=(stamps - stamps[0]) * 1e-9))


@pytest.mark.parametrize("kind", ["bag", "db3", "mcap"])
def test_an_imu_topic_comes_back_exactly(log, stamps, imu, run, write, kind):
    path = write(kind, imu)
    done = run(path)
    is_log(done, log, stamps)
    assert done.metadata["start"] == "2023-11-14T22:13:20Z"
    assert done.metadata["units"] == {
        "time": "ns",
        "acceleration": "m/s^2",
        "angular_rate": "rad/s",
    }
    assert done.quality["columns"]["time"] == "/imu/data stamps"
    assert done.path.read_bytes() == run(path, batch_rows=9).path.read_bytes()


@pytest.mark.parametrize("kind", KINDS)
def test_every_bit(hard, hard_stamps, every_bit, write, kind):
    every_bit(write(kind, {"/imu": (IMU, hard_stamps, hard)}), hard, hard_stamps)


@pytest.mark.parametrize("kind", ["db3", "mcap"])
def test_a_bare_storage_file_of_any_name(log, stamps, imu, run, write, tmp_path, kind):
    (inner,) = write(kind, imu).glob(f"*.{kind}")
    path = shutil.copy(inner, tmp_path / f"run #3 100% a?b.{kind}")
    is_log(run(path), log, stamps)
    packed = tmp_path / f"log.{kind}.zst"
    packed.write_bytes(zstd.compress(inner.read_bytes()))
    is_log(run(packed), log, stamps)


def test_bags_that_are_older_than_definitions(log, stamps, imu, run, write):
    # as ROS 2 wrote SQLite until Humble
    path = write("db3", imu) / "log.db3"
    with sqlite3.connect(path) as base:
        base.executescript(
            "DROP TABLE schema; DROP TABLE metadata; DROP TABLE message_definitions;"
            "ALTER TABLE topics DROP COLUMN type_description_hash;"
        )
    base.close()
    is_log(run(path), log, stamps)


def test_a_recording_in_several_files(log, stamps, imu, run, write, tmp_path):
    folder = tmp_path / "split"
    folder.mkdir()
    pieces = [slice(0, 200), slice(200, 400), slice(400, 500)]
    names = ["log_2.mcap", "log_10.mcap", "log_11.mcap"]
    for part, name in zip(pieces, names, strict=True):
        type_, times, rows = imu["/imu/data"]
        piece = write("mcap", {"/imu/data": (type_, times[part], rows[part])}, name=name[:-5])
        shutil.copy(piece / name, folder / name)
    done = run(folder)
    is_log(done, log, stamps)
    assert "the folder has no metadata.yaml" in done.quality["warnings"][0]


@pytest.mark.parametrize("damage", ["gone", "no words"])
def test_a_folder_whose_metadata_do_not_fit(imu, write, damage, tmp_path):
    with pytest.raises(RejectedLog, match="the folder holds no bag"):
        ros.read({"log": tmp_path})
    path = write("mcap", imu)
    if damage == "gone":
        (path / "log.mcap").unlink()
    else:
        (path / "metadata.yaml").write_text("a: b")
    with pytest.raises(RejectedLog, match=r"^log is not a whole bag \(ReaderError: "):
        ros.read({"log": path})


def test_topics_of_one_sensor_each(log, stamps, run, write):
    table = log.to_numpy()
    topics = {
        "/acc": (VECTOR, stamps, table[:, 1:4]),
        "/rate": ("geometry_msgs/msg/TwistStamped", stamps, table[:, 1:]),
        "/both": ("geometry_msgs/msg/AccelStamped", stamps, table[:, 1:]),
        "/temp": (TEMPERATURE, stamps, 20 + table[:, :1]),
    }
    path = write("db3", topics)
    rate = [f"/rate.twist.angular.{axis}" for axis in "xyz"]
    done = run(path, columns={"acceleration": "/acc", "angular_rate": rate})
    is_log(done, log, stamps)
    np.testing.assert_array_equal(done.samples.temperature, 20 + log.t)
    three = [f"/both.accel.linear.{axis}" for axis in "xyz"]
    is_log(run(path, columns={"acceleration": three, "angular_rate": rate}), log, stamps)
    with pytest.raises(ImuloopError, match=r"no stream '/accel'.*did you mean '/acc'"):
        run(path, columns={"acceleration": "/accel"})


def test_two_chips_in_a_message_each(log, stamps, run, write):
    table = log.to_numpy()[:, 1:]
    none = np.zeros((len(log), 3))
    topics = {
        "/accel": (IMU, stamps, np.hstack([table[:, :3], none])),
        "/gyro": (IMU, stamps, np.hstack([none, table[:, 3:]])),
    }
    done = run(write("bag lz4", topics))
    is_log(done, log, stamps)
    assert sorted(done.quality["warnings"]) == [
        "/accel: angular_velocity.x, angular_velocity.y, angular_velocity.z are all zero, "
        "so not measured",
        "/gyro: linear_acceleration.x, linear_acceleration.y, linear_acceleration.z are all zero, "
        "so not measured",
    ]


def test_times_of_receipt_where_headers_have_none(log, stamps, imu, run, write):
    type_, _, rows = imu["/imu/data"]
    done = run(write("mcap", {"/imu/data": (type_, np.zeros(len(log)), rows)}))
    is_log(done, log, START + 10**7 * np.arange(len(log)))
    note = "/imu/data: its header stamps never change; times of receipt are used"
    assert note in done.quality["warnings"]


def test_other_types_are_passed_over_and_no_definition_of_the_bag_is_run(log, run, tmp_path):
    path = tmp_path / "log.bag"
    with Writer1(path) as writer:
        other = writer.add_connection(
            "/a", "x/msg/Y", msgdef="this is (no definition", md5sum="0" * 32
        )
        writer.write(other, START, b"\x01")
        false = writer.add_connection("/b", IMU, msgdef="float64 x\n", md5sum="1" * 32)
        writer.write(false, START, b"\x01" * 8)
    assert reasons(run(path)) == [f"/b: its {IMU} is not the one that ROS defines"]


def test_a_damaged_message_is_left_out_and_counted(log, stamps, run, tmp_path):
    path = tmp_path / "log"
    with Writer2(path, version=9) as writer:
        connection = writer.add_connection("/imu", IMU, typestore=ROS2)
        for i, (stamp, row) in enumerate(zip(stamps, log.to_numpy()[:, 1:], strict=True)):
            data = ROS2.serialize_cdr(message(ROS2, IMU, stamp, row), IMU)
            writer.write(connection, START + i, b"\x00" if i in (0, 7) else data)
    done = run(path)
    kept = ~np.isin(np.arange(len(log)), [0, 7])
    is_log(done, log[kept], stamps[kept])
    assert "/imu: 2 messages are damaged and left out" in done.quality["warnings"]


def test_a_topic_lost_to_damage_is_a_fault_of_the_data(imu, run, write):
    path = write("db3", imu) / "log.db3"
    declared = {"angular_rate": "/gyro"}
    with pytest.raises(ImuloopError, match="no stream '/gyro'"):
        run(path, columns=declared)
    Path(f"{path}-wal").write_bytes(b"x")
    (reason,) = reasons(run(path, columns=declared))
    assert "no stream '/gyro'" in reason and "it may be lost to damage: log.db3-wal" in reason


@pytest.mark.parametrize(
    ("kind", "tool"),
    [("bag", "rosbag reindex"), ("db3", "sqlite3 with .recover"), ("mcap", "mcap recover")],
)
def test_a_file_cut_off_is_rejected_with_what_mends_it(imu, run, write, kind, tool):
    path = write(kind, imu)
    path = path if kind == "bag" else path / f"log.{kind}"
    whole = path.read_bytes()
    for share in (0.0, 0.0001, 0.3, 0.99):
        path.write_bytes(whole[: int(share * len(whole))])
        (reason,) = reasons(run(path))
        mended = f"; copy it again, or if its recording was cut off, mend it with {tool}"
        assert re.fullmatch(rf"log.{kind} is (neither .*|not a whole bag \(.*\){mended})", reason)
