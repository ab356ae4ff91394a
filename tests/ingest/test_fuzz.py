"""Mutated logs and configs, a small part of ``make fuzz``; and whether it would see harm."""

import gc
import os
from pathlib import Path

import pytest

import bench.fuzz.__main__ as entry
from bench.fuzz import worker


@pytest.mark.study
def test_mutated_files_are_read_rejected_or_refused_in_one_line():
    # what other tests left behind is finalised here, not in a worker
    gc.collect()
    ends, faults = entry.fuzz(18)
    assert faults == []
    assert {end for _, end in ends} == {"ok", "rejected", "declared", "faults", "unreadable"}
    assert len({kind for kind, _ in ends}) == 9


@pytest.mark.parametrize(
    ("harm", "end", "reported"),
    [
        (lambda: {}["a"], "traceback", "KeyError"),
        (lambda: os._exit(3), "crash", "ended with 3"),
        (lambda: Path("../stray").write_text(""), "rejected", "a/stray"),
    ],
)
def test_harm_is_seen(monkeypatch, harm, end, reported):
    read = worker.ingest

    def harmful(**what):
        harm()
        read(**what | {"declared": None})

    monkeypatch.setattr(worker, "ingest", harmful)
    ends, [(*_, fault)] = entry.fuzz(1, only="packed")
    assert ends == {("packed", end): 1} and reported in fault
