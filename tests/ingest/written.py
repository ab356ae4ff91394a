"""Logs as phones, bags and autopilots write them."""

import struct

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from ingest.tables import ACCELERATION, RATE, table

# --- DataFlash: messages of ArduPilot are format and names of the fields

PARM = "QNf", "TimeUS,Name,Value"
CODES = dict(Q="Q", B="B", f="f", I="I", H="H", c="h", n="4s", N="16s", Z="64s")
CODES |= dict(d="d", b="b", h="h", i="i", q="q", C="H", e="i", E="I", L="i")
FORMAT = struct.Struct("<3BBB4s16s64s")


def packed(codes):
    return struct.Struct("<3B" + "".join(CODES[code] for code in codes))


def definition(number, name, codes, names):
    texts = name.encode(), codes.encode(), names.encode()
    return FORMAT.pack(0xA3, 0x95, 0x80, number, packed(codes).size, *texts)


def binary(*messages):
    """Return a log of (name, (format, names), rows), the rows of all messages in turn."""
    log = definition(0x80, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
    kinds = [*messages, ("PARM", PARM, [(7, b"INS_ACCOFFS_X", 0.5)])]
    for number, (name, (codes, names), _) in enumerate(kinds, 0x90):
        log += definition(number, name, codes, names)
    turns = [
        (i, number, codes, row)
        for number, (_, (codes, _), rows) in enumerate(kinds, 0x90)
        for i, row in enumerate(rows)
    ]
    for _, number, codes, row in sorted(turns, key=lambda turn: turn[:2]):
        log += packed(codes).pack(0xA3, 0x95, number, *row)
    return log


def text(*messages):
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
    for number, (name, (codes, names), _) in enumerate(messages, 0x90):
        lines.append(f"FMT, {number}, {packed(codes).size}, {name}, {codes}, {names}")
    for name, _, rows in messages:
        lines += [", ".join([name, *(str(x) for x in row)]) for row in rows]
    return ("\n".join(lines) + "\n").encode()


# --- ROS

ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
START = 1_700_000_000 * 10**9
IMU = "sensor_msgs/msg/Imu"
VECTOR = "geometry_msgs/msg/Vector3Stamped"
TEMPERATURE = "sensor_msgs/msg/Temperature"


def message(store, name, stamp, values):
    types = store.types
    sequence = {"seq": 0} if store is ROS1 else {}
    moment = types["builtin_interfaces/msg/Time"](*divmod(int(stamp), 10**9))
    header = types["std_msgs/msg/Header"](stamp=moment, frame_id="imu", **sequence)
    vector = types["geometry_msgs/msg/Vector3"]
    if name == TEMPERATURE:
        return types[name](header, *values, 0.0)
    if name == VECTOR:
        return types[name](header, vector(*values))
    if name != IMU:
        part = types[name.removesuffix("Stamped")]
        return types[name](header, part(vector(*values[:3]), vector(*values[3:])))
    turn = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    unknown = np.zeros(9)
    return types[name](
        header, turn, unknown, vector(*values[3:]), unknown, vector(*values[:3]), unknown
    )


def bag(folder, kind, topics, received=START, name="log"):
    """Write topics, name -> (type, stamps, rows), as `kind` and packing; return the bag's path."""
    kind, _, packing = kind.partition(" ")
    store = ROS1 if kind == "bag" else ROS2
    path = folder / (f"{name}.bag" if kind == "bag" else name)
    if kind == "bag":
        writer, serialize = Writer1(path), store.serialize_ros1
        if packing:
            writer.set_compression(Writer1.CompressionFormat[packing.upper()])
    else:
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer, serialize = Writer2(path, version=9, storage_plugin=plugin), store.serialize_cdr
        if packing:
            mode = CompressionMode[packing.upper()]
            writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        for topic, (type_, stamps, rows) in topics.items():
            connection = writer.add_connection(topic, type_, typestore=store)
            for i, (stamp, row) in enumerate(zip(stamps, rows, strict=True)):
                data = serialize(message(store, type_, stamp, row), type_)
                writer.write(connection, received + 10**7 * i, data)
    return path


# --- phones

# ns
BEGUN = 1_718_030_736_872_695_300


def timed(separator, decimal, *starts):
    head = separator.join(["event", "experiment time", "system time", "system time text"])
    rows = [f"START{separator}{a:.9E}{separator}{b:.3f}{separator}a day" for a, b in starts]
    return "\n".join([head, *(row.replace(".", decimal) for row in rows)]) + "\n"


def phyphox(log, kind=("Acceleration", "Gyroscope"), separator=",", decimal="."):
    """Return name -> text as phyphox exports it: ten digits, an experiment's own names."""
    layout = {"write": "{:.9E}".format, "separator": separator, "decimal": decimal}
    members = {"meta/time.csv": timed(separator, decimal, (0, 1.7e9))}
    for file, name, axes, unit in (
        ("Accelerometer", kind[0], ACCELERATION, "m/s^2"),
        ("Gyroscope", kind[1], RATE, "rad/s"),
    ):
        header = ['"Time (s)"'] + [f'"{f"{name} {a}".strip()} ({unit})"' for a in "xyz"]
        members[f"{file}.csv"] = table(header, [log.t, *(log[a] for a in axes)], **layout)
    return members


def sensor_logger(log, named, about=("android", "false")):
    """Return name -> text as Sensor Logger exports it: `named` maps files to columns of the log."""
    t = BEGUN + np.rint(log.t.to_numpy() * 1e9).astype(np.int64)
    members = {
        f"{file}.csv": table(
            ["time", "seconds_elapsed", "z", "y", "x"], [t, log.t, *(log[c] for c in columns[::-1])]
        )
        for file, columns in named.items()
    }
    members["Annotation.csv"] = "time,seconds_elapsed,text,millisecond_press_duration\n"
    if about:
        members["Metadata.csv"] = (
            "version,device name,recording epoch time,platform,appVersion,standardisation\n"
            f"3,A phone,{BEGUN // 1_000_000},{about[0]},1.59,{about[1]}\n"
        )
    return members


def sensorlog(log, rate="gyroRotation", unit="(rad/s)"):
    """Return the text of a SensorLog CSV: iOS signs, a row each 10 ms, stamps since the boot."""
    names = [f"accelerometerAcceleration{a}(G)" for a in "XYZ"]
    names += [f"{rate}{a}{unit}" for a in "XYZ"]
    clock = "gyro" if rate.startswith("gyro") else "motion"
    head = ["loggingTime(txt)", "accelerometerTimestamp_sinceReboot(s)"]
    head += [f"{clock}Timestamp_sinceReboot(s)", *names]
    written = [f"2021-09-20 08:52:{t:06.3f} +0200" for t in log.t]
    stamps = [f"{t:.2f}" for t in 62608 + log.t]
    return table(head, [written, stamps, stamps, *(log[a] for a in ACCELERATION + RATE)])
