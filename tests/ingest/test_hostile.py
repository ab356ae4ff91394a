"""Hostile files: one clear line, memory bounded, nothing half-written, nothing outside."""

import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from imuloop.core.errors import ImuloopError, MachineFault
from imuloop.ingest import ingest as stage

# more than the libraries and a block of a log take, far less than the files below, MB
MEMORY = 120


def rejected(done):
    """Return the one reason of a rejected log, which left nothing but its two results."""
    assert done.quality["status"] == "rejected"
    assert len(done.samples) == 0
    assert {p.name for p in done.path.parent.iterdir()} == {"samples.parquet", "quality.json"}
    [reason] = done.quality["reasons"]
    assert reason.isprintable() and len(reason) < 300
    return reason


def in_child(folder, code):
    """Run code in a process of its own in a folder; return what it prints."""
    head = """
        import resource
        from pathlib import Path
        from imuloop.core.files import read_json
        from imuloop.ingest.ingest import ingest

        def memory():
            return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10

        def run(path):
            ingest(device="imu", session="poses", kind="static", paths=[path],
                   samples_path="out/samples.parquet", quality_path="out/quality.json")
            return read_json("out/quality.json")
    """
    library = Path(stage.__file__).parents[2]
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(head) + textwrap.dedent(code)],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(library)},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def text(log, **options):
    return log.to_csv(index=False, **options).encode()


TEXT = "t,ax,ay,az,gx,gy,gz\n" + "0.01,0.1,0.2,9.8,0,0,0\n" * 300


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (TEXT.encode("utf-16"), "the text is UTF-16 or UTF-32: save it as UTF-8"),
        (TEXT.encode("utf-16-le"), "the file is binary, or text in UTF-16: save it as UTF-8"),
        (TEXT.encode("cp500"), "the file is not a table of numbers in rows and columns"),
        (b"", "the file has no rows"),
        (b"\n \r\n\n" * 9, "the file has no rows"),
        (bytes(9) + b"\n" + bytes(1 << 10), "the file is binary, or text in UTF-16"),
        (b"7" * (1 << 17), "the first line is longer than 64 kB: no table"),
        (b"%PDF-1.4 something\nthat is no table\n", "the file is not a table"),
        (b"t,ax,ay,az,gx,gy,gz\n", "the file is not a table"),
    ],
)
def test_a_file_that_holds_nothing(run, tmp_path, content, reason):
    (tmp_path / "log.csv").write_bytes(content)
    columns = {"time": 0, "acceleration": [1, 2, 3], "angular_rate": [4, 5, 6]}
    assert rejected(run(tmp_path / "log.csv", columns=columns)).startswith(reason)


@pytest.mark.parametrize("line", [pytest.param("7", marks=pytest.mark.study), "\\0"])
def test_a_line_of_100_MB_costs_its_share_and_little_memory(log, tmp_path, line):
    """A hole in the file, which is zeros without room on the disk: nothing was in it."""
    half = len(log) // 2
    with open(tmp_path / "log.csv", "wb") as file:
        file.write(text(log.head(half)))
        if line == "\\0":
            # what a logger's disk holds after its power failed: a hole of zeros
            file.seek(1 << 27, os.SEEK_CUR)
        for _ in range(0 if line == "\\0" else 100):
            file.write(line.encode() * ((1 << 20) // len(line)))
        file.write(b"\n" + text(log.tail(half), header=False))
    found = in_child(
        tmp_path,
        """
        before = memory()
        quality = run("log.csv")
        print(quality["status"], quality["rows"], quality["bad_lines"], memory() - before)
        """,
    ).split()
    assert found[:3] == (["ok", "500", "1"] if line == "\\0" else ["rejected", "500", "1"])
    assert int(found[3]) < MEMORY


@pytest.mark.parametrize("kind", ["none", "fifo", "loop", "dangling", "folder", "device"])
@pytest.mark.parametrize("name", ["log.csv", "log.bag"])
def test_what_is_no_file_is_reported_and_never_waited_for(run, tmp_path, kind, name):
    path = tmp_path / name
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind != "none":
        path.symlink_to({"loop": path, "dangling": tmp_path / "gone", "device": "/dev/zero"}[kind])
    message = "is a folder" if kind == "folder" else "there is no such file"
    # a signal ends the tests instead of waiting for ever
    signal.alarm(10)
    with pytest.raises(ImuloopError, match=message):
        run(path)
    signal.alarm(0)
    assert not (tmp_path / "out").exists()


def test_a_file_that_may_not_be_read_is_a_fault_of_the_machine(log, run, tmp_path, monkeypatch):
    def refused(*_):
        raise PermissionError(13, "Permission denied")

    (tmp_path / "log.csv").write_bytes(text(log))
    monkeypatch.setattr(stage, "find_format", refused)
    with pytest.raises(MachineFault, match=r"imu/poses: .*log\.csv: Permission denied"):
        run(tmp_path / "log.csv")


@pytest.mark.parametrize("change", ["grow", "remove"])
def test_a_file_that_changes_while_it_is_read(log, run, tmp_path, monkeypatch, change):
    path = tmp_path / "log.csv"
    path.write_bytes(text(log))
    convert = stage.si_batches

    def changing(*args, **options):
        yield from convert(*args, **options)
        if change == "grow":
            with open(path, "ab") as file:
                file.write(b"9,0,0,9.8,0,0,0\n")
        else:
            path.unlink()

    monkeypatch.setattr(stage, "si_batches", changing)
    assert rejected(run(path)) == "the file changed while it was read"


def test_a_full_disk_leaves_the_old_results_and_one_line(log, tmp_path):
    (tmp_path / "log.csv").write_bytes(text(log))
    rng = np.random.default_rng(0)
    table = np.column_stack([np.arange(20_000) / 100, rng.normal(9, 1, size=(20_000, 6))])
    header = "t,ax,ay,az,gx,gy,gz"
    np.savetxt(tmp_path / "big.csv", table, delimiter=",", header=header, comments="")
    said = in_child(
        tmp_path,
        """
        import signal
        run("log.csv")
        old = {p.name: p.read_bytes() for p in Path("out").iterdir()}
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 18, 1 << 18))
        try:
            run("big.csv")
        except Exception as error:
            print(type(error).__name__, error)
        assert {p.name: p.read_bytes() for p in Path("out").iterdir()} == old
        """,
    )
    assert said == (
        "MachineFault imu/poses: big.csv: out/samples.parquet cannot be written: File too large\n"
    )
