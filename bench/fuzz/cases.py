"""Sound logs and configs mutated, each case made of its number alone."""

import gzip
import io
import json
import random
import zipfile

import yaml

from bench.fuzz.mutate import mutate, restructure

VALUES = [None, True, -1, 0, 1e308, float("nan"), float("inf"), 2**70, "", "x" * 300, "../x", "/"]
VALUES += ["/dev/zero", "<b>", "\x1b[2J", "no", [], {}, [1], [[]], {"a": {}}, {1: 2}, "gone.csv"]
VALUES += ["log.csv", "count", ["ax", "ay"], ["ax", "ay", "az"], [5, "a"], "2024-01-01", 0.1]
MARK = "__entity__"
# what YAML knows beyond values
ENTITIES = """!!python/object/apply:os.system [touch x]|!!python/name:os.system|*a|&a 1|&a [*a]
&a {b: *a}|{<<: {a: 1}}|{<<: 1}|{<<: [1]}|!!binary '='|!x 1|!!timestamp 2024-99-99|2024-02-30|1:99
!!set {a}|!!omap [a: 1]|!!int a|!!float a|!!bool a|!!null a|? {a}|{? [a] : b}|0b2|.nan
"\\uD800"|'\\x00'|%YAML|{a: 1, a: 2}|[<b>, "\\e[2J"]|2024-01-01 25:00:00|1e5|=|<<|0o9|-.inf|0x"""
ENTITIES = [each for line in ENTITIES.splitlines() for each in line.split("|")]
ENTITIES += [
    "|\n  x",
    "---\n- a",
    "9" * 5000,
    "[" * 3000,
    "[" * 99 + "]" * 99,
    "[" * 999 + "]" * 999,
]
# each a list of ten of the one before
LEVELS = [f"&a{i + 1} [{', '.join([f'*a{i}'] * 10)}]" for i in range(8)]
ENTITIES += [f"[&a0 [1], {', '.join(LEVELS)}]"] * 2


def case(number, seeds):
    """Return kind, file name, content and declarations of a case."""
    rng = random.Random(number)
    kind = rng.choice(sorted(seeds))
    name, content = rng.choice(seeds[kind])
    if kind == "config":
        return kind, name, config_case(rng, content), {}
    if kind == "zip" and rng.random() < 0.6:
        content = zip_case(rng, content)
    elif kind != "csv" and rng.random() < 0.6:
        content = restructure(rng, name, content)
    else:
        content = mutate(rng, content, kind == "csv", seeds[kind])
    if kind == "csv" and name.endswith(".gz"):
        content = gzip.compress(content, 1, mtime=0)
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
            packing = rng.choice([zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
            if way == 2 and rng.random() < 0.1:
                text, packing = text[:200] + bytes(1 << 22), zipfile.ZIP_DEFLATED
            new.writestr(zipfile.ZipInfo(name), text, packing, compresslevel=1)
    return written.getvalue()


def config_case(rng, content):
    """Return a config with a few changed values, or with changed bytes."""
    if rng.random() < 0.3:
        return mutate(rng, content, True, [("", content)])
    config = json.loads(content)
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
                node[key] = rng.choice([*VALUES, *[MARK] * 6])
            break
    # libyaml writes the same faster
    text = yaml.dump(config, Dumper=yaml.CSafeDumper, allow_unicode=True)
    return text.replace(MARK, rng.choice(ENTITIES)).encode("utf-8", "surrogatepass")
