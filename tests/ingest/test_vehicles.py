"""Logs of robots and autopilots, further to the round trip: ROS, ULog, DataFlash."""

import re
import shutil
import struct
from functools import partial

import numpy as np
import pytest
from pyulog import ULog
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import Writer as Writer2

from imuloop.core.samples import CHANNELS
from ingest import written
from ingest.written import ACCELERATION, IMU, RATE, ROS2, START, TEMPERATURE, VECTOR

SIX = [*CHANNELS]
# autopilots count us from their start; odd, so that no stamp is a whole number of anything
STAMPS = (12_345_678_901 + 10_003 * np.arange(500)).astype("u8")
WARM = np.linspace(20, 30, 500, dtype=np.float32)

# --- ROS

NS = START + 10_000_000 * np.arange(500) + np.arange(500) % 7
TWIST, ACCEL = (f"geometry_msgs/msg/{kind}Stamped" for kind in ("Twist", "Accel"))


def bag(folder, log, kind="db3", imu=True, rows=slice(None), name="log", **topics):
    values = log[SIX].to_numpy()[rows]
    every = {"/imu": (IMU, NS[rows], values)} if imu else {}
    every |= {f"/{key}": (of, NS, take(values)) for key, (of, take) in topics.items()}
    return written.bag(folder, kind, every, name=name)


def renamed(folder, log):
    """A storage file alone, with a name that no address can have."""
    return shutil.copy(bag(folder, log) / "log.db3", folder / "run #3 100% a?b.db3")


def unwritten(folder, log, alone=False):
    """A recording that crashed: SQLite has not yet put all into its file."""
    path = bag(folder, log)
    (path / "log.db3-wal").write_bytes(b"x")
    return path / "log.db3" if alone else path


def in_parts(folder, log):
    """A recording in several files, without metadata."""
    (folder / "split").mkdir()
    for part, name in (((0, 200), "log_2"), ((200, 400), "log_10"), ((400, 500), "log_11")):
        piece = bag(folder, log, "mcap", rows=slice(*part), name=name)
        shutil.copy(piece / f"{name}.mcap", folder / "split")
    return folder / "split"


def of_two_chips(folder, log):
    force = IMU, lambda x: np.hstack([x[:, :3], np.zeros((500, 3))])
    rate = IMU, lambda x: np.hstack([np.zeros((500, 3)), x[:, 3:]])
    return bag(folder, log, "bag lz4", imu=False, accel=force, gyro=rate)


def unstamped(folder, log):
    topics = {"/imu": (IMU, np.zeros(500), log[SIX].to_numpy())}
    return written.bag(folder, "mcap", topics)


TOPICS = {"acc": (VECTOR, lambda x: x[:, :3]), "rate": (TWIST, np.asarray)}
TOPICS |= {"both": (ACCEL, np.asarray), "warm": (TEMPERATURE, lambda x: 20 + x[:, :1])}
TWISTS = [f"/rate.twist.angular.{axis}" for axis in "xyz"]
ACCELS = [f"/both.accel.linear.{axis}" for axis in "xyz"]

# --- PX4


def combined(folder, log, **more):
    path = folder / "log.ulg"
    return written.ulog(path, written.combined(STAMPS, log[SIX].to_numpy(), **more))


def sensors(folder, log, accel=None, **more):
    topics = []
    for kind, number, columns in (("accel", 2, ACCELERATION), ("gyro", 1, RATE)):
        fields = {"temperature": WARM} | (accel or {}) if kind == "accel" else {}
        values = log[columns].to_numpy()
        topics.append(written.px4_sensor(kind, number, STAMPS, values, 100, **fields))
    return written.ulog(folder / "log.ulg", *topics, **more)


def own_topic(folder, log):
    fields = {"timestamp": STAMPS, **written.vector(log[ACCELERATION].to_numpy(), "force[{}]")}
    fields |= written.vector(log[RATE].to_numpy(), "turn_{}")
    return written.ulog(folder / "log.ulg", ("my_imu", 3, fields))


MINE = {"acceleration": [f"my_imu_3.force[{i}]" for i in range(3)]}
MINE["angular_rate"] = [f"my_imu_3.turn_{i}" for i in range(3)]

# --- ArduPilot: format and names of the fields of messages

MESSAGE = "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"
OLD = "Iffffff", "TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"
ACC = "QBQfff", "TimeUS,I,SampleUS,AccX,AccY,AccZ"
GYR = "QBQfff", "TimeUS,I,SampleUS,GyrX,GyrY,GyrZ"
IMT = "QBfffffffff", "TimeUS,I,DelT,DelvT,DelaT,DelAX,DelAY,DelAZ,DelVX,DelVY,DelVZ"


def imu(log, instance=0):
    rows = zip(STAMPS, log[RATE + ACCELERATION].to_numpy(), WARM, strict=True)
    return [(t, instance, *x, 0, 0, w, 1, 1, 1000, 1000) for t, x, w in rows]


def dataflash(folder, *messages, write=written.binary):
    content = messages[0] if isinstance(messages[0], bytes) else write(*messages)
    (folder / "log.bin").write_bytes(content)
    return folder / "log.bin"


def two(folder, log):
    return dataflash(folder, ("IMU", MESSAGE, [*imu(log + 1, 0), *imu(log, 2)]))


def numbered(folder, log):
    """Older logs number the message, and count ms."""
    rows = zip(STAMPS // 1000, log[RATE + ACCELERATION].to_numpy(), strict=True)
    rows = [(int(t), *x) for t, x in rows]
    return dataflash(folder, ("IMU", OLD, rows), ("IMU2", OLD, rows))


def sampled(folder, log, later=0):
    messages = []
    for name, form, columns, shift in (("ACC", ACC, ACCELERATION, 0), ("GYR", GYR, RATE, later)):
        rows = zip(STAMPS.tolist(), log[columns].to_numpy(), strict=True)
        messages.append((name, form, [(t + 5000, 0, t + shift, *x) for t, x in rows]))
    return dataflash(folder, *messages)


NOTE = "ArduPilot logs after its own calibration"
MINE_2 = {"acceleration": "IMU_2", "angular_rate": "IMU_2"}
# how to write the log, the columns as declared, the column found, and a line
READ = {
    "ros, a file": (renamed, {}, "/imu.linear_acceleration.x", ""),
    **{f"ros, unwritten, alone {alone}":
           (partial(unwritten, alone=alone), {}, "/imu.linear_acceleration.x",
            "log.db3-wal holds data that SQLite had not yet put into the bag") for alone in (0, 1)},
    "ros, parts": (in_parts, {}, "/imu.linear_acceleration.x", "the folder has no metadata.yaml"),
    "ros, a topic": (partial(bag, imu=False, **TOPICS),
                     {"acceleration": "/acc", "angular_rate": TWISTS}, "/acc.vector.x", ""),
    "ros, columns": (partial(bag, imu=False, **TOPICS),
                     {"acceleration": ACCELS, "angular_rate": TWISTS}, ACCELS[0], ""),
    "ros, two chips": (of_two_chips, {}, "/accel.linear_acceleration.x", ""),
    "ros, no headers": (unstamped, {}, "/imu.linear_acceleration.x",
                        "/imu: its header stamps never change; times of receipt are used"),
    "px4, combined": (combined, {}, "sensor_combined_0.acceleration.x", "PX4's own calibration"),
    "px4, sensors": (sensors, {}, "sensor_accel_2.acceleration.x", ""),
    "px4, declared": (own_topic, MINE, "my_imu_3.force[0]", ""),
    "ardupilot": (lambda folder, log: dataflash(folder, ("IMU", MESSAGE, imu(log))), {},
                  "IMU_0.AccX", NOTE),
    "ardupilot, a stream": (two, MINE_2, "IMU_2.AccX", NOTE),
    "ardupilot, older": (numbered, {"acceleration": "IMU2", "angular_rate": "IMU2"}, "IMU2.AccX",
                         NOTE),
    "ardupilot, as sampled": (sampled, {}, "ACC_0.AccX", NOTE),
}  # fmt: skip


@pytest.mark.parametrize("name", READ)
def test_a_log_of_a_vehicle_is_read(log, single, run, same, tmp_path, name):
    write, columns, found, said = READ[name]
    single = log if name.startswith("ros") else single
    done = run(write(tmp_path, single), columns=columns)
    t = {"ros": NS * 1e-9 - NS[0] * 1e-9, "ard": STAMPS // 1000 * 1e-3}.get(name[:3], STAMPS * 1e-6)
    t = STAMPS * 1e-6 if name != "ardupilot, older" and name[:3] == "ard" else t
    same(done, single.assign(t=log.t if "headers" in name else t), within=1e-6)
    assert done.quality["columns"]["acceleration"][0] == found
    assert any(said in line for line in [*done.quality["warnings"], ""])


def test_temperatures_of_their_topics_are_read(log, single, run, tmp_path):
    done = run(bag(tmp_path, log, warm=TOPICS["warm"]))
    np.testing.assert_array_equal(done.samples.temperature, 20 + log.ax)
    np.testing.assert_array_equal(run(sensors(tmp_path, single)).samples.temperature, WARM)
    done = run(dataflash(tmp_path, ("IMU", MESSAGE, imu(single))))
    np.testing.assert_array_equal(done.samples.temperature, WARM)


def test_a_sensor_read_later_keeps_its_time(single, run, tmp_path):
    relative = np.full(500, -2_500, "i4")
    for path in (
        combined(tmp_path, single, accelerometer_timestamp_relative=relative),
        sampled(tmp_path, single, later=2_500),
    ):
        done = run(path)
        np.testing.assert_array_equal(done.samples.ay, single.ay)
        np.testing.assert_allclose(
            done.samples.t_accelerometer, done.samples.t - 2.5e-3, atol=1e-12
        )
        assert any("has a clock of its own" in line for line in done.quality["warnings"])
    relative = np.where(np.isin(np.arange(500), [3, 4]), 0x7FFFFFFF, 0).astype("i4")
    done = run(combined(tmp_path, single, accelerometer_timestamp_relative=relative))
    np.testing.assert_array_equal(done.samples.ay, single.ay.drop([3, 4]))
    assert done.quality["non_finite"] == 2


@pytest.mark.parametrize("pilot", ["px4", "ardupilot"])
def test_increments_are_of_their_own_interval(single, run, tmp_path, pilot):
    """Protects the division, of exact products: the result is the float64 nearest to it."""
    rng, of = np.random.default_rng(3), [0, 0, 0, 1, 1, 1]
    if pilot == "px4":
        ticks, per_s = rng.integers(4000, 6000, (500, 2)).astype("u4"), 10**6
    else:
        ticks, per_s = rng.uniform(0.009, 0.011, (500, 2)).astype("f4"), 1
    increments = (single[SIX].to_numpy() * ticks[:, of] / per_s).astype("f4")
    expected = increments.astype(float) * per_s / ticks[:, of]
    ticks[7, 1] = 0
    if pilot == "px4":
        fields = {"timestamp": STAMPS + np.uint64(90), "timestamp_sample": STAMPS}
        for i, name in enumerate(("velocity", "angle")):
            part = increments[:, 3 * i : 3 * i + 3]
            fields |= written.vector(part, f"delta_{name}[{{}}]")
            fields[f"delta_{name}_dt"] = ticks[:, i].copy()
        done = run(written.ulog(tmp_path / "log.ulg", ("vehicle_imu", 0, fields)))
    else:
        rows = zip(STAMPS, ticks, increments, strict=True)
        rows = [(t, 0, 0.01, *dt, *x[3:], *x[:3]) for t, dt, x in rows]
        done = run(dataflash(tmp_path, ("IMT", IMT, rows)))
    np.testing.assert_array_equal(done.samples[SIX], np.delete(expected, 7, axis=0))
    assert done.quality["non_finite"] == 1


def test_buffers_of_px4_are_one_row_a_sample(run, tmp_path):
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
    done = run(written.ulog(tmp_path / "log.ulg", *topics), units={"time": "ms"})
    np.testing.assert_array_equal(done.samples[SIX], counts.T * float(np.float32(0.1)))
    # stamps of whole microseconds, steps of 125.5
    np.testing.assert_allclose(np.diff(done.samples.t) * 1e3, 125.5, atol=1)


def test_px4s_own_numbers_of_its_sensors_are_kept(single, run, tmp_path):
    """The topic's device id, and its slot; of a topic without one the only calibrated sensor."""
    number = {"device_id": np.full(500, 1310988, dtype="u4")}
    known = {"CAL_ACC0_ID": 7, "CAL_ACC1_ID": 1310988, "CAL_GYRO0_ID": 9, "CAL_GYRO1_ID": 0}
    found = run(sensors(tmp_path, single, number, parameters=known)).metadata["sensor_ids"]
    assert found == {"accelerometer": {"id": 1310988, "slot": 1}, "gyroscope": {"id": 9, "slot": 0}}
    # which of two was logged is not known
    known = {"CAL_ACC0_ID": 7, "CAL_ACC1_ID": 8, "CAL_GYRO2_ID": 9}
    found = run(sensors(tmp_path, single, parameters=known)).metadata["sensor_ids"]
    assert found == {"gyroscope": {"id": 9, "slot": 2}}


# --- damage

# bytes of a row of sensor_combined: header, number of the topic, stamp, six axes
ROW = {"log.ulg": 3 + 2 + 8 + 6 * 4, "log.bin": written.packed(MESSAGE[0]).size}


@pytest.mark.parametrize(
    ("write", "line"),
    [
        (combined, "the file ends inside a message: the log was cut off"),
        (lambda f, log: dataflash(f, ("IMU", MESSAGE, imu(log))), "bytes belong to no message"),
    ],
)
def test_a_log_cut_off_is_read_up_to_there(single, run, tmp_path, write, line):
    path = write(tmp_path, single)
    content, row = path.read_bytes(), ROW[path.name]
    for lost in (1, row - 1, row, 100 * row + 5):
        path.write_bytes(content[:-lost])
        done = run(path)
        np.testing.assert_array_equal(done.samples.az, single.az[: (500 * row - lost) // row])
        said = any(line in text for text in done.quality["warnings"])
        assert said == bool(lost % row) or (path.suffix == ".ulg" and lost == row - 1)
    for size in (1, 5, 89, len(content) - 500 * row):
        path.write_bytes(content[:size])
        assert run(path).quality["status"] == "rejected"


def test_damage_to_a_ulog_costs_its_rows(single, run, tmp_path):
    dropouts = [(30, STAMPS[100]), (1500, STAMPS[200])]
    path = sensors(tmp_path, single, dropouts=dropouts)
    assert "2 dropouts while logging, 1.53 s together" in run(path).quality["warnings"]
    path, row = combined(tmp_path, single), ROW["log.ulg"]
    content = path.read_bytes()
    # PX4 marks a place to go on from several times a second
    mark = struct.pack("<HB", len(ULog.SYNC_BYTES), ord("S")) + ULog.SYNC_BYTES
    rows = [content[at : at + row] for at in range(len(content) - 500 * row, len(content), row)]
    marked = (b"".join([*rows[i : i + 20], mark]) for i in range(0, 500, 20))
    content = content[: -500 * row] + b"".join(marked)
    half = len(content) // 2
    path.write_bytes(content[:half] + b"\x03" * 200 + content[half + 200 :])
    done = run(path)
    assert 460 <= len(done.samples) < 500 and done.quality["gaps"]["count"] == 1
    assert "parts of the file are damaged" in " ".join(done.quality["warnings"])
    # a row whose end alone is overwritten cannot be known
    assert np.isin(done.samples.az, single.az).sum() >= len(done.samples) - 1


def test_damage_to_a_dataflash_log_costs_its_rows(single, run, tmp_path):
    content, row = written.binary(("IMU", MESSAGE, imu(single))), ROW["log.bin"]
    begin = len(content) - 250 * row + 7
    noise = np.random.default_rng(2).bytes(200).replace(b"\xa3", b"\xa4")
    done = run(dataflash(tmp_path, content[:begin] + noise + content[begin + 200 :]))
    lost = 1 + (7 + 200 - 1) // row
    # the row before the damage is whole: a header follows it
    rows = np.r_[0:250, 250 + lost : 500]
    np.testing.assert_array_equal(done.samples.az, single.az.to_numpy(float)[rows])
    assert f"{lost * row} of {len(content)} bytes belong to no message" in done.quality["warnings"]
    # a message of an unknown number; and an instance with a single row does not count as a sensor
    at = len(content) - 100 * row + 2
    for place, value, bad in ((at, b"\x11", 0), (at + 9, b"\x4d", 1)):
        done = run(dataflash(tmp_path, content[:place] + value + content[place + 1 :]))
        assert (len(done.samples), done.quality["bad_lines"]) == (499, bad)


def test_a_damaged_message_of_ros_is_left_out_and_counted(log, run, tmp_path):
    with Writer2(tmp_path / "log", version=9) as writer:
        connection = writer.add_connection("/imu", IMU, typestore=ROS2)
        for i, (stamp, row) in enumerate(zip(NS, log[SIX].to_numpy(), strict=True)):
            data = ROS2.serialize_cdr(written.message(ROS2, IMU, stamp, row), IMU)
            writer.write(connection, START + i, b"\x00" if i in (0, 7) else data)
    done = run(tmp_path / "log")
    np.testing.assert_array_equal(done.samples[SIX], log[SIX].drop([0, 7]))
    assert "/imu: 2 messages are damaged and left out" in done.quality["warnings"]


@pytest.mark.parametrize("kind", ["bag", "db3", "mcap"])
def test_a_bag_cut_off_is_rejected_with_what_mends_it(log, run, tmp_path, kind):
    path = bag(tmp_path, log, kind)
    path = path if kind == "bag" else path / f"log.{kind}"
    whole = path.read_bytes()
    for share in (0.0, 0.0001, 0.3, 0.99):
        path.write_bytes(whole[: int(share * len(whole))])
        [reason] = run(path).quality["reasons"]
        mended = r"damaged, .*, with rosbag reindex, sqlite3 with .recover, or mcap recover"
        assert re.match(rf"log.{kind} is (neither|{mended})", reason)


def without(name, content=None):
    def write(folder, log):
        path = bag(folder, log, "mcap")
        (path / name).unlink()
        if content:
            (path / name).write_text(content)
        return path

    return write


def false_definition(folder, log):
    """Other types are passed over, and no definition of the bag is run."""
    with Writer1(folder / "log.bag") as writer:
        text = "this is (no definition"
        other = writer.add_connection("/a", "x/msg/Y", msgdef=text, md5sum="0" * 32)
        writer.write(other, START, b"\x01")
        false = writer.add_connection("/b", IMU, msgdef="float64 x\n", md5sum="1" * 32)
        writer.write(false, START, b"\x01" * 8)
    return folder / "log.bag"


def cut(folder, log):
    path = combined(folder, log)
    path.write_bytes(path.read_bytes()[:-5])
    return path


def two_kinds(folder, log):
    codes, names = MESSAGE
    other = codes, names.replace("Gyr", "?").replace("Acc", "Gyr").replace("?", "Acc")
    halves = ("IMU", MESSAGE, imu(log)[:250]), ("IMU", other, imu(log)[250:])
    return dataflash(folder, written.binary(*halves))


TWO_KINDS = "IMU is defined twice, with other fields: the log is of two kinds"
NO_STREAM = {"angular_rate": "/gyro"}
# how to write it, the columns as declared, whether these are at fault, and the line
REFUSED = {
    "a bag without its file": (without("log.mcap"), {}, False, "log is damaged, .*Reader"),
    "no metadata": (without("metadata.yaml", "a: b"), {}, False, "log is damaged, .*Reader"),
    "a false definition": (false_definition, {}, False, f"/b: its {IMU} is not the one that ROS"),
    "no such topic": (bag, NO_STREAM, True, "no stream '/gyro'; there are /imu"),
    "a topic that is not yet written": (unwritten, NO_STREAM, False,
                                        "no stream '/gyro'.*it may be lost to damage: log.db3-wal"),
    "a topic that is lost": (cut, {"angular_rate": "sensor_gyro_9"}, False,
                             "no stream 'sensor_gyro_9'.*it may be lost to damage: the file ends"),
    "no topic": (own_topic, {}, False, "no rows of sensor_combined, sensor_accel"),
    "two instances": (two, {}, True, "IMU_0 and IMU_2 all look like acceleration; name one"),
    "two kinds": (two_kinds, {}, False, TWO_KINDS),
    **{f"no messages {i}": (lambda folder, log, x=noise: dataflash(folder, x), {}, False,
                            "no rows of IMU, ACC, GYR or IMT")
       for i, noise in enumerate((b"", b"\xa3\x95" * 3000,
                                  written.binary(("MINE", ACC, []))))},
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_a_log_of_a_vehicle_is_refused_in_one_line(single, refused, tmp_path, name):
    write, columns, error, line = REFUSED[name]
    refused(line, write(tmp_path, single), error=error, columns=columns)
