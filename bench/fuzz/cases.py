"""Sound logs and configs mutated, each case made of its number alone."""

import gzip
import io
import random
import re
import zipfile

import yaml

# what breaks numbers, texts, tables and paths
TOKENS = "nan inf -inf 1e999 -0 0x10 1_000 9223372036854775808 1e-320 é \ufeff , ; ,,,, # ' \\ {{"
TOKENS += " 2024-13-45T99:00 2024-01-01T00:00:00Z ../../x /etc/passwd <script> %PDF t ax ax.x"
TOKENS = [*TOKENS.split(), "", " ", "\t", "\r", "\n", "\0", '"']
VALUES = [None, True, -1, 0, 1e308, float("nan"), float("inf"), 2**70, "", "x" * 300, "../x", "/"]
VALUES += ["/dev/zero", "<b>", "\x1b[2J", "no", [], {}, [1], [[]], {"a": {}}, {1: 2}, "gone.csv"]
VALUES += ["log.csv", "count", ["ax", "ay"], ["ax", "ay", "az"], [5, "a"], "2024-01-01", 0.1]


def case(number, seeds):
    """Return kind, file name, content and declarations of a case."""
    rng = random.Random(number)
    kind = rng.choice(sorted(seeds))
    name, content = rng.choice(seeds[kind])
    if kind == "config":
        return kind, name, config_case(rng, content), {}
    if kind == "zip" and rng.random() < 0.6:
        content = zip_case(rng, content)
    else:
        content = mutate(rng, content, kind == "csv", seeds[kind])
    if kind == "csv" and name.endswith(".gz"):
        content = gzip.compress(content, 1)
    declared = {}
    if rng.random() < 0.2:
        quantity = rng.choice(["time", "acceleration", "angular_rate", "temperature"])
        columns = [0, "t", "ax", ["ax", "ay", "az"], [1, 2, 3], "imu", ["/imu.x"] * 3, "IMU_0"]
        declared["columns"] = {quantity: rng.choice(columns)}
    if rng.random() < 0.2:
        declared["units"] = {"time": rng.choice(["s", "us", "ns", "ISO 8601"])}
    if rng.random() < 0.1:
        declared["rate"] = rng.choice([100, 1e-9, 1e12])
    if rng.random() < 0.1:
        declared["time_range"] = rng.choice([(0, 0.2), (None, "2024-01-01"), (0.1, None)])
    return kind, name, content, declared


def mutate(rng, content, text, seeds):
    """Return bytes with a few changes."""
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
            number = rng.choice([0, 1, -1, 127, 2**15, 2**31 - 1, 2**31, 2**32 - 1, 2**62])
            width = rng.choice([1, 2, 4, 8])
            order = rng.choice(["little", "big"])
            data[at : at + width] = (number % 256**width).to_bytes(width, order)
        elif way == 5:
            del data[rng.randrange(len(data) + 1) :]
        elif way == 6:
            _, other = rng.choice(seeds)
            data[at:] = other[rng.randrange(len(other)) :]
        elif way == 7:
            data[at : at + rng.randrange(4)] = rng.choice(TOKENS).encode("utf-8")
        else:
            lines = bytes(data).split(b"\n")
            token = rng.choice(TOKENS).encode("utf-8")
            row = rng.randrange(len(lines))
            fields = re.split(rb"([,;\t ])", lines[row])
            fields[2 * rng.randrange(len(fields) // 2 + 1)] = token
            lines[row] = b"".join(fields)
            if rng.random() < 0.3:
                rng.shuffle(lines)
            data = bytearray(b"\n".join(lines))
    return bytes(data)


def zip_case(rng, content):
    """Return a sound zip whose members, or their names, are mutated."""
    written = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as old, zipfile.ZipFile(written, "w") as new:
        for name in old.namelist():
            text = old.read(name)
            way = rng.randrange(4)
            if way == 0:
                name = rng.choice(["../", "/", "a/", "C:\\", "..\\", "\x00", "é"]) + name
            elif way == 1:
                text = mutate(rng, text, True, [(name, text)]) or b"x"
            elif way == 2 and rng.random() < 0.2:
                text = text[:200] + bytes(1 << 22)
            packing = rng.choice([zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
            new.writestr(zipfile.ZipInfo(name), text, packing)
    return written.getvalue()


def config_case(rng, content):
    """Return a config with a few changed values, or with changed bytes."""
    if rng.random() < 0.3:
        return mutate(rng, content, True, [("", content)])
    config = yaml.safe_load(content)
    for _ in range(rng.choice([1, 1, 2, 4])):
        node = config
        while True:
            keys = list(node) if isinstance(node, dict) else list(range(len(node)))
            if not keys:
                break
            key = rng.choice(keys)
            if isinstance(node[key], (dict, list)) and rng.random() < 0.8:
                node = node[key]
                continue
            if rng.random() < 0.2 and isinstance(node, dict):
                node[rng.choice(["", "../x", "é", "exports", 7, None, "a" * 99])] = node.pop(key)
            else:
                node[key] = rng.choice(VALUES)
            break
    return yaml.safe_dump(config, allow_unicode=True).encode()
