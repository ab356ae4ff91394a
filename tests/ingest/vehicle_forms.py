"""Logs of robots and autopilots: functions of a path, the log and options, which return paths."""

import shutil
import struct

import numpy as np
from rosbags.rosbag2 import Writer as Writer2

from ingest import written
from ingest.text_forms import SIX
from ingest.written import ACCELERATION, IMU, RATE, ROS2, START, TEMPERATURE, VECTOR

# autopilots count us from their start; odd, so that no stamp is a whole number of anything
STAMPS = (12_345_678_901 + 10_003 * np.arange(500)).astype("u8")
WARM = np.linspace(20, 30, 500, dtype=np.float32)

# --- ROS

NS = START + 10_000_000 * np.arange(500) + np.arange(500) % 7
TWIST, ACCEL = (f"geometry_msgs/msg/{kind}Stamped" for kind in ("Twist", "Accel"))
ZEROS = np.zeros((500, 3))
TOPICS = {
    "acc": (VECTOR, lambda x: x[:, :3]), "rate": (TWIST, np.asarray), "both": (ACCEL, np.asarray),
    "warm": (TEMPERATURE, lambda x: 20 + x[:, :1]), "imu": (IMU, np.asarray),
    "accel": (IMU, lambda x: np.hstack([x[:, :3], ZEROS])),
    "gyro": (IMU, lambda x: np.hstack([ZEROS, x[:, 3:]])),
}  # fmt: skip


def bag(path, log, kind="db3", topics=("imu",), rows=slice(None), name="log", stamped=True):
    every, values = {}, log[SIX].to_numpy()[rows]
    for key in topics:
        of, take = TOPICS[key]
        every[f"/{key}"] = (of, NS[rows] * stamped, take(values))
    return [written.bag(path.parent, kind, every, name=name)]


def renamed(path, log):
    """A storage file alone, with a name that no address can have."""
    [folder] = bag(path, log)
    return [shutil.copy(folder / "log.db3", path.with_name("run #3 100% a?b.db3"))]


def in_parts(path, log):
    """A recording in several files, without metadata."""
    whole = path.with_name("split")
    whole.mkdir()
    for part, name in (((0, 200), "log_2"), ((200, 400), "log_10"), ((400, 500), "log_11")):
        [piece] = bag(path, log, "mcap", rows=slice(*part), name=name)
        shutil.copy(piece / f"{name}.mcap", whole)
    return [whole]


def bag_without(path, log, file, content=None):
    [folder] = bag(path, log, "mcap")
    (folder / file).unlink()
    if content:
        (folder / file).write_text(content)
    return [folder]


def bag_cut_off(path, log, kind, share):
    [whole] = bag(path, log, kind)
    whole = whole if kind == "bag" else whole / f"log.{kind}"
    content = whole.read_bytes()
    whole.write_bytes(content[: int(share * len(content))])
    return [whole]


def bag_with_damage(path, log):
    """Two messages of it are too short."""
    with Writer2(path.with_name("log"), version=9) as writer:
        connection = writer.add_connection("/imu", IMU, typestore=ROS2)
        for i, (stamp, row) in enumerate(zip(NS, log[SIX].to_numpy(), strict=True)):
            data = ROS2.serialize_cdr(written.message(ROS2, IMU, stamp, row), IMU)
            writer.write(connection, START + i, b"\x00" if i in (0, 7) else data)
    return [path.with_name("log")]


# --- PX4


def combined(path, log, cut=0, **more):
    written.ulog(path, written.combined(STAMPS, log[SIX].to_numpy(), **more))
    path.write_bytes(path.read_bytes()[: -cut or None])


def late_combined(path, log):
    """Two rows have no accelerometer."""
    none = np.where(np.isin(np.arange(500), [3, 4]), 0x7FFFFFFF, 0).astype("i4")
    combined(path, log, accelerometer_timestamp_relative=none)


def sensors(path, log, dropouts=False, parameters=None, device_id=None):
    topics = []
    for kind, number, columns in (("accel", 2, ACCELERATION), ("gyro", 1, RATE)):
        fields = {"temperature": WARM} if kind == "accel" else {}
        if device_id and kind == "accel":
            fields["device_id"] = np.full(500, device_id, dtype="u4")
        values = log[columns].to_numpy()
        topics.append(written.px4_sensor(kind, number, STAMPS, values, 100, **fields))
    lost = [(30, STAMPS[100]), (1500, STAMPS[200])] if dropouts else []
    written.ulog(path, *topics, dropouts=lost, parameters=parameters)


def own_topic(path, log):
    fields = {"timestamp": STAMPS, **written.vector(log[ACCELERATION].to_numpy(), "force[{}]")}
    fields |= written.vector(log[RATE].to_numpy(), "turn_{}")
    written.ulog(path, ("my_imu", 3, fields))


# --- ArduPilot: format and names of the fields of messages

MESSAGE = "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"
OLD = "Iffffff", "TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"
ACC = "QBQfff", "TimeUS,I,SampleUS,AccX,AccY,AccZ"
GYR = "QBQfff", "TimeUS,I,SampleUS,GyrX,GyrY,GyrZ"
# bytes of a row of sensor_combined, header, number of the topic, stamp, six axes; and of a message
ROW = {".ulg": 3 + 2 + 8 + 6 * 4, ".bin": written.packed(MESSAGE[0]).size}


def imu(log, instance=0):
    rows = zip(STAMPS, log[RATE + ACCELERATION].to_numpy(), WARM, strict=True)
    return [(t, instance, *x, 0, 0, w, 1, 1, 1000, 1000) for t, x, w in rows]


def messages(path, log, write="binary"):
    path.write_bytes(getattr(written, write)(("IMU", MESSAGE, imu(log))))


def two_instances(path, log):
    path.write_bytes(written.binary(("IMU", MESSAGE, [*imu(log + 1, 0), *imu(log, 2)])))


def numbered(path, log):
    """Older logs number the message, and count ms."""
    rows = zip(STAMPS // 1000, log[RATE + ACCELERATION].to_numpy(), strict=True)
    rows = [(int(t), *x) for t, x in rows]
    path.write_bytes(written.binary(("IMU", OLD, rows), ("IMU2", OLD, rows)))


def sampled(path, log, later=0):
    every = []
    for name, form, columns, shift in (("ACC", ACC, ACCELERATION, 0), ("GYR", GYR, RATE, later)):
        rows = zip(STAMPS.tolist(), log[columns].to_numpy(), strict=True)
        every.append((name, form, [(t + 5000, 0, t + shift, *x) for t, x in rows]))
    path.write_bytes(written.binary(*every))


def two_kinds(path, log):
    codes, names = MESSAGE
    other = codes, names.replace("Gyr", "?").replace("Acc", "Gyr").replace("?", "Acc")
    halves = ("IMU", MESSAGE, imu(log)[:250]), ("IMU", other, imu(log)[250:])
    path.write_bytes(written.binary(*halves))


def no_messages(path, _):
    path.write_bytes(written.binary(("MINE", ACC, [])))


def with_noise(path, log):
    """Noise over 200 bytes in the middle, without the head of a message."""
    content, row = written.binary(("IMU", MESSAGE, imu(log))), ROW[".bin"]
    begin = len(content) - 250 * row + 7
    noise = np.random.default_rng(2).bytes(200).replace(b"\xa3", b"\xa4")
    path.write_bytes(content[:begin] + noise + content[begin + 200 :])


def with_byte(path, log, offset, byte):
    """Another byte in the hundredth message from the end."""
    content = bytearray(written.binary(("IMU", MESSAGE, imu(log))))
    content[len(content) - 100 * ROW[".bin"] + offset] = byte
    path.write_bytes(content)


def cut_log(path, log, keep=None, lose=None):
    """A log that was cut off: so many bytes of it, or all but so many."""
    (combined if path.suffix == ".ulg" else messages)(path, log)
    path.write_bytes(path.read_bytes()[: keep or -lose])


def marked_ulog(path, log):
    """Damage amid a log with the marks that PX4 writes several times a second."""
    combined(path, log)
    content, row = path.read_bytes(), ROW[".ulg"]
    mark = struct.pack("<HB", 8, ord("S")) + b"/s\x13 %\x0c\xbb\x12"
    rows = [content[at : at + row] for at in range(len(content) - 500 * row, len(content), row)]
    marked = (b"".join([*rows[i : i + 20], mark]) for i in range(0, 500, 20))
    content = content[: -500 * row] + b"".join(marked)
    half = len(content) // 2
    path.write_bytes(content[:half] + b"\x03" * 200 + content[half + 200 :])
