"""ROS 1 bags, ROS 2 bags and MCAP files: the topics of inertial messages, each a stream."""

import bz2
from array import array
from contextlib import contextmanager
from functools import partial
from io import BytesIO
from operator import attrgetter
from pathlib import Path, PurePath
from types import SimpleNamespace

import numpy as np

from imuloop.core.errors import RejectedLog
from imuloop.ingest.columns import AXES
from imuloop.ingest.damage import blamed_for_loss
from imuloop.ingest.extras import needed
from imuloop.ingest.packed import MOST_HELD, MOST_TIMES, check_unpacked
from imuloop.ingest.streams import Stream, raw_log

ENDINGS = (".bag", ".db3", ".mcap")

# vectors, or numbers, of each type of message that is read; other types are passed over
_IMU = "sensor_msgs/msg/Imu"
_VECTORS = {
    _IMU: ("linear_acceleration", "angular_velocity"),
    "geometry_msgs/msg/Vector3Stamped": ("vector",),
    "geometry_msgs/msg/AccelStamped": ("accel.linear", "accel.angular"),
    "geometry_msgs/msg/TwistStamped": ("twist.linear", "twist.angular"),
}
_FIELDS = {
    **{k: [f"{v}.{axis}" for v in vectors for axis in AXES] for k, vectors in _VECTORS.items()},
    "sensor_msgs/msg/Temperature": ["temperature"],
}
# as ROS defines its messages
_UNITS = {"time": "ns", "acceleration": "m/s^2", "angular_rate": "rad/s", "temperature": "degC"}

# first bytes of a file, and what mends one that was cut off
_BAG, _SQLITE, _MCAP = b"#ROSBAG", b"SQLite format 3\0", b"\x89MCAP0\r\n"
_MENDED_BY = {_BAG: "rosbag reindex", _SQLITE: "sqlite3 with .recover", _MCAP: "mcap recover"}
_ZSTD = b"\x28\xb5\x2f\xfd"
# tables of a bag that compute what they hold: a file of 10 kB can give a row of 1 GB, or no end
_COMPUTED = """
    SELECT 1 FROM sqlite_master AS held
    LEFT JOIN pragma_table_xinfo(held.name) AS part ON part.hidden > 1
    WHERE held.name IN ('messages', 'topics', 'schema', 'message_definitions') AND (
        held.type = 'view' OR part.name IS NOT NULL OR held.sql LIKE 'CREATE VIRTUAL%')
"""


def read(paths, columns=None, batch_rows=1 << 16, most=-1):
    """Read the topics of inertial messages of a bag.

    The stamps are those of the headers in ns; where a topic's never change, the times of receipt.

    Parameters
    ----------
    paths : dict
        ``{"log": path}``: a ``.bag``, ``.db3`` or ``.mcap`` file, or the folder of a ROS 2 bag.
    columns : dict, optional
        Quantity to a topic, or to ``TOPIC.FIELD``; see `imuloop.ingest.streams.raw_log`.
    batch_rows : int
        Rows given at once.
    most : int
        Bytes read of each file's messages, where only their names count; -1 is all.

    Raises
    ------
    ImuloopError
        If a declared topic is not there, or a quantity is in no topic or in several.
    RejectedLog
        If it is no bag, or not a whole one.
    """
    needed("rosbags.typesys", "ros")
    files, notes = _files(Path(paths["log"]))
    topics, damage = {}, []
    for path in files:
        for beside in (Path(f"{path}{end}") for end in ("-wal", "-journal")):
            if beside.is_file() and beside.stat().st_size:
                damage.append(
                    f"{beside.name} holds what SQLite had not yet written; it is not read"
                )
        _gather(_File(path), topics, damage, most)
    _leave_out_zeros(list(topics.values()))
    with blamed_for_loss(damage):
        log = raw_log([topic.stream() for topic in topics.values()], columns, batch_rows)
    notes += damage
    found = [name for each in log.found.values() for name in np.atleast_1d(each)]
    for topic in topics.values():
        if any(name.startswith(f"{topic.name}.") for name in found):
            notes += topic.notes()
    log.notes[:0] = notes
    return log


class _Topic:
    """The messages of a topic so far: stamps, times of receipt, values row by row."""

    def __init__(self, connection):
        self.name, self.type = connection.topic, connection.msgtype
        self.names = _FIELDS[self.type]
        self.numbers = attrgetter("header.stamp.sec", "header.stamp.nanosec", *self.names)
        self.stamps, self.received, self.values = array("q"), array("q"), array("d")
        self.damaged = 0
        self.left_out = []

    def add(self, received, message):
        """Add a message; None is one that cannot be read, a row without values."""
        if message is None:
            self.damaged += 1
            self.stamps.append(self.stamps[-1] if self.stamps else received)
            self.values.extend([np.nan] * len(self.names))
        else:
            seconds, nanoseconds, *values = self.numbers(message)
            self.stamps.append(seconds * 10**9 + nanoseconds)
            self.values.extend(values)
        self.received.append(received)

    def fields(self):
        """Return name -> values of the fields that are measured."""
        rows = np.asarray(self.values).reshape(-1, len(self.names))
        return {n: x for n, x in zip(self.names, rows.T, strict=True) if n not in self.left_out}

    def unstamped(self):
        """Tell whether the headers hold no time."""
        return len(self.stamps) > 1 and np.ptp(np.asarray(self.stamps)) == 0

    def stream(self):
        stamps = self.received if self.unstamped() else self.stamps
        return Stream(self.name, np.asarray(stamps), self.fields(), _UNITS)

    def notes(self):
        """Return what a user should know of how the topic was read."""
        found = []
        if self.unstamped():
            found.append(f"{self.name}: its header stamps never change; times of receipt are used")
        if self.damaged:
            found.append(f"{self.name}: {self.damaged} messages are damaged, rows without values")
        if self.left_out:
            found.append(f"{self.name}: {', '.join(self.left_out)} are all zero, so not measured")
        return found


def _leave_out_zeros(topics):
    """Leave out a sensor that one Imu topic holds as zeros while another measures it.

    Drivers of two chips publish each in a message that has room for both.
    """
    messages = [topic for topic in topics if topic.type == _IMU and topic.stamps]
    for vector in _VECTORS[_IMU]:
        names = [f"{vector}.{axis}" for axis in AXES]
        measured = [t for t in messages if any(t.fields()[name].any() for name in names)]
        for topic in messages if measured else ():
            if topic not in measured:
                topic.left_out += names


def _files(path):
    """Return the files of a bag, in the order of recording, and what is to be noted."""
    if not path.is_dir():
        return [path], []
    metadata = path / "metadata.yaml"
    if metadata.is_file():
        # bags with metadata alone need it
        import yaml

        try:
            loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
            content = yaml.load(metadata.read_text(), loader)["rosbag2_bagfile_information"]
            names = dict.fromkeys(PurePath(name).name for name in content["relative_file_paths"])
        except Exception as error:
            raise RejectedLog("metadata.yaml does not say which files the bag has") from error
        for name in names:
            if not (path / name).is_file():
                raise RejectedLog(f"{name} is missing from the bag; its metadata.yaml lists it")
        return [path / name for name in names], []
    found = [p for p in path.iterdir() if p.name.removesuffix(".zstd").endswith(ENDINGS)]
    # bag_2 before bag_10
    found = sorted((p for p in found if p.is_file()), key=lambda p: (len(p.name), p.name))
    if not found:
        raise RejectedLog(f"the folder holds no bag: no metadata.yaml, no {', '.join(ENDINGS)}")
    if len({p.suffix for p in found}) > 1:
        raise RejectedLog("the folder holds bags of several kinds, no metadata.yaml; name a file")
    return found, ["the folder has no metadata.yaml: all its bags are read, in the order of names"]


class _File:
    """A file as the library opens it, and how much came out of it so far.

    Its name matters nowhere: the library builds SQLite's address of it, and trips over a '#'.
    """

    def __init__(self, path):
        self.path, self.unpacked = path, None
        self.packed = self.size = path.stat().st_size
        self.out = 0
        self.head = self._head()
        if self.head.startswith(_ZSTD):
            self.unpacked = self.inflate("zstd", path.read_bytes())
            self.size, self.head = len(self.unpacked), self._head()

    def _head(self):
        with self.open("rb") as file:
            return file.read(16)

    def open(self, mode):
        return self.path.open(mode) if self.unpacked is None else BytesIO(self.unpacked)

    def exists(self):
        return True

    def stat(self):
        return SimpleNamespace(st_size=self.size)

    def __str__(self):
        return "bag"

    def take(self, data):
        """Return data that came out of the file, as long as it is plausible."""
        self.out += len(data)
        check_unpacked(self.packed, self.out)
        return data

    def inflate(self, packing, data, *_):
        """Return unpacked data, or stop as soon as it is too much."""
        if packing == "bz2":
            unpacker = bz2.BZ2Decompressor()
        elif packing == "lz4":
            unpacker = needed("lz4.frame", "ros").LZ4FrameDecompressor()
        else:
            unpacker = needed("rosbags.rosbag2.storage_mcap", "ros").zstd.ZstdDecompressor()
        most = min(MOST_TIMES * self.packed - self.out, MOST_HELD) + 1
        try:
            unpacked = unpacker.decompress(data, max_length=most)
        except Exception as error:
            raise RejectedLog(f"{self.path.name} is damaged: it cannot be unpacked") from error
        check_unpacked(self.packed, len(unpacked), held=True)
        self.take(unpacked)
        if not unpacker.eof:
            raise RejectedLog(f"{self.path.name} is damaged: packed data end too early")
        return unpacked


def _gather(file, topics, damage, most):
    """Add the messages of a file to the topics, and what it lacks to the damage."""
    typesys = needed("rosbags.typesys", "ros")
    ros1 = file.head.startswith(_BAG)
    # never the definitions in the bag: the library makes them Python code and runs it
    store = typesys.get_typestore(
        typesys.Stores.ROS1_NOETIC if ros1 else typesys.Stores.ROS2_HUMBLE
    )
    parse = store.deserialize_ros1 if ros1 else store.deserialize_cdr
    try:
        with _opened(file) as reader:
            wanted = [c for c in reader.connections if c.msgtype in _FIELDS]
            for connection in wanted:
                _check_definition(connection, store, ros1)
                key = connection.topic, connection.msgtype
                topics.setdefault(key, _Topic(connection))
            left = sum(connection.msgcount for connection in wanted)
            for connection, received, data in reader.messages(wanted) if wanted else ():
                if 0 <= most < file.out:
                    return
                left -= 1
                if not ros1 and data[:4] == _ZSTD:
                    data = file.inflate("zstd", data)
                file.take(data)
                try:
                    message = parse(data, connection.msgtype)
                except Exception:
                    message = None
                topics[connection.topic, connection.msgtype].add(received, message)
            if left > 0:
                damage.append(f"{file.path.name} lacks {left} messages that its index announces")
    except RejectedLog:
        raise
    except Exception as error:
        # the library's own errors say what it found, others only that it did not expect it
        own = type(error).__name__ == "ReaderError"
        said = str(error).partition(": (")[0].strip(".")[:200] if own else "it is damaged"
        tool = next(tool for magic, tool in _MENDED_BY.items() if file.head.startswith(magic))
        raise RejectedLog(
            f"{file.path.name} is not a whole bag: {said}; copy it again, "
            f"or if its recording was cut off, mend it with {tool}"
        ) from error


def _check_definition(connection, store, ros1):
    """Reject messages that only share the name with those that ROS defines."""
    name = connection.msgtype
    usual = store.generate_msgdef(name)[1] if ros1 else store.hash_rihs01(name)
    if connection.digest not in ("", "*", usual):
        raise RejectedLog(f"{connection.topic}: its {name} is not the one that ROS defines")


@contextmanager
def _opened(file):
    """Give the library's reader of a file, told by its first bytes."""
    bag = needed("rosbags.rosbag1.reader", "ros")
    mcap = needed("rosbags.rosbag2.storage_mcap", "ros")
    if file.head.startswith(_BAG):
        reader = _bounded_bag(bag.Reader)(file)
    elif file.head.startswith(_SQLITE):
        reader = needed("rosbags.rosbag2.storage_sqlite3", "ros").Sqlite3Reader(file)
    elif file.head.startswith(_MCAP):
        reader = mcap.McapReader(file)
    else:
        raise RejectedLog(
            f"{file.path.name} is neither a ROS 1 bag nor SQLite or MCAP of a ROS 2 bag"
            if file.head
            else f"{file.path.name} is empty"
        )
    # the library inflates and queries without limit; while it reads this file, it does with one
    tables, hooks = (bag.decompressors, mcap.DECOMPRESSORS), needed("apsw", "ros").connection_hooks
    usual = [dict(table) for table in tables]
    hooks.append(partial(_bound_rows, file.size))
    try:
        for table in tables:
            packings = table.keys() & {"bz2", "lz4", "zstd"}
            table.update({packing: partial(file.inflate, packing) for packing in packings})
        reader.open()
        try:
            yield reader
        finally:
            reader.close()
    finally:
        hooks.pop()
        for table, each in zip(tables, usual, strict=True):
            table.update(each)


def _bound_rows(size, connection):
    """Keep SQLite from rows longer than the file."""
    apsw = needed("apsw", "ros")
    connection.limit(apsw.SQLITE_LIMIT_LENGTH, min(size, MOST_HELD >> 2))
    if connection.execute(_COMPUTED).fetchone():
        raise RejectedLog("the bag's tables are computed by SQL, which no recorder writes: refused")


def _bounded_bag(base):
    """Return a reader of ROS 1 bags that does not believe one index given again and again."""

    class Bag(base):
        def read_index_data(self, pos, indexes):
            super().read_index_data(pos, indexes)
            # an entry takes 12 bytes
            if 12 * sum(map(len, indexes.values())) > self.path.size:
                raise RejectedLog(f"{self.path.path.name} is damaged: its index repeats itself")

    return Bag
