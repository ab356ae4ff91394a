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
from imuloop.ingest.damage import MOST_TIMES, cause, reject_damage
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

# of each kind of file: first bytes, and what mends one that was cut off
STARTS = (b"#ROSBAG", b"SQLite format 3\0", b"\x89MCAP0")
_TOOLS = ("rosbag reindex", "sqlite3 with .recover", "mcap recover")
_ZSTD = b"\x28\xb5\x2f\xfd"
# what SQLite has not yet written
_UNWRITTEN = ("-wal", "-journal")


@reject_damage
def read(paths, columns=None):
    """Read the topics of inertial messages of a bag.

    The stamps are those of the headers in ns, or the times of receipt if a topic's headers never
    change. `columns` names topics, or ``TOPIC.FIELD``.
    """
    path, topics, notes = Path(paths["log"]), {}, []
    bags, beside = [path], [Path(f"{path}{end}") for end in _UNWRITTEN]
    if path.is_dir():
        beside = [*path.iterdir()]
        if not (path / "metadata.yaml").is_file():
            # bag_2 before bag_10
            bags = sorted(beside, key=lambda file: (len(file.name), file.name))
            bags = [file for file in bags if file.suffix in ENDINGS and file.is_file()]
            notes.append("the folder has no metadata.yaml: all its bags are read in order of name")
        if not bags:
            raise RejectedLog(f"the folder holds no bag: no metadata.yaml, no {', '.join(ENDINGS)}")
    damage = [
        f"{file.name} holds what SQLite had not yet written; it is not read"
        for file in beside
        if file.name.endswith(_UNWRITTEN) and file.is_file() and file.stat().st_size
    ]
    with tempfile.TemporaryDirectory() as folder:
        for number, bag in enumerate(bags):
            link = _link(bag, Path(folder, str(number)))
            try:
                _gather(link, topics, damage)
            except (ImuloopError, ImportError):
                raise
            # damage can announce any size: a lack of memory is no other fault
            except Exception as error:
                tool = dict(zip(ENDINGS, _TOOLS, strict=True)).get(link.suffix, "ros2 bag reindex")
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


def _link(path, target):
    """Return a link to a bag by which the library can open it and knows its kind.

    The library makes an address of the path, in which some names would have to be quoted.
    """
    if path.is_file():
        with open(path, "rb") as file:
            head = file.read(max(map(len, STARTS)))
        kinds = [end for start, end in zip(STARTS, ENDINGS, strict=True) if head.startswith(start)]
        if not kinds:
            raise RejectedLog(f"{path.name} is neither a ROS 1 bag nor SQLite or MCAP of ROS 2")
        target = target.with_suffix(kinds[0])
    target.symlink_to(path.absolute())
    if target.suffix == ".db3":
        # a damaged database is for the library to name
        address = f"{target.as_uri()}?immutable=1"
        with suppress(sqlite3.Error), closing(sqlite3.connect(address, uri=True)) as database:
            tables = [name for (name,) in database.execute("SELECT name FROM sqlite_master")]
            if tables and "topics" not in tables:
                raise RejectedLog(
                    f"{path.name} is an SQLite database, but no ROS 2 bag: its tables are "
                    f"{', '.join(map(one_line, tables))[:200]}; export the one with the samples "
                    "as CSV"
                )
    return target


def _gather(bag, topics, damage):
    """Add the messages of a bag to the topics, and what it lacks to the damage.

    `topics` maps name and type of a topic to the stamps of its headers and of receipt in turn, its
    values row by row, and a list with an entry per damaged message.
    """
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    ros1 = bag.suffix == ".bag"
    # never the definitions in the bag, as AnyReader: the library makes them Python code and runs it
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    parse = store.deserialize_ros1 if ros1 else store.deserialize_cdr
    rows = {kind: attrgetter("header.stamp", *fields) for kind, fields in _FIELDS.items()}
    with (rosbag1 if ros1 else rosbag2).Reader(bag) as reader:
        wanted = [c for c in reader.connections if c.msgtype in _FIELDS]
        for connection in wanted:
            kind = connection.msgtype
            usual = store.generate_msgdef(kind)[1] if ros1 else store.hash_rihs01(kind)
            if connection.digest not in ("", "*", usual):
                raise RejectedLog(f"{connection.topic}: its {kind} is not the one that ROS defines")
            topics.setdefault((connection.topic, kind), (array("q"), array("d"), []))
        left = sum(connection.msgcount for connection in wanted)
        for connection, received, data in reader.messages(wanted) if wanted else ():
            left -= 1
            kind = connection.msgtype
            stamps, values, damaged = topics[connection.topic, kind]
            try:
                if not ros1 and data[:4] == _ZSTD:
                    packed = pa.input_stream(pa.py_buffer(data), compression="zstd")
                    data = packed.read(MOST_TIMES * len(data))
                stamp, *row = rows[kind](parse(data, kind))
                stamps.extend((stamp.sec * 10**9 + stamp.nanosec, received))
                values.extend(row)
            except Exception:
                damaged.append(received)
        if left > 0:
            damage.append(f"{bag.resolve().name} lacks {left} messages that its index announces")


def _streams(topics):
    """Return a stream per topic, and (topic, text) of what a user should know of them.

    Drivers of two chips publish each in an Imu message, which has room for both: what one topic
    holds as zeros while another measures it is left out.
    """
    about, streams = [], []
    for (name, kind), (stamps, values, damaged) in topics.items():
        headers, received = np.asarray(stamps).reshape(-1, 2).T
        if len(headers) > 1 and np.ptp(headers) == 0:
            headers = received
            line = "its header stamps never change; times of receipt are used"
            about.append((name, f"{name}: {line}"))
        if damaged:
            about.append((name, f"{name}: {len(damaged)} messages are damaged and left out"))
        fields = np.asarray(values).reshape(-1, len(_FIELDS[kind])).T
        fields = dict(zip(_FIELDS[kind], fields, strict=True))
        streams.append(Stream(name, headers, fields, _UNITS))
    for vector in _VECTORS[_IMU]:
        names = [f"{vector}.{axis}" for axis in AXES]
        imus = [stream for stream in streams if {*names} <= {*stream.fields}]
        zeros = [
            imu for imu in imus if len(imu.stamps) and not any(imu.fields[n].any() for n in names)
        ]
        for stream in zeros if len(zeros) < len(imus) else ():
            for name in names:
                del stream.fields[name]
            line = f"{stream.name}: {', '.join(names)} are all zero, so not measured"
            about.append((stream.name, line))
    return streams, about
