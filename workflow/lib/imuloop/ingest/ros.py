"""ROS 1 bags, ROS 2 bags and MCAP files: the topics of inertial messages, each a stream."""

import sqlite3
import tempfile
from array import array
from contextlib import closing, suppress
from operator import attrgetter
from pathlib import Path

import numpy as np
import pyarrow as pa

from imuloop.core.errors import ImuloopError, RejectedLog, one_line
from imuloop.ingest.damage import MOST_TIMES, cause, check_unpacked, reject_damage
from imuloop.ingest.spellings import AXES
from imuloop.ingest.streams import Stream, raw_log

ENDINGS = (".bag", ".db3", ".mcap")

# vectors of each type of message that is read; other types are passed over
_IMU = "sensor_msgs/msg/Imu"
_VECTORS = {
    _IMU: ("linear_acceleration", "angular_velocity"),
    "geometry_msgs/msg/Vector3Stamped": ("vector",),
    "geometry_msgs/msg/AccelStamped": ("accel.linear", "accel.angular"),
    "geometry_msgs/msg/TwistStamped": ("twist.linear", "twist.angular"),
}
_FIELDS = {k: [f"{v}.{axis}" for v in vectors for axis in AXES] for k, vectors in _VECTORS.items()}
_FIELDS["sensor_msgs/msg/Temperature"] = ["temperature"]
# as ROS defines its messages
_UNITS = {"time": "ns", "acceleration": "m/s^2", "angular_rate": "rad/s", "temperature": "degC"}

# first bytes of a file to the ending of its name, and what mends one that was cut off
_KINDS = {b"#ROSBAG": ".bag", b"SQLite format 3\0": ".db3", b"\x89MCAP0\r\n": ".mcap"}
_MENDED_BY = {".bag": "rosbag reindex", ".db3": "sqlite3 with .recover", ".mcap": "mcap recover"}
_ZSTD = b"\x28\xb5\x2f\xfd"
# what SQLite has not yet written
_UNWRITTEN = ("-wal", "-journal")


@reject_damage
def read(paths, columns=None):
    """Read the topics of inertial messages of a bag.

    The stamps are those of the headers in ns; where a topic's never change, the times of receipt.
    `columns` names topics, or ``TOPIC.FIELD``.
    """
    path, topics = Path(paths["log"]), {}
    files, notes = _files(path)
    beside = path.iterdir() if path.is_dir() else [Path(f"{path}{end}") for end in _UNWRITTEN]
    damage = [
        f"{file.name} holds what SQLite had not yet written; it is not read"
        for file in beside
        if file.name.endswith(_UNWRITTEN) and file.is_file() and file.stat().st_size
    ]
    with tempfile.TemporaryDirectory() as folder:
        for number, file in enumerate(files):
            bag = _plain(file, Path(folder, str(number)))
            try:
                _gather(bag, topics, damage)
            except (ImuloopError, ImportError, MemoryError):
                raise
            except Exception as error:
                if bag.suffix == ".db3" and (tables := _tables(bag)) and "topics" not in tables:
                    listed = ", ".join(map(one_line, tables[:5]))
                    raise RejectedLog(
                        f"{path.name} is an SQLite database, but no ROS 2 bag: its tables are "
                        f"{listed[:200]}; export the one with the samples as CSV"
                    ) from error
                tool = _MENDED_BY.get(bag.suffix, "ros2 bag reindex")
                raise RejectedLog(
                    f"{path.name} is not a whole bag ({cause(error)}); copy it again, or if its "
                    f"recording was cut off, mend it with {tool}"
                ) from error
    streams, about = _streams(topics)
    log = raw_log(streams, columns, damage=damage)
    found = [name for each in log.found.values() for name in np.atleast_1d(each)]
    about = [line for name, line in about if any(field.startswith(f"{name}.") for field in found)]
    log.notes[:0] = notes + damage + about
    return log


class _Topic:
    """The messages of a topic so far: stamps, times of receipt, values row by row."""

    def __init__(self, kind):
        self.numbers = attrgetter("header.stamp.sec", "header.stamp.nanosec", *_FIELDS[kind])
        self.stamps, self.received, self.values = array("q"), array("q"), array("d")
        self.damaged = 0

    def add(self, received, message):
        seconds, nanoseconds, *values = self.numbers(message)
        self.stamps.append(seconds * 10**9 + nanoseconds)
        self.received.append(received)
        self.values.extend(values)


def _streams(topics):
    """Return a stream per topic, and (topic, text) of what a user should know of them.

    Drivers of two chips publish each in an Imu message, which has room for both: what one topic
    holds as zeros while another measures it is left out.
    """
    about, tables = [], {}
    for (name, kind), topic in topics.items():
        rows = np.asarray(topic.values).reshape(-1, len(_FIELDS[kind]))
        tables[name, kind] = dict(zip(_FIELDS[kind], rows.T, strict=True))
    imus = {name: table for (name, kind), table in tables.items() if kind == _IMU}
    for vector in _VECTORS[_IMU]:
        names = [f"{vector}.{axis}" for axis in AXES]
        zeros = [name for name, table in imus.items() if not any(table[n].any() for n in names)]
        for name in zeros if len(zeros) < len(imus) else ():
            if len(imus[name][names[0]]):
                for field in names:
                    del imus[name][field]
                about.append((name, f"{name}: {', '.join(names)} are all zero, so not measured"))
    streams = []
    for (name, kind), topic in topics.items():
        stamps = np.asarray(topic.stamps)
        if len(stamps) > 1 and np.ptp(stamps) == 0:
            stamps = np.asarray(topic.received)
            line = "its header stamps never change; times of receipt are used"
            about.append((name, f"{name}: {line}"))
        if topic.damaged:
            about.append((name, f"{name}: {topic.damaged} messages are damaged and left out"))
        streams.append(Stream(name, stamps, tables[name, kind], _UNITS))
    return streams, about


def _files(path):
    """Return what the library is to open of a bag, in the order of recording, and notes."""
    if path.is_file() or (path / "metadata.yaml").is_file():
        return [path], []
    found = [p for p in path.iterdir() if p.name.removesuffix(".zstd").endswith(ENDINGS)]
    # bag_2 before bag_10
    found = sorted((p for p in found if p.is_file()), key=lambda p: (len(p.name), p.name))
    if not found:
        raise RejectedLog(f"the folder holds no bag: no metadata.yaml, no {', '.join(ENDINGS)}")
    return found, ["the folder has no metadata.yaml: all its bags are read, in the order of names"]


def _plain(path, target):
    """Return a path to a bag by which the library can open it and knows its kind; unpacked.

    Its own names would have to be quoted in the address that the library makes of them.
    """
    if path.is_dir():
        target.symlink_to(path.absolute())
        return target
    if _head(path).startswith(_ZSTD):
        size = path.stat().st_size
        with pa.input_stream(path, compression="zstd") as packed, open(target, "wb") as file:
            while part := packed.read(1 << 20):
                file.write(part)
                check_unpacked(size, file.tell())
        path = target
    for start, ending in _KINDS.items():
        if _head(path).startswith(start):
            link = target.with_suffix(ending)
            link.symlink_to(path.absolute())
            return link
    raise RejectedLog(f"{path.name} is neither a ROS 1 bag nor SQLite or MCAP of a ROS 2 bag")


def _head(path):
    with open(path, "rb") as file:
        return file.read(16)


def _tables(path):
    """Return the names of an SQLite database's tables; empty if they cannot be read."""
    query = "SELECT name FROM sqlite_master WHERE type = 'table'"
    with closing(sqlite3.connect(f"{path.as_uri()}?immutable=1", uri=True)) as database:
        with suppress(sqlite3.Error):
            return [name for (name,) in database.execute(query)]
    return []


def _gather(bag, topics, damage):
    """Add the messages of a bag to the topics, and what it lacks to the damage."""
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    ros1 = bag.suffix == ".bag"
    # never the definitions in the bag, as AnyReader: the library makes them Python code and runs it
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    parse = store.deserialize_ros1 if ros1 else store.deserialize_cdr
    with (rosbag1 if ros1 else rosbag2).Reader(bag) as reader:
        wanted = [c for c in reader.connections if c.msgtype in _FIELDS]
        for connection in wanted:
            name = connection.msgtype
            usual = store.generate_msgdef(name)[1] if ros1 else store.hash_rihs01(name)
            if connection.digest not in ("", "*", usual):
                raise RejectedLog(f"{connection.topic}: its {name} is not the one that ROS defines")
            topics.setdefault((connection.topic, name), _Topic(name))
        left = sum(connection.msgcount for connection in wanted)
        for connection, received, data in reader.messages(wanted) if wanted else ():
            left -= 1
            topic = topics[connection.topic, connection.msgtype]
            try:
                if not ros1 and data[:4] == _ZSTD:
                    packed = pa.input_stream(pa.py_buffer(data), compression="zstd")
                    data = packed.read(MOST_TIMES * len(data))
                topic.add(received, parse(data, connection.msgtype))
            except Exception:
                topic.damaged += 1
        if left > 0:
            damage.append(f"{bag.resolve().name} lacks {left} messages that its index announces")
