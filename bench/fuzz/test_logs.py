"""Mutated logs and configs: does any of them crash, hang, or write outside of its folder?

``pytest bench/fuzz/test_logs.py --cases 500``: so many of each sound log. Good ends are a session,
a rejected one, or one line on what is declared wrongly.
"""

import copy
import gzip
import io
import json
import os
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from bench.tables import REPOSITORY
from imuloop.config import resolve
from imuloop.config_faults import config_faults
from imuloop.config_text import unreadable
from imuloop.core.errors import ImuloopError
from imuloop.ingest.ingest import Declared, ingest
from ingest.sound_logs import SIX, sound_logs

# of a case, of processor time
SECONDS = 10
RESULTS = {"out/samples.parquet", "out/quality.json"}
with tempfile.TemporaryDirectory() as made:
    LOGS = sound_logs(Path(made))

# what breaks numbers, texts, tables and paths
TOKENS = "nan inf -inf 1e999 -0 0x10 1_000 9223372036854775808 1e-320 é \ufeff , ; ,,,, # ' \\ {{"
TOKENS += " 2024-13-45T99:00 2024-01-01T00:00:00Z ../../x /etc/passwd <script> %PDF t ax ax.x"
TOKENS = [each.encode() for each in (*TOKENS.split(), " ", "\t", "\r", "\n", "\0", '"')]
NUMBERS = [0, 1, 127, 2**15, 2**31 - 1, 2**31, 2**32 - 1, 2**62, 2**64 - 1]
NUMBERS = [n.to_bytes(8, order)[-width:] for n in NUMBERS for order in ("little", "big")
           for width in (2, 4, 8)]  # fmt: skip
PATCHES = st.one_of(
    st.just(b""), st.binary(max_size=64), st.sampled_from(TOKENS), st.sampled_from(NUMBERS)
)
DECLARED = st.fixed_dictionaries(
    {},
    optional={
        "columns": st.dictionaries(
            st.sampled_from(["time", "acceleration", "angular_rate", "temperature"]),
            st.sampled_from([0, "t", "ax", ["ax", "ay", "az"], [1, 2, 3], "imu", ["/imu.x"] * 3]),
            max_size=1,
        ),
        "units": st.sampled_from([{"time": unit} for unit in ("s", "us", "ns", "ISO 8601")]),
        "rate": st.sampled_from([100, 1e-9, 1e12]),
        "time_range": st.sampled_from([(0, 0.2), (None, "2024-01-01"), (0.1, None)]),
    },
)


@st.composite
def mutated(draw, content):
    """Bytes with one to five stretches replaced, by others, by nothing or by a copy of a part."""
    data = bytearray(content)
    for _ in range(draw(st.integers(1, 5))):
        n = len(data)
        # formats say at the begin or at the end what they hold
        near = st.one_of(st.integers(0, min(n, 512)), st.integers(max(n - 512, 0), n))
        at = draw(st.one_of(near, st.integers(0, n)))
        size = draw(st.one_of(st.integers(0, 8), st.integers(0, 512), st.just(n)))
        first = draw(st.integers(0, n))
        copied = bytes(data[first : first + 64]) * draw(st.sampled_from([1, 2, 300]))
        data[at : at + size] = draw(st.one_of(PATCHES, st.just(copied)))
    return bytes(data)


@st.composite
def packed(draw, name, content):
    """A log as it is packed whose text is mutated, or a member of the archive, or its name."""
    if name.endswith(".gz"):
        return gzip.compress(draw(mutated(gzip.decompress(content))), 1, mtime=0)
    file = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as old, zipfile.ZipFile(file, "w") as new:
        chosen = draw(st.sampled_from(old.namelist()))
        before = draw(st.sampled_from(["", "../", "/", "a/", "C:\\", "..\\", "é"]))
        for member in old.namelist():
            text = old.read(member)
            if member == chosen:
                member, text = before + member, draw(mutated(text))
            new.writestr(zipfile.ZipInfo(member), text, zipfile.ZIP_DEFLATED)
    return file.getvalue()


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("number", range(len(LOGS)))
@given(data=st.data())
def test_a_mutated_log_is_read_rejected_or_refused_in_a_line(confined, number, data):
    name, content = LOGS[number]
    ways = [mutated(content)]
    if name.endswith((".gz", ".zip")):
        ways.append(packed(name, content))
    given_bytes, declared = data.draw(st.one_of(ways)), data.draw(DECLARED)
    with confined(SECONDS) as folder:
        Path(name).write_bytes(given_bytes)
        try:
            ingest(
                device="imu",
                session="a",
                kind="static",
                paths=[name],
                samples_path="out/samples.parquet",
                quality_path="out/quality.json",
                declared=Declared(**declared),
            )
        except ImuloopError as error:
            assert str(error).isprintable() and str(error)
        else:
            judge(json.loads(Path("out/quality.json").read_text()), "out/samples.parquet")
        # passes over a reader's folder that goes while it is looked through
        every = (os.path.join(at, file) for at, _, files in os.walk(folder) for file in files)
        left = {os.path.relpath(path, folder) for path in every}
    assert left <= {name, *RESULTS}


def judge(quality, samples):
    """Hold a rejected session to its reasons, another to its samples."""
    with pq.ParquetFile(samples) as file:
        t, *six = (column.to_numpy() for column in file.read(["t", *SIX]).columns)
    if quality["status"] == "rejected":
        assert not len(t) and quality["reasons"]
    else:
        assert t[0] == 0 and (np.diff(t) > 0).all() and np.isfinite(six).all()


CONFIG = yaml.safe_load((REPOSITORY / "config/measured.yaml").read_text())
KEYS = ["", "../x", "é", "exports", 7, None, "a" * 99]
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
ENTITIES += ["|\n  x", "---\n- a", "9" * 5000, "[" * 3000, "[" * 999 + "]" * 999]
# each a list of ten of the one before
LEVELS = [f"&a{i + 1} [{', '.join([f'*a{i}'] * 10)}]" for i in range(8)]
ENTITIES += [f"[&a0 [1], {', '.join(LEVELS)}]"]


def places(node):
    """Yield each mapping or list of a config with each of its keys."""
    for key in list(node) if isinstance(node, dict) else range(len(node)):
        yield node, key
        if isinstance(node[key], (dict, list)):
            yield from places(node[key])


@st.composite
def configs(draw):
    """The bytes of a config with a few other values and keys, or with other bytes."""
    config = copy.deepcopy(CONFIG)
    for _ in range(draw(st.integers(0, 4))):
        if not (every := list(places(config))):
            break
        node, key = draw(st.sampled_from(every))
        if isinstance(node, dict) and draw(st.booleans()):
            node[draw(st.sampled_from(KEYS))] = node.pop(key)
        else:
            node[key] = copy.deepcopy(draw(st.sampled_from([*VALUES, *[MARK] * 6])))
    text = yaml.safe_dump(config, allow_unicode=True)
    text = text.replace(MARK, draw(st.sampled_from(ENTITIES))).encode("utf-8", "surrogatepass")
    return draw(st.one_of(st.just(text), mutated(text)))


@given(content=configs())
def test_a_mutated_config_has_its_faults_in_lines(confined, content):
    with confined(SECONDS):
        Path("log.csv").write_bytes(LOGS[0][1])
        Path("config.yaml").write_bytes(content)
        if reported := unreadable("config.yaml"):
            assert reported.isprintable()
            return
        config = yaml.safe_load(content.decode("utf-8"))
        found = config_faults(config, {"config.yaml": "config.yaml"}, {})
        assert all(line.isprintable() for line in found)
        if not found:
            resolve(config)
