"""Logs as phones, bags and autopilots write them."""

import struct
from types import SimpleNamespace

import h5py
import numpy as np
from pyulog import ULog
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore
from scipy.io import savemat

ACCELERATION, RATE = ["ax", "ay", "az"], ["gx", "gy", "gz"]


def table(header, columns, write="{}".format, separator=",", decimal="."):
    lines = [separator.join(header)]
    for row in zip(*columns, strict=True):
        lines.append(separator.join(write(x).replace(".", decimal) for x in row))
    return "\n".join(lines) + "\n"


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


# --- ULog, written with the format's own library

TYPES = {"u8": "uint64_t", "f4": "float", "i4": "int32_t", "i2": "int16_t", "u1": "uint8_t"}
TYPES |= {"u4": "uint32_t"}


def ulog(path, *topics, dropouts=(), parameters=None):
    """Write topics (name, instance, name of a field -> values); return the path."""
    log = ULog(None)
    log._initial_parameters.update(parameters or {})
    for number, (topic, instance, fields) in enumerate(topics):
        fields = {key: np.asarray(x) for key, x in fields.items()}
        kinds = [ULog._FieldData(key, TYPES[x.dtype.str[1:]]) for key, x in fields.items()]
        stems = [(field.type_str, *field.field_name.partition("[")[:2]) for field in kinds]
        # type, length of an array, name
        formats = [(k, stems.count((k, n, a)) * bool(a), n) for k, n, a in dict.fromkeys(stems)]
        log._message_formats[topic] = SimpleNamespace(name=topic, fields=formats)
        data = {"multi_id": instance, "msg_id": number, "name": topic, "data": fields}
        log._data_list.append(SimpleNamespace(field_data=kinds, **data))
    for duration, stamp in dropouts:
        content = struct.pack("<H", duration)
        log._dropouts.append(ULog.MessageDropout(content, SimpleNamespace(), int(stamp)))
    log.write_ulog(str(path))
    return path


def vector(values, name):
    return {name.format(i): np.asarray(x, "f4") for i, x in enumerate(np.transpose(values))}


def combined(stamps, values, **more):
    """The topic sensor_combined of values, force first, (n, 6)."""
    fields = {"timestamp": stamps, **vector(values[:, 3:], "gyro_rad[{}]"), **more}
    return "sensor_combined", 0, fields | vector(values[:, :3], "accelerometer_m_s2[{}]")


def px4_sensor(kind, instance, stamps, values, delay=0, **more):
    """A topic of one sensor, published later than sampled."""
    fields = {"timestamp": stamps + np.uint64(delay), "timestamp_sample": stamps}
    axes = {axis: np.asarray(x, "f4") for axis, x in zip("xyz", values.T, strict=True)}
    return f"sensor_{kind}", instance, fields | axes | more


# --- MATLAB


def matlab_5(path, variables, packed=False):
    savemat(path, variables, do_compression=packed, oned_as="column")


def matlab_7(path, variables):
    matlab_5(path, variables, packed=True)


def matlab_73(path, variables):
    """Save as MATLAB does: its text before HDF5, dimensions backwards, structs as groups."""
    with h5py.File(path, "w", userblock_size=512) as file:
        file.create_group("#refs#")
        _put(file, variables)
    with open(path, "r+b") as file:
        head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, HDF5 schema 1.00 ."
        file.write(head.ljust(116) + bytes(8) + struct.pack("<H", 0x200) + b"IM")


def _put(group, variables):
    for name, value in variables.items():
        if isinstance(value, dict):
            _put(group.create_group(name), value)
            group[name].attrs["MATLAB_class"] = np.bytes_("struct")
            continue
        if isinstance(value, str):
            what, value = "char", np.array([[ord(letter) for letter in value]], "u2")
        else:
            value = np.asarray(value)
            value = value[:, None] if value.ndim == 1 else value
            what = {"float64": "double", "float32": "single"}.get(str(value.dtype), value.dtype)
        if value.size:
            packing = {"compression": "gzip"} if value.size > 9 else {}
            dataset = group.create_dataset(name, data=value.T, **packing)
        else:
            dataset = group.create_dataset(name, data=np.array(value.shape, "u8"))
            dataset.attrs["MATLAB_empty"] = 1
        dataset.attrs["MATLAB_class"] = np.bytes_(str(what))


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


def phyphox(
    log, kind=("Acceleration", "Gyroscope"), separator=",", decimal=".", write="{:.9E}".format
):
    """Return name -> text as phyphox exports it: ten digits, an experiment's own names."""
    layout = {"write": write, "separator": separator, "decimal": decimal}
    members = {"meta/time.csv": timed(separator, decimal, (0, 1.7e9))}
    for file, name, axes, unit in (
        ("Accelerometer", kind[0], ACCELERATION, "m/s^2"),
        ("Gyroscope", kind[1], RATE, "rad/s"),
    ):
        header = ['"Time (s)"'] + [f'"{f"{name} {a}".strip()} ({unit})"' for a in "xyz"]
        members[f"{file}.csv"] = table(header, [log.t, *(log[a] for a in axes)], **layout)
    return members


def sensor_logger(log, named, about=("android", "false"), stamps=None):
    """Return name -> text as Sensor Logger exports it: `named` maps files to columns of the log."""
    t = stamps or BEGUN + np.rint(log.t.to_numpy() * 1e9).astype(np.int64)
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
