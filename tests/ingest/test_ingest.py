"""One call: files written in one step or not at all, errors of one line."""

import hashlib
import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from imuloop.core.errors import ImuloopError, MachineFault
from imuloop.core.samples import schema
from imuloop.ingest import ingest as stage
from ingest.logs import brief


def in_child(folder, code):
    """Run code in its own process in a folder; return what it prints."""
    head = """
        import resource
        from pathlib import Path
        from imuloop.core.files import read_json
        from imuloop.ingest.ingest import ingest

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


@pytest.fixture
def path(log, tmp_path):
    log.to_csv(tmp_path / "log.csv", index=False)
    return tmp_path / "log.csv"


def test_where_samples_come_from_is_kept_with_them(path, run):
    source = {"log": {"url": "https://example.org/log.csv", "sha256": "ab"}}
    done = run(path, sources=source)
    assert done.metadata == {
        "device": "imu",
        "session": "poses",
        "kind": "multi_position",
        "log_format": "csv",
        "source": source,
        "sha256": {"log.csv": hashlib.sha256(path.read_bytes()).hexdigest()},
        "units": {"time": "s", "acceleration": "m/s^2", "angular_rate": "rad/s"},
        "raw_units": {
            "acceleration": {"name": "m/s^2", "scale": 1.0, "offset": 0.0},
            "angular_rate": {"name": "rad/s", "scale": 1.0, "offset": 0.0},
        },
        "declared": {},
        "sensor_ids": {},
        "simulated": False,
        "start": None,
    }
    for key, value in done.metadata.items():
        assert done.quality[key] == value
    fields = pq.read_schema(done.path)
    assert fields.equals(schema(False))


# --- hostile files: one clear line, nothing half-written, nothing outside


@pytest.mark.parametrize("line", [pytest.param("7", marks=pytest.mark.study), "\\0"])
def test_a_line_of_100_MB_costs_its_share(log, tmp_path, line):
    """A hole in the file, which is zeros without room on the disk: nothing was in it."""
    half = len(log) // 2
    with open(tmp_path / "log.csv", "wb") as file:
        file.write(log.head(half).to_csv(index=False).encode())
        if line == "\\0":
            # what a logger's disk holds after its power failed: a hole of zeros
            file.seek(1 << 27, os.SEEK_CUR)
        for _ in range(0 if line == "\\0" else 100):
            file.write(line.encode() * ((1 << 20) // len(line)))
        file.write(b"\n" + log.tail(half).to_csv(index=False, header=False).encode())
    found = in_child(
        tmp_path,
        """
        quality = run("log.csv")
        print(quality["status"], quality["rows"], quality["bad_lines"])
        """,
    ).split()
    assert found == (["ok", "500", "1"] if line == "\\0" else ["rejected", "500", "1"])


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


def test_a_file_that_may_not_be_read_is_a_fault_of_the_machine(path, run, monkeypatch):
    def refused(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(stage, "find_format", refused)
    with pytest.raises(MachineFault, match=r"imu/poses: .*log\.csv: Permission denied"):
        run(path)


@pytest.mark.parametrize("change", ["grow", "remove"])
def test_a_file_that_changes_while_it_is_read(path, run, monkeypatch, change):
    convert = stage.si_samples

    def changing(*args, **options):
        if change == "grow":
            with open(path, "ab") as file:
                file.write(b"9,0,0,9.8,0,0,0\n")
        else:
            path.unlink()
        return convert(*args, **options)

    monkeypatch.setattr(stage, "si_samples", changing)
    assert run(path).quality["reasons"] == ["the file changed while it was read"]


def test_a_full_disk_leaves_the_old_results_and_one_line(path, tmp_path):
    noise = np.random.default_rng(0).normal(size=(20_000, 7))
    (brief(20_000) + noise * [0, *[1] * 6]).to_csv(tmp_path / "big.csv", index=False)
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
