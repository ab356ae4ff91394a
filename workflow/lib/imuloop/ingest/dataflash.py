"""ArduPilot DataFlash logs, binary: the inertial messages, each instance a stream."""

import re

import numpy as np

from imuloop.core.errors import RejectedLog, plural
from imuloop.ingest.spellings import AXES
from imuloop.ingest.streams import AUTOPILOT, Stream, names_in, rates, raw_log

# at the rate of the main loop; as sampled; increments. Older logs number the sensor.
_INERTIAL = r"(IMU|ACC|GYR|IMT)\d?"
# stamps to microseconds; a sample's own goes first
_STAMPS = {"SampleUS": 1, "TimeUS": 1, "TimeMS": 1000}
# usual name to increments over their interval in s
_INCREMENTS = {"acceleration": ("DelV", "DelvT"), "angular_rate": ("DelA", "DelaT")}
# what each letter of a message's format is; in `_SCALES` by how much its numbers are divided
_CODES = {
    **{"b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "q": "<i8"},
    **{"Q": "<u8", "g": "<f2", "f": "<f4", "d": "<f8", "M": "i1", "n": "S4", "N": "S16"},
    **{"Z": "S64", "a": "S64", "c": "<i2", "C": "<u2", "e": "<i4", "E": "<u4", "L": "<i4"},
}
_SCALES = {"c": 100.0, "C": 100.0, "e": 100.0, "E": 100.0, "L": 1e7}
# header of a binary message; a message counts where the next one, or the end of the file, follows
_HEAD, _END = b"\xa3\x95", rb"(?=\xa3\x95|\xa3?\Z)"
# the message that defines another: its number and size, name, format and names of its fields
_FORMAT = re.compile(rb"(?s)\xa3\x95\x80(.)(.)(.{4})(.{16})(.{64})" + _END)
# an instance with a smaller share of its message's rows is damage, not a sensor
_LEAST_SHARE = 0.01


def read(paths, columns=None):
    """Read a DataFlash log.

    The streams are messages with their instance, ``IMU_0``, or messages, ``IMU2``, in older logs
    without instances. `columns` names streams or ``STREAM.FIELD``, also of messages other than IMU,
    ACC, GYR and IMT. Increments become rates by their own interval.
    """
    with open(paths["log"], "rb") as file:
        data = file.read()
    wanted = re.compile("|".join((_INERTIAL, *map(re.escape, names_in(columns)))))
    messages, damage = _messages(data, wanted)
    streams, bad = [], 0
    for name, fields in messages.items():
        found = _streams(name, fields)
        rows = sum(len(stream.stamps) for stream in found)
        sound = [stream for stream in found if len(stream.stamps) >= _LEAST_SHARE * rows]
        bad += rows - sum(len(stream.stamps) for stream in sound)
        streams += sound
    if not streams:
        raise RejectedLog("the log holds no rows of IMU, ACC, GYR or IMT")
    note = (
        "ArduPilot logs after its own calibration; IMU after a low-pass filter, ACC and GYR before"
    )
    lost = damage or [f"{plural(bad, 'row')} cannot be read"] * bool(bad)
    log = raw_log(streams, columns, [*damage, note], lost)
    log.bad_lines += bad
    return log


def _messages(data, wanted):
    """Return name -> fields of the messages whose names match a pattern, and lines on damage."""
    lengths, kinds, known = {}, {}, {}
    for kind, size, *texts in _FORMAT.findall(data):
        name, *texts = (text.partition(b"\0")[0].decode("latin-1") for text in texts)
        lengths.setdefault(kind, max(ord(size) - len(_HEAD) - 1, 0))
        if wanted.fullmatch(name):
            definition = ord(size), *texts
            if known.setdefault(name, definition) != definition:
                why = "with other fields: the log is of two kinds"
                raise RejectedLog(f"{name} is defined twice, {why}")
            kinds.setdefault(name, []).append(ord(kind))
    each = b"|".join(re.escape(kind) + b".{%d}" % length for kind, length in lengths.items())
    pattern = re.compile(b"(?s)%b(?:%b)%b" % (_HEAD, each or b"(?!)", _END))
    spans = np.array([match.span() for match in pattern.finditer(data)], int).reshape(-1, 2)
    found = np.frombuffer(data, np.uint8)[spans[:, 0] + len(_HEAD)]
    messages, unknown = {}, len(data) - int(np.diff(spans).sum())
    for name, definition in known.items():
        rows = spans[np.isin(found, kinds[name]), 0]
        messages[name] = _fields(data, rows, *definition)
    return messages, [f"{unknown} of {len(data)} bytes belong to no message"] * bool(unknown)


def _fields(data, rows, size, codes, names):
    """Return name -> numbers of the messages at `rows`; empty where their definition is broken."""
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
    """Return the streams of a message, one an instance, with the sensors' usual names."""
    fields = {field: np.asarray(values) for field, values in fields.items()}
    clock = next((field for field in _STAMPS if field in fields), None)
    if clock is None:
        return []
    kind = np.int64 if fields[clock].dtype.kind in "iu" else float
    stamps = fields[clock].astype(kind) * _STAMPS[clock]
    if "T" in fields:
        fields["temperature"] = fields["T"]
    for quantity, (increment, interval) in _INCREMENTS.items():
        names = {f"{quantity}.{axis}": f"{increment}{axis.upper()}" for axis in AXES}
        if {interval, *names.values()} <= {*fields}:
            fields |= {usual: rates(fields[x], fields[interval]) for usual, x in names.items()}
    if "I" not in fields:
        return [Stream(name, stamps, fields, AUTOPILOT)]
    instances = {f"{name}_{i:g}": fields["I"] == i for i in np.unique(fields["I"])}
    return [
        Stream(each, stamps[rows], {key: x[rows] for key, x in fields.items()}, AUTOPILOT)
        for each, rows in instances.items()
    ]
