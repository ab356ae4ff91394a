"""ArduPilot DataFlash logs, binary: the inertial messages, each instance a stream."""

import re

import numpy as np

from imuloop.core.errors import RejectedLog
from imuloop.ingest.spellings import AXES
from imuloop.ingest.streams import AUTOPILOT, Stream, names_in, raw_log, sensor_fields

# IMU is at the rate of the main loop, ACC and GYR are as sampled, IMT are increments; in older logs
# a message has the number of the sensor at its end
_INERTIAL = r"(IMU|ACC|GYR|IMT)\d?"
# fields of time stamps, and their unit in us; the field with the time of the sample comes first
_STAMPS = {"SampleUS": 1, "TimeUS": 1, "TimeMS": 1000}
# quantity to the fields of its increments, without the axis, and of their interval in s
_INCREMENTS = {"acceleration": ("DelV", "DelvT"), "angular_rate": ("DelA", "DelaT")}
# type of a field for each letter of a message's format; numbers of a letter in `_SCALES` are
# divided by the scale there
_CODES = {
    **{"b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "q": "<i8"},
    **{"Q": "<u8", "g": "<f2", "f": "<f4", "d": "<f8", "M": "i1", "n": "S4", "N": "S16"},
    **{"Z": "S64", "a": "S64", "c": "<i2", "C": "<u2", "e": "<i4", "E": "<u4", "L": "<i4"},
}
_SCALES = dict.fromkeys("cCeE", 100.0) | {"L": 1e7}
# header of a binary message; a message counts if the next one, or the end of the file, follows
_HEAD, _END = b"\xa3\x95", rb"(?=\xa3\x95|\xa3?\Z)"
# the message that defines another: its number and size, name, format and names of its fields
_FORMAT = re.compile(rb"(?s)\xa3\x95\x80(.)(.)(.{4})(.{16})(.{64})" + _END)
# an instance with a smaller share of its message's rows is damage, not a sensor
_LEAST_SHARE = 0.01


def read(paths, columns=None):
    """Return the RawLog of an ArduPilot DataFlash log, the log as it was read.

    ``paths["log"]`` is the path of the file. `columns` are the declared columns by quantity, or
    None: each is a stream or ``STREAM.FIELD``; they may be of messages other than IMU, ACC, GYR and
    IMT. A stream has the rows of one kind of message of one instance (sensor), such as ``IMU_0``.
    In older logs, which have no instances, it has all rows of a message, such as ``IMU2``.
    Increments are divided by their own interval.
    """
    with open(paths["log"], "rb") as file:
        data = file.read()
    wanted = re.compile("|".join((_INERTIAL, *map(re.escape, names_in(columns)))))
    messages, damage = _messages(data, wanted)
    streams, bad = [], 0
    for name, fields in messages.items():
        instances = _streams(name, fields)
        rows = sum(len(stream.stamps) for stream in instances)
        sound = [stream for stream in instances if len(stream.stamps) >= _LEAST_SHARE * rows]
        bad += rows - sum(len(stream.stamps) for stream in sound)
        streams += sound
    note = (
        "ArduPilot logs after its own calibration; IMU after a low-pass filter, ACC and GYR before"
    )
    log = raw_log(streams, columns, [note], damage)
    log.bad_lines += bad
    return log


def _messages(data, wanted):
    """Return the fields of the messages in a log, a dict by name, and lines on damage.

    The first result has the name of each message as key, and its fields as value: arrays by name,
    as `_fields` returns them. The second result is a list of lines for the user on damage, empty
    without damage. `data` is the content of the log, bytes. Only messages are read whose whole name
    matches the pattern `wanted`.
    """
    lengths, kinds, definitions = {}, {}, {}
    for kind, size, *texts in _FORMAT.findall(data):
        name, codes, names = (text.partition(b"\0")[0].decode("latin-1") for text in texts)
        lengths.setdefault(kind, max(ord(size) - len(_HEAD) - 1, 0))
        if wanted.fullmatch(name):
            definition = ord(size), codes, names
            if definitions.setdefault(name, definition) != definition:
                raise RejectedLog(f"{name} is defined twice, with other fields: split the log")
            kinds.setdefault(name, []).append(ord(kind))
    bodies = b"|".join(re.escape(kind) + b".{%d}" % length for kind, length in lengths.items())
    pattern = re.compile(b"(?s)%b(?:%b)%b" % (_HEAD, bodies or b"(?!)", _END))
    spans = np.array([match.span() for match in pattern.finditer(data)], int).reshape(-1, 2)
    numbers = np.frombuffer(data, np.uint8)[spans[:, 0] + len(_HEAD)]
    messages = {
        name: _fields(data, spans[np.isin(numbers, kinds[name]), 0], *definition)
        for name, definition in definitions.items()
    }
    unknown = len(data) - int(np.diff(spans).sum())
    return messages, [f"{unknown} of {len(data)} bytes belong to no message"] * bool(unknown)


def _fields(data, rows, size, codes, names):
    """Return the numbers in m messages of one kind, a dict of arrays, (m,), by name of the field.

    `data` is the content of the log, bytes, and `rows` are the positions of the messages in it,
    (m,). `size`, `codes` and `names` define the kind: the number of bytes of a message, a letter
    for the type of each field, and the names of the fields. The result is empty if the definition
    contradicts itself.
    """
    names = names.split(",")
    whole = np.dtype([("", "S3"), *(("", _CODES.get(code, "S0")) for code in codes)])
    if whole.itemsize != size or len(names) != len(codes):
        return {}
    windows = np.lib.stride_tricks.sliding_window_view(np.frombuffer(data, np.uint8), size)
    table, fields = windows[rows].view(whole)[:, 0], {}
    for i, (code, name) in enumerate(zip(codes, names, strict=True), start=1):
        if (values := table[f"f{i}"]).dtype.kind != "S":
            fields[name] = values / _SCALES[code] if code in _SCALES else values
    return fields


# damaged numbers can be any, a signalling one too
@np.errstate(over="ignore", invalid="ignore")
def _streams(name, fields):
    """Return a Stream, rows with one clock, for each instance (sensor) of a message, a list.

    `name` is the name of the message, and `fields` are its numbers, (m,) by name of the field. A
    Stream also has the fields of the sensors under their usual names. The list is empty for a
    message without time stamps.
    """
    fields = {field: np.asarray(values) for field, values in fields.items()}
    clock = next((field for field in _STAMPS if field in fields), None)
    if clock is None:
        return []
    kind = np.int64 if fields[clock].dtype.kind in "iu" else float
    stamps = fields[clock].astype(kind) * _STAMPS[clock]
    if "T" in fields:
        fields["temperature"] = fields["T"]
    for quantity, (increment, interval) in _INCREMENTS.items():
        names = [f"{increment}{axis.upper()}" for axis in AXES]
        fields |= sensor_fields(quantity, fields, names, interval)
    if "I" not in fields:
        return [Stream(name, stamps, fields, AUTOPILOT)]
    streams = []
    for number in np.unique(fields["I"]):
        rows = fields["I"] == number
        values = {field: x[rows] for field, x in fields.items()}
        streams.append(Stream(f"{name}_{number:g}", stamps[rows], values, AUTOPILOT))
    return streams
