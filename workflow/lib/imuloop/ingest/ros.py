"""ROS 1 bags, ROS 2 bags and MCAP files: the topics of inertial messages, each a stream."""

import tempfile
from array import array
from operator import attrgetter
from pathlib import Path

import numpy as np
import pyarrow as pa

from imuloop.ingest.damage import LONGEST_LINE, MOST_TIMES
from imuloop.ingest.formats import FORMATS
from imuloop.ingest.spellings import AXES
from imuloop.ingest.streams import Stream, raw_log

_ENDINGS, _STARTS = FORMATS["ros"].endings, FORMATS["ros"].starts
_ZSTD = b"\x28\xb5\x2f\xfd"

# fields that are vectors, for each type of message that is read; other types are not read
_VECTORS = {
    "sensor_msgs/msg/Imu": ("linear_acceleration", "angular_velocity"),
    "geometry_msgs/msg/Vector3Stamped": ("vector",),
    "geometry_msgs/msg/AccelStamped": ("accel.linear", "accel.angular"),
    "geometry_msgs/msg/TwistStamped": ("twist.linear", "twist.angular"),
}
_FIELDS = {k: [f"{v}.{axis}" for v in vectors for axis in AXES] for k, vectors in _VECTORS.items()}
_FIELDS["sensor_msgs/msg/Temperature"] = ["temperature"]
# units by the definitions of the messages of ROS
_UNITS = {"time": "ns", "acceleration": "m/s^2", "angular_rate": "rad/s", "temperature": "degC"}


def read(paths, columns=None):
    """Return the RawLog of the inertial messages in a bag of ROS, or in a folder of bags.

    ``paths["log"]`` is the path of the bag or the folder. The stamps come from the headers, in ns.
    If the stamps in the headers of a topic never change, its stamps are the times of receipt.
    `columns` are the declared columns by quantity, or None: each is a topic or ``TOPIC.FIELD``.
    """
    path, topics, notes, damage = Path(paths["log"]), {}, [], []
    bags = [path]
    if path.is_dir() and not (path / "metadata.yaml").is_file():
        # bag_2 before bag_10
        bags = sorted(path.iterdir(), key=lambda file: (len(file.name), file.name))
        bags = [file for file in bags if file.suffix in _ENDINGS and file.is_file()]
        notes.append("the folder has no metadata.yaml: all its bags are read in order of name")
    with tempfile.TemporaryDirectory() as folder:
        for number, bag in enumerate(bags):
            if missing := _gather(_link(bag, Path(folder, str(number))), topics):
                damage.append(f"{bag.name} lacks {missing} messages that its index announces")
    streams = [_stream(name, kind, *rows) for (name, kind), rows in topics.items()]
    return raw_log(streams, columns, notes, damage)


def _link(path, target):
    """Make a link to a bag of ROS under a name that the library can open; return the link's path.

    `path` is the path of the bag. The path of the link is `target` with the ending that the first
    bytes of the bag show. The library turns a path into an address, in which some names would have
    to be quoted.
    """
    if path.is_file():
        with open(path, "rb") as file:
            head = file.read(LONGEST_LINE)
        kinds = dict(zip(_STARTS, _ENDINGS, strict=True))
        target = target.with_suffix(next((kinds[x] for x in kinds if head.startswith(x)), ""))
    target.symlink_to(path.absolute())
    return target


def _gather(bag, topics):
    """Add the messages of a bag to `topics`; return how many of them are lost.

    `bag` is the path of the bag. Lost are the messages that the bag announces but does not hold.
    `topics` maps (name, type) of a topic to three sequences: its time stamps, ns, of header and
    receipt in turn; its values, row by row; and the times of receipt of unreadable messages.
    """
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    ros1 = bag.suffix == ".bag"
    # AnyReader is not used: it turns definitions of messages in the bag into Python code and runs
    # it
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    parse = store.deserialize_ros1 if ros1 else store.deserialize_cdr
    rows = {kind: attrgetter("header.stamp", *fields) for kind, fields in _FIELDS.items()}
    with (rosbag1 if ros1 else rosbag2).Reader(bag) as reader:
        wanted = [c for c in reader.connections if c.msgtype in _FIELDS]
        for connection in wanted:
            topics.setdefault((connection.topic, connection.msgtype), (array("q"), array("d"), []))
        missing = sum(connection.msgcount for connection in wanted)
        for connection, received, data in reader.messages(wanted) if wanted else ():
            missing -= 1
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
    return max(missing, 0)


def _stream(name, kind, stamps, values, damaged):
    """Return the Stream of a topic of m messages: its time stamps and its values by name.

    `name` is the name of the topic, and `kind` the type of its messages. `stamps` has for each
    message the time stamp of its header, then the time of its receipt, ns, (2 m,). `values` are the
    numbers of the messages, row by row. `damaged` has the times of receipt of unreadable messages.
    """
    headers, received = np.asarray(stamps).reshape(-1, 2).T
    values, notes = np.asarray(values).reshape(-1, len(_FIELDS[kind])).T, []
    if len(headers) > 1 and np.ptp(headers) == 0:
        headers = received
        notes.append(f"{name}: its header stamps never change; times of receipt are used")
    if damaged:
        notes.append(f"{name}: {len(damaged)} messages are damaged and left out")
    return Stream(name, headers, dict(zip(_FIELDS[kind], values, strict=True)), _UNITS, notes)
