"""Mutations by the structure of each format: records, lengths, counts, kinds, names, tables."""

import re
import sqlite3
import struct
import zlib

from bench.fuzz.bytewise import extreme, mutate

# where fields of fixed size stand, in each file as it lies there
MARKS = {
    ".zip": rb"PK\x01\x02|PK\x03\x04|PK\x05\x06",
    ".mat": rb"\x89HDF|TREE|HEAP|SNOD|MATLAB_class|MATLAB 5|[\x0e\x0f]\0\0\0",
    ".nc": rb"\x89HDF|TREE|HEAP|SNOD|OHDR|FRHP|CDF|\0\0\0[\x0a-\x0c]",
    ".parquet": rb"PAR1|.{4}PAR1$|schema",
    ".bag": rb"(op|conn|count|size|time|type|topic|ver|md5sum|(chunk|index)_pos|compression)=",
    ".mcap": rb"\x89MCAP0|[\x01-\x0f].\0\0\0\0\0\0\0|cdr|ros2msg|sensor_msgs",
    ".db3": rb"SQLite format|\r\0\0\0|\x05\0\0\0|CREATE",
    ".bin": rb"\xa3\x95",
    ".ulg": rb"ULog|sensor_combined|float",
    ".gz": rb"\x1f\x8b",
}
TYPES = b"int8_t uint8_t int16_t uint16_t int32_t uint32_t int64_t uint64_t float double bool char"
ULOG = [*TYPES.split(), b"[3]", b"[0]", b"[-1]", b"[999999999]", b"timestamp", b"sensor_combined"]
ULOG += [b"sensor_accel", b"sensor_gyro_fifo", b"vehicle_imu", b";", b":", b" ", b"x", b"PX4"]
DATAFLASH = [b"QBffffff", b"BBnNZ", b"IMU", b"FMT", b"GYR", b"ACC", b"IMT", b"TimeUS", b"I,", b","]
DATAFLASH += [bytes([letter]) * 8 for letter in b"abBhHiIfdnNZcCeELMqQ?"] + [b"UNIT", b"\0"]
STATEMENTS = [
    f"UPDATE {table} SET {column} = {value} WHERE rowid % {every} = 0"
    for table, columns in {
        "topics": ("id", "name", "type", "serialization_format", "offered_qos_profiles"),
        "messages": ("id", "topic_id", "timestamp", "data"),
    }.items()
    for column in columns
    for value in (
        *("NULL", "-1", "9223372036854775807", "1.5", "'x'", "''", "zeroblob(0)", "zeroblob(9999)"),
        *(f"substr({column}, 1, 20)", f"{column} || x'00ff'", f"{column} + 1", "'../x'", "2"),
        *("'sensor_msgs/msg/Temperature'", "'geometry_msgs/msg/Vector3Stamped'", "x'00010000'"),
    )
    for every in (1, 1, 7)
]
STATEMENTS += [f"DROP TABLE {table}" for table in ("topics", "messages")]
STATEMENTS += [
    f"DELETE FROM {table} WHERE rowid % {every} = 0"
    for table in ("topics", "messages")
    for every in (1, 3)
]
# instead of the messages, rows for ever, and a search for ever
ENDLESS = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT"
STATEMENTS += [
    f"ALTER TABLE messages RENAME TO m; CREATE VIEW messages AS {ENDLESS} {columns}"
    for columns in ("x AS id, 1 AS topic_id, x AS timestamp, x'' AS data FROM c", "* FROM m, c")
    for _ in range(3)
]


def restructure(rng, name, content):
    """Return content with a few fields changed, where its format is known."""
    if name.endswith(".ulg"):
        return ulog(rng, content)
    if name.endswith(".bin") and content.startswith(b"\xa3"):
        return dataflash(rng, content)
    if name.endswith(".mat") and b"HDF" not in content[:600] and content[126:128] == b"IM":
        return content[:128] + matlab(rng, content[128:])
    if name.endswith(".db3") and rng.random() < 0.7:
        return sqlite(rng, content)
    return fields(rng, content, MARKS.get(name[name.rfind(".") :], rb"\n"))


def fields(rng, content, marks):
    """Return content with numbers written near some of its marks."""
    data = bytearray(content)
    found = [match.start() for match in re.finditer(marks, content, re.DOTALL)] or [0]
    for _ in range(rng.choice([1, 1, 2, 4])):
        extreme(rng, data, rng.choice(found) + rng.randrange(48))
    return bytes(data)


def records(rng, kept, kinds, words=()):
    """Change a few of the records, lists of kind and body."""
    for _ in range(rng.choice([1, 1, 2, 4])):
        # those at the begin are those that describe
        at = min(rng.randrange(len(kept) + 1), rng.choice([5, len(kept)]), len(kept) - 1)
        if at < 0:
            return
        way, body = rng.randrange(8), kept[at][1]
        if way == 0:
            del kept[at]
        elif way == 1:
            kept[at:at] = [list(kept[at]) for _ in range(rng.choice([1, 3, 100]))]
        elif way == 2:
            kept.insert(rng.randrange(len(kept)), kept.pop(at))
        elif way == 3:
            kept[at][0] = rng.choice(kinds)
        elif way == 4:
            kept[at][1] = rng.choice(kept)[1]
        elif way == 5:
            kept[at][1] = mutate(rng, body, False, [("", body)]) if body else b"x"
        elif way == 6 and body:
            data = bytearray(body)
            extreme(rng, data, rng.randrange(len(data)))
            kept[at][1] = bytes(data[: len(body)])
        elif words:
            known = [match for word in words for match in re.finditer(re.escape(word), body)]
            if known:
                old, new = rng.choice(known), rng.choice(words)
                kept[at][1] = body[: old.start()] + new + body[old.end() :]


def said(rng, size):
    """Return a record's size, or now and then another."""
    return size if rng.random() < 0.97 else rng.choice([0, 1, size + 1, size - 1, 65535, 2**31 - 1])


def ulog(rng, content):
    kept, at = [], 16
    while at + 3 <= len(content):
        size, kind = struct.unpack_from("<HB", content, at)
        kept.append([kind, content[at + 3 : at + 3 + size]])
        at += 3 + size
    records(rng, kept, b"BFIMPQARDLCSO\0", ULOG)
    heads = (struct.pack("<HB", said(rng, len(body)) % 65536, kind) for kind, body in kept)
    return content[:16] + b"".join(h + body for h, (_, body) in zip(heads, kept, strict=True))


def dataflash(rng, content):
    kept, at, sizes = [], 0, {128: 89, 144: 36}
    while at + 3 <= len(content):
        kind = content[at + 2]
        kept.append([kind, content[at + 3 : at + sizes[kind]]])
        at += sizes[kind]
    records(rng, kept, [128, 144, 0, 255, 145], DATAFLASH)
    return b"".join(bytes([0xA3, 0x95, kind]) + body for kind, body in kept)


def matlab(rng, content):
    """Return elements of version 5 with one of them changed, packed or nested ones too."""
    kept, at = [], 0
    while at + 8 <= len(content):
        kind, size = struct.unpack_from("<II", content, at)
        if kind >> 16:
            kept.append([kind & 0xFFFF, content[at + 4 : at + 4 + (kind >> 16)]])
            at += 8
        else:
            kept.append([kind, content[at + 8 : at + 8 + size]])
            at += 8 + size + (-size % 8 if kind != 15 else 0)
    inner = [each for each in kept if each[0] in (14, 15)]
    if inner and rng.random() < 0.8:
        each = rng.choice(inner)
        if each[0] == 15:
            each[1] = zlib.compress(matlab(rng, zlib.decompress(each[1])), 1)
        else:
            each[1] = matlab(rng, each[1])
    else:
        records(rng, kept, [*range(20), 2**31, 0xFFFFFFFF])
    written = b""
    for kind, body in kept:
        written += struct.pack("<II", kind, max(0, said(rng, len(body)))) + body
        written += bytes(-len(body) % 8 if kind != 15 else 0)
    return written


def sqlite(rng, content):
    with sqlite3.connect(":memory:") as store:
        store.deserialize(content)
        for _ in range(rng.choice([1, 1, 2])):
            try:
                store.executescript(rng.choice(STATEMENTS))
            except sqlite3.Error:
                break
        changed = store.serialize()
    store.close()
    return changed
