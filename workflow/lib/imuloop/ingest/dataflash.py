"""ArduPilot DataFlash logs, binary or text: the inertial messages, each instance a stream."""

import re
import struct
from array import array

import numpy as np

from imuloop.core.errors import RejectedLog, plural
from imuloop.ingest.damage import reject_damage
from imuloop.ingest.spellings import AXES
from imuloop.ingest.streams import Stream, raw_log, stream_names

# text logs end in .log as other tables do: format: dataflash tells them
ENDINGS = (".bin",)

_UNITS = {"time": "us", "acceleration": "m/s^2", "angular_rate": "rad/s", "temperature": "degC"}
# at the rate of the main loop; as sampled; increments. Older logs number the sensor.
_INERTIAL = re.compile(r"(IMU|ACC|GYR|IMT)\d?")
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
_TEXTS = "nNZa"
# header of a binary message, then its number; the message that defines the others, its length
_HEAD, _FORMAT, _FORMAT_LENGTH = b"\xa3\x95", 0x80, 89
# an instance with a smaller share of its message's rows is damage, not a sensor
_LEAST_SHARE = 0.01


@reject_damage
def read(paths, columns=None):
    """Read a DataFlash log.

    The streams are messages with their instance, ``IMU_0``; in older logs without instances
    messages, ``IMU2``. `columns` names streams, or ``STREAM.FIELD``, of messages other than IMU,
    ACC, GYR and IMT too. Increments become rates by their own interval.
    """
    with open(paths["log"], "rb") as file:
        data = file.read()
    declared = {re.sub(r"_\d+\Z", "", name) for name in stream_names(columns)}

    def wanted(name):
        return name in declared or _INERTIAL.fullmatch(name)

    head = data[:4096]
    if _HEAD not in head and b"FMT," not in head:
        raise RejectedLog("the file is no DataFlash log")
    messages, bad, damage = (_binary if _HEAD in head else _text)(data, wanted)
    streams = []
    for name, fields in messages.items():
        parts = _streams(name, fields)
        rows = sum(len(part.stamps) for part in parts)
        sound = [part for part in parts if len(part.stamps) >= _LEAST_SHARE * rows]
        streams += sound
        bad += rows - sum(len(part.stamps) for part in sound)
    if not streams:
        raise RejectedLog("the log holds no rows of IMU, ACC, GYR or IMT")
    note = (
        "ArduPilot logs after its own calibration; IMU after a low-pass filter, ACC and GYR before"
    )
    lost = damage or ([f"{plural(bad, 'row')} cannot be read"] if bad else [])
    raw = raw_log(streams, columns, [*damage, note], lost)
    raw.bad_lines = bad
    return raw


def _rows(messages, definition, kind="q"):
    """Return where the rows of a message go; one that is defined twice, otherwise, is refused."""
    name = definition[0]
    known, rows = messages.setdefault(name, (definition, array(kind)))
    if known != definition:
        raise RejectedLog(f"{name} is defined twice, with other fields: the log is of two kinds")
    return rows


def _binary(data, wanted):
    """Return the wanted messages' fields by name, the rows that cannot be read, and the damage.

    A message counts where the next one or the end of the file follows it.
    """
    kinds, messages = {_FORMAT: (_FORMAT_LENGTH, None)}, {}
    at = known = 0
    while (at := data.find(_HEAD, at)) >= 0 and at + 3 <= len(data):
        length, rows = kinds.get(data[at + 2], (0, None))
        end = at + length
        if not length or end > len(data) or not _HEAD.startswith(data[end : end + 2]):
            at += 1
            continue
        if rows is not None:
            rows.append(at)
        elif data[at + 2] == _FORMAT:
            kind, size, *texts = struct.unpack("<BB4s16s64s", data[at + 3 : end])
            texts = [text.partition(b"\0")[0].decode("latin-1") for text in texts]
            if kind != _FORMAT:
                rows = _rows(messages, (*texts, size)) if wanted(texts[0]) else None
                kinds[kind] = size, rows
        known += length
        at = end
    read, bad = {}, 0
    for name, ((_, codes, names, size), rows) in messages.items():
        read[name] = _fields(data, np.asarray(rows), codes, names.split(","), size)
        bad += 0 if read[name] else len(rows)
    unknown = len(data) - known
    return read, bad, [f"{unknown} of {len(data)} bytes are no message"] if unknown else []


def _fields(data, rows, codes, names, size):
    """Return name -> numbers of the messages at `rows`; empty where their definition is broken."""
    kinds = [("", _CODES.get(code, "S0")) for code in codes]
    whole = np.dtype([("", "S3"), *kinds])
    if whole.itemsize != size or len(names) != len(kinds):
        return {}
    windows = np.lib.stride_tricks.sliding_window_view(np.frombuffer(data, np.uint8), size)
    table = windows[rows].view(whole)[:, 0]
    numbers = [(i, *each) for i, each in enumerate(zip(codes, names, strict=True), start=1)]
    return {
        name: table[f"f{i}"] / _SCALES[code] if code in _SCALES else table[f"f{i}"]
        for i, code, name in numbers
        if code in _CODES and code not in _TEXTS
    }


def _text(data, wanted):
    """Return the wanted messages' fields by name, the rows that cannot be read, and no damage."""
    formats, messages = {}, {}
    *lines, rest = data.split(b"\n")
    # where the log was cut off, nobody knows whether its last number is whole
    bad = int(bool(rest.strip()))
    for line in lines:
        name, *values = (value.strip() for value in line.decode(errors="replace").split(","))
        if name == "FMT" and len(values) > 4 and wanted(values[2]):
            formats[values[2]] = values[3], values[4:], _rows(messages, (*values[2:],), "d")
        elif name in formats:
            codes, names, rows = formats[name]
            try:
                rows.extend(
                    [
                        np.nan if code in _TEXTS else float(value)
                        for code, value, _ in zip(codes, values, names, strict=True)
                    ]
                )
            except ValueError:
                bad += 1
    read = {}
    for name, (_, names, rows) in formats.items():
        columns = np.asarray(rows).reshape(-1, len(names)).T
        read[name] = dict(zip(names, columns, strict=True))
    return read, bad, []


# damaged numbers can be any, a signalling one too
@np.errstate(over="ignore", invalid="ignore")
def _streams(name, fields):
    """Return the streams of a message, one an instance, with the sensors' usual names."""
    stamp = next((stamp for stamp in _STAMPS if stamp in fields), None)
    if stamp is None:
        return []
    stamps = fields[stamp]
    # text was read as float64, exact to 2^53 us
    stamps = (stamps.astype(np.int64) if stamps.dtype.kind in "iu" else stamps) * _STAMPS[stamp]
    fields = dict(fields)
    if "T" in fields:
        fields["temperature"] = fields["T"]
    for quantity, (increment, interval) in _INCREMENTS.items():
        if interval in fields and all(f"{increment}{axis.upper()}" in fields for axis in AXES):
            dt = np.where(fields[interval] > 0, fields[interval], np.nan).astype(float)
            for axis in AXES:
                fields[f"{quantity}.{axis}"] = fields[f"{increment}{axis.upper()}"] / dt
    if "I" not in fields:
        return [Stream(name, stamps, fields, _UNITS)]
    here = {f"{name}_{i:g}": fields["I"] == i for i in np.unique(fields["I"])}
    return [
        Stream(each, stamps[rows], {key: x[rows] for key, x in fields.items()}, _UNITS)
        for each, rows in here.items()
    ]
