"""ArduPilot DataFlash logs, binary or text: the inertial messages, each instance a stream."""

import re
import struct
from array import array

import numpy as np

from imuloop.core.errors import RejectedLog, plural
from imuloop.ingest.columns import AXES
from imuloop.ingest.guarded import guarded
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
# header of a binary message, then its number; the message that defines the others, its length
_HEAD, _FORMAT, _FORMAT_LENGTH = b"\xa3\x95", 0x80, 89
# an instance with a smaller share of its message's rows is damage, not a sensor
_LEAST_SHARE = 0.01


@guarded
def read(paths, columns=None, batch_rows=1 << 16, most=-1):
    """Read a DataFlash log.

    The streams are messages with their instance, ``IMU_0``; in older logs without instances
    messages, ``IMU2``. `columns` names streams, or ``STREAM.FIELD``, of messages other than IMU,
    ACC, GYR and IMT too. Increments become rates by their own interval.
    """
    # a library that few need
    from pymavlink import DFReader as library

    with open(paths["log"], "rb") as file:
        data = file.read(most)
    declared = {re.sub(r"_\d+\Z", "", name) for name in stream_names(columns)}

    def wanted(name):
        return name in declared or _INERTIAL.fullmatch(name)

    head = data[:4096]
    if _HEAD not in head and b"FMT," not in head:
        raise RejectedLog("the file is no DataFlash log")
    messages, bad, damage = (_binary if _HEAD in head else _text)(library, data, wanted)
    streams = []
    for name, fields in messages.items():
        parts = _streams(name, fields)
        rows = sum(len(part.stamps) for part in parts)
        for part in parts:
            if len(part.stamps) >= _LEAST_SHARE * rows:
                streams.append(part)
            else:
                bad += len(part.stamps)
    if not streams:
        raise RejectedLog("the log holds no rows of IMU, ACC, GYR or IMT")
    notes = [
        *damage,
        "ArduPilot logs after its own calibration; IMU after a low-pass filter, ACC and GYR before",
    ]
    damage = damage or ([f"{plural(bad, 'row')} cannot be read"] if bad else [])
    raw = raw_log(streams, columns, batch_rows, notes, damage)
    raw.bad_lines = bad
    return raw


def _rows(messages, definition, kind="q"):
    """Return where the rows of a message go; one that is defined twice, otherwise, is refused."""
    name = definition[0]
    known, rows = messages.setdefault(name, (definition, array(kind)))
    if known != definition:
        raise RejectedLog(f"{name} is defined twice, with other fields: the log is of two kinds")
    return rows


def _binary(library, data, wanted):
    """Return the wanted messages' fields by name, the rows that cannot be read, and the damage.

    A message counts where the next one or the end of the file follows it. (The library's own
    index ends at the first message that it does not know, as damage makes them.)
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
            definition = (*(library.null_term(text) for text in texts), size)
            if kind != _FORMAT:
                rows = _rows(messages, definition) if wanted(definition[0]) else None
                kinds[kind] = size, rows
        known += length
        at = end
    read, bad = {}, 0
    for name, ((_, codes, names, size), rows) in messages.items():
        read[name] = _fields(library, data, np.asarray(rows), codes, names.split(","), size)
        bad += 0 if read[name] else len(rows)
    unknown = len(data) - known
    return read, bad, [f"{unknown} of {len(data)} bytes are no message"] if unknown else []


def _fields(library, data, rows, codes, names, size):
    """Return name -> numbers of the messages at `rows`; empty where their definition is broken."""
    kinds = [library.FORMAT_TO_STRUCT.get(code, ("0s", None, None)) for code in codes]
    parts = [f"S{s[:-1]}" if s.endswith("s") else f"<{s}" for s, _, _ in kinds]
    whole = np.dtype([("", "S3"), *(("", part) for part in parts)])
    if whole.itemsize != size or len(names) != len(kinds):
        return {}
    windows = np.lib.stride_tricks.sliding_window_view(np.frombuffer(data, np.uint8), size)
    table = windows[rows].view(whole)[:, 0]
    # the library divides as well, which rounds once
    return {
        name: table[f"f{i}"] / (1 / scale) if scale else table[f"f{i}"]
        for i, (name, (_, scale, kind)) in enumerate(zip(names, kinds, strict=True), start=1)
        if kind in (int, float)
    }


def _text(library, data, wanted):
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
                numbers = [
                    np.nan if library.FORMAT_TO_STRUCT[code][2] is str else float(value)
                    for code, value, _ in zip(codes, values, names, strict=True)
                ]
            except (ValueError, KeyError):
                bad += 1
            else:
                rows.extend(numbers)
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
    return [
        Stream(
            f"{name}_{instance:g}",
            stamps[here],
            {key: x[here] for key, x in fields.items()},
            _UNITS,
        )
        for instance in np.unique(fields["I"])
        for here in [fields["I"] == instance]
    ]
