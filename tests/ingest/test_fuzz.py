"""Mutated logs and configs, a small part of ``python -m bench.fuzz``; and whether it would see."""

import gzip
import os
import time
from pathlib import Path

import pytest

from bench.fuzz import worker
from bench.fuzz.run import fuzz
from bench.fuzz.seeds import all_seeds


def test_mutated_files_are_read_rejected_or_told_in_one_line():
    ends, faults = fuzz(250)
    assert faults == []
    assert {end for _, end in ends} == {"ok", "rejected", "declared", "faults", "unreadable"}
    assert len({kind for kind, _ in ends}) == 9


@pytest.mark.parametrize("kind", ["csv", "ulog", "matlab", "zip", "ros", "dataflash", "table"])
def test_what_is_mutated_was_a_sound_log(kind, tmp_path, monkeypatch):
    seeds = all_seeds(tmp_path)[kind]
    monkeypatch.chdir(tmp_path)
    for name, content in seeds:
        Path(name).write_bytes(gzip.compress(content) if name.endswith("gz") else content)
        numbered = {"time": 0, "acceleration": [1, 2, 3], "angular_rate": [4, 5, 6]}
        declared = {"columns": numbered} if name == "log.txt" else {}
        assert worker.judge_log(name, declared) == ("ok", None)


@pytest.mark.parametrize(
    ("harm", "end", "told"),
    [
        (lambda: {}["a"], "traceback", "KeyError"),
        (lambda: os._exit(3), "crash", "ended with 3"),
        (lambda: time.sleep(9), "hang", "not done within 1 s"),
        (lambda: bytearray(1 << 33), "memory", "more than 2 GB"),
        (lambda: Path("../stray").write_text(""), "rejected", "stray"),
        (lambda: Path("half").write_text(""), "rejected", "left behind ['half']"),
        (lambda: os.system("true"), "rejected", "os.system"),
    ],
)
def test_harm_is_seen(monkeypatch, harm, end, told):
    read = worker.ingest

    def harmful(**declared):
        harm()
        Path("log.csv").write_text("")
        read(**{**declared, "paths": ["log.csv"], "columns": None})

    monkeypatch.setattr(worker, "ingest", harmful)
    monkeypatch.setattr(worker, "SECONDS", 1)
    ends, [(_, _, fault)] = fuzz(1, only="csv")
    assert [*ends] == [("csv", end)] and told in fault
