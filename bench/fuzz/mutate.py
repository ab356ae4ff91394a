"""Mutations of files: bytes whatever they mean, and records, lengths and tables of each format."""

import re
import sqlite3
import struct
from contextlib import suppress

# what breaks numbers, texts, tables and paths
TOKENS = "nan inf -inf 1e999 -0 0x10 1_000 9223372036854775808 1e-320 é \ufeff , ; ,,,, # ' \\ {{"
TOKENS += " 2024-13-45T99:00 2024-01-01T00:00:00Z ../../x /etc/passwd <script> %PDF t ax ax.x"
TOKENS = [*TOKENS.split(), "", " ", "\t", "\r", "\n", "\0", '"']
# where fields of fixed size stand, in each file as it lies there
MARKS = {
    ".zip": rb"PK\x01\x02|PK\x03\x04|PK\x05\x06",
    ".mat": rb"\x89HDF|TREE|HEAP|SNOD|MATLAB_class|MATLAB 5|[\x0e\x0f]\0\0\0",
    ".nc": rb"\x89HDF|TREE|HEAP|SNOD|OHDR|FRHP|CDF|\0\0\0[\x0a-\x0c]",
    ".parquet": rb"PAR1|.{4}PAR1$|schema",
    ".bag": rb"(op|conn|count|size|time|type|topic|ver|md5sum|(chunk|index)_pos|compression)=",
    ".mcap": rb"\x89MCAP0|[\x01-\x0f].\0\0\0\0\0\0\0|cdr|ros2msg|sensor_msgs",
    ".db3": rb"SQLite format|\r\0\0\0|\x05\0\0\0|CREATE",
    ".gz": rb"\x1f\x8b",
}
TYPES = b"int8_t uint8_t int16_t uint16_t int32_t uint32_t int64_t uint64_t float double bool char"
ULOG = [*TYPES.split(), b"[3]", b"[0]", b"[-1]", b"[999999999]", b"timestamp", b"sensor_combined"]
ULOG += [b"sensor_accel", b"sensor_gyro_fifo", b"vehicle_imu", b";", b":", b" ", b"x", b"PX4"]
DATAFLASH = [b"QBffffff", b"BBnNZ", b"IMU", b"FMT", b"GYR", b"ACC", b"IMT", b"TimeUS", b"I,", b","]
DATAFLASH += [bytes([letter]) * 8 for letter in b"abBhHiIfdnNZcCeELMqQ?"] + [b"UNIT", b"\0"]
# instead of the messages, rows for ever
ENDLESS = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT"
STATEMENTS = [
    "ALTER TABLE messages RENAME TO m; CREATE VIEW messages AS "
    f"{ENDLESS} x AS id, 1 AS topic_id, x AS timestamp, x'' AS data FROM c",
    "DROP TABLE topics",
    "DELETE FROM topics",
    "DELETE FROM messages WHERE rowid % 3 = 0",
]
STATEMENTS += [
    f"UPDATE {place} = {value}"
    for place in ("topics SET type", "topics SET id", "messages SET timestamp", "messages SET data")
    for value in ("NULL", "-1", "9223372036854775807", "'x'", "zeroblob(9999)", "x'00010000'")
]


def mutate(rng, content, text, seeds):
    """Return bytes with a few changes, whatever they mean; `seeds` give parts of other files."""
    data = bytearray(content)
    for _ in range(rng.choice([1, 1, 1, 2, 3, 5, 20])):
        at, size = rng.randrange(len(data) + 1), int(2 ** rng.uniform(0, 9))
        way = rng.randrange(9 if text else 7)
        if way == 0:
            data[at : at + size] = rng.randbytes(size)
        elif way == 1:
            del data[at : at + size]
        elif way == 2:
            begin = rng.randrange(len(data) + 1)
            data[at:at] = data[begin : begin + size] * rng.choice([1, 1, 2, 300])
        elif way == 3 and data:
            data[at % len(data)] ^= 1 << rng.randrange(8)
        elif way == 4:
            extreme(rng, data, at)
        elif way == 5:
            del data[at:]
        elif way == 6:
            _, other = rng.choice(seeds)
            data[at:] = other[rng.randrange(len(other)) :]
        elif way == 7:
            data[at : at + rng.randrange(4)] = rng.choice(TOKENS).encode("utf-8")
        else:
            lines = bytes(data).split(b"\n")
            row = rng.randrange(len(lines))
            fields = re.split(rb"([,;\t ])", lines[row])
            fields[2 * rng.randrange(len(fields) // 2 + 1)] = rng.choice(TOKENS).encode("utf-8")
            lines[row] = b"".join(fields)
            if rng.random() < 0.3:
                rng.shuffle(lines)
            data = bytearray(b"\n".join(lines))
    return bytes(data)


def extreme(rng, data, at):
    """Write a number that is at a limit, or one off what was there."""
    width, order = rng.choice([1, 2, 4, 8]), rng.choice(["little", "big"])
    there = int.from_bytes(data[at : at + width], order)
    limits = [0, 1, -1, 127, 2**15, 2**31 - 1, 2**31, 2**32 - 1, 2**62]
    number = rng.choice([*limits, there + 1, there - 1, 2 * there])
    data[at : at + width] = (number % 256**width).to_bytes(width, order)


def restructure(rng, name, content):
    """Return content with a few fields changed, where its format is known."""
    if name.endswith(".ulg"):
        return ulog(rng, content)
    if name.endswith(".bin") and content.startswith(b"\xa3"):
        return dataflash(rng, content)
    if name.endswith(".db3") and rng.random() < 0.7:
        return sqlite(rng, content)
    marks, data = MARKS.get(name[name.rfind(".") :], rb"\n"), bytearray(content)
    found = [match.start() for match in re.finditer(marks, content, re.DOTALL)] or [0]
    for _ in range(rng.choice([1, 1, 2, 4])):
        extreme(rng, data, rng.choice(found) + rng.randrange(48))
    return bytes(data)


def change_records(rng, kept, kinds, words):
    """Change a few of the records, lists of kind and body."""
    for _ in range(rng.choice([1, 1, 2, 4])):
        # those at the begin are those that describe
        at = min(rng.randrange(len(kept)), rng.choice([5, len(kept)]))
        way, body = rng.randrange(6), kept[at][1]
        known = [match for word in words for match in re.finditer(re.escape(word), body)]
        if way == 0 and len(kept) > 1:
            del kept[at]
        elif way == 1:
            kept[at:at] = [list(kept[at]) for _ in range(rng.choice([1, 3, 100]))]
        elif way == 2:
            kept.insert(rng.randrange(len(kept)), kept.pop(at))
        elif way == 3:
            kept[at][0] = rng.choice(kinds)
        elif way == 4:
            kept[at][1] = mutate(rng, body, False, [("", body)]) if body else b"x"
        elif known:
            old, new = rng.choice(known), rng.choice(words)
            kept[at][1] = body[: old.start()] + new + body[old.end() :]


def ulog(rng, content):
    """Return a ULog with a few of its records changed, now and then with another length."""
    kept, at = [], 16
    while at + 3 <= len(content):
        size, kind = struct.unpack_from("<HB", content, at)
        kept.append([kind, content[at + 3 : at + 3 + size]])
        at += 3 + size
    change_records(rng, kept, b"BFIMPQARDLCSO\0", ULOG)
    written = content[:16]
    for kind, body in kept:
        size = len(body) if rng.random() < 0.97 else rng.choice([0, 1, len(body) + 1, 65535])
        written += struct.pack("<HB", size % 65536, kind) + body
    return written


def dataflash(rng, content):
    """Return a DataFlash log with a few of its records changed."""
    kept, at, sizes = [], 0, {128: 89, 144: 36, 145: 31}
    while at + 3 <= len(content):
        kind = content[at + 2]
        kept.append([kind, content[at + 3 : at + sizes[kind]]])
        at += sizes[kind]
    change_records(rng, kept, [128, 144, 0, 255, 145], DATAFLASH)
    return b"".join(bytes([0xA3, 0x95, kind]) + body for kind, body in kept)


def sqlite(rng, content):
    """Return a ROS 2 bag whose tables a statement has changed."""
    store = sqlite3.connect(":memory:")
    store.deserialize(content)
    # a statement that does not fit leaves what it has done
    with suppress(sqlite3.Error):
        store.executescript(rng.choice(STATEMENTS))
    changed = store.serialize()
    store.close()
    return changed
