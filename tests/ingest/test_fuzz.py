"""Mutated logs and configs, a small part of ``make fuzz``; and whether it would see harm."""

import gc
import gzip
import os
import time
from pathlib import Path

import pyarrow as pa
import pytest

import bench.fuzz.__main__ as entry
from bench.fuzz import worker
from bench.fuzz.cases import case
from bench.fuzz.seeds import all_seeds

# seeds for which a line is the good end even when nothing is mutated
ODD = {("matlab", 3), ("table", 2), ("table", 3), ("table", 6)}


@pytest.fixture(scope="module")
def seeds(tmp_path_factory):
    return all_seeds(tmp_path_factory.mktemp("seeds"))


def test_mutated_files_are_read_rejected_or_refused_in_one_line():
    # what other tests left behind is finalised here, not in a worker
    gc.collect()
    ends, faults = entry.fuzz(18)
    assert faults == []
    assert {end for _, end in ends} == {"ok", "rejected", "declared", "faults", "unreadable"}
    assert len({kind for kind, _ in ends}) == 9
    # as in any other share among workers
    assert entry.fuzz(3, first=15, workers=1)[0] <= ends


def test_a_case_is_made_of_its_number_alone(seeds, tmp_path):
    # a zip counts time by two seconds
    time.sleep(2)
    again = all_seeds(tmp_path)
    assert {kind for kind in seeds if again[kind] != seeds[kind]} == set()
    assert [case(n, seeds) for n in (3, 1)] == [case(n, seeds) for n in (1, 3)][::-1]


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("kind", ["csv", "ulog", "matlab", "zip", "ros", "dataflash", "table"])
def test_what_is_mutated_was_a_sound_log(kind, seeds, tmp_path, monkeypatch, request):
    monkeypatch.chdir(tmp_path)
    # an odd one of MATLAB takes all memory, one of NetCDF is read where another was open before
    if kind not in ("matlab", "table"):
        request.getfixturevalue("in_process")
    for i, (name, content) in enumerate(seeds[kind]):
        packed = kind == "csv" and name.endswith("gz")
        Path(name).write_bytes(gzip.compress(content) if packed else content)
        numbered = {"time": 0, "acceleration": [1, 2, 3], "angular_rate": [4, 5, 6]}
        declared = {"columns": numbered} if name == "log.txt" else {}
        end, fault = worker.judge_log(name, declared)
        assert fault is None
        assert (end == "ok") != ((kind, i) in ODD), (i, end)


def write_in_c(path):
    """Write a file as a library in C does, of which Python's audit tells nothing."""
    with pa.OSFile(str(path), "wb") as file:
        file.write(b"x")


@pytest.mark.parametrize(
    ("harm", "end", "told"),
    [
        (lambda: {}["a"], "traceback", "KeyError"),
        (lambda: os._exit(3), "crash", "ended with 3"),
        (lambda: time.sleep(9), "hang", "not done within 1 s"),
        (lambda: bytearray(1 << 31), "memory", "more than 1 GB"),
        (lambda: Path("../stray").write_text(""), "rejected", "a/stray"),
        (lambda: Path("half").symlink_to("/etc/passwd"), "rejected", "left behind ['a/work/half']"),
        (lambda: Path("/tmp").chmod(0o1777), "rejected", "os.chmod /tmp"),
        (lambda: os.rename("log.csv.gz", "../moved"), "declared", "a/moved"),
        (lambda: write_in_c(Path.home() / "stray"), "rejected", "left behind ['home/stray']"),
        (lambda: os.system("true"), "rejected", "os.system"),
    ],
)
def test_harm_is_seen(monkeypatch, harm, end, told):
    read = worker.ingest

    def harmful(**declared):
        harm()
        read(**{**declared, "columns": None, "units": None, "time_range": None})

    monkeypatch.setattr(worker, "ingest", harmful)
    if end == "hang":
        monkeypatch.setattr(entry, "SECONDS", 1)
    ends, faults = entry.fuzz(3, only="packed")
    assert ends == {("packed", end): 3}
    assert all(told in fault for _, _, fault in faults) and len(faults) == 3
