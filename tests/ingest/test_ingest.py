"""One call: files written in one step or not at all, errors of one line."""

import hashlib
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from imuloop.core.errors import ImuloopError, MachineFault
from imuloop.core.samples import schema
from imuloop.ingest import ingest as stage
from ingest.logs import brief


@pytest.fixture
def path(log, tmp_path):
    log.to_csv(tmp_path / "log.csv", index=False)
    return tmp_path / "log.csv"


def test_where_samples_come_from_is_kept_with_them(path, run):
    source = {"log": {"url": "https://example.org/log.csv", "sha256": "ab"}}
    done = run(path, sources=source)
    units = {"time": "s", "acceleration": "m/s^2", "angular_rate": "rad/s"}
    raw = {q: {"name": units[q], "scale": 1.0, "offset": 0.0} for q in [*units][1:]}
    assert done.metadata == {
        **{"device": "imu", "session": "poses", "kind": "multi_position", "log_format": "csv"},
        **{"source": source, "units": units, "raw_units": raw, "declared": {}, "sensor_ids": {}},
        **{"simulated": False, "start": None},
        "sha256": {"log.csv": hashlib.sha256(path.read_bytes()).hexdigest()},
    }
    assert done.metadata.items() <= done.quality.items()
    assert pq.read_schema(done.path).equals(schema(False))


# --- hostile files: one clear line, nothing half-written, nothing outside


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


def test_a_file_that_changes_while_it_is_read(path, run, monkeypatch):
    convert = stage.convert
    monkeypatch.setattr(stage, "convert", lambda *given: [convert(*given), path.unlink()][0])
    assert run(path).quality["reasons"] == ["the file changed while it was read"]


def test_the_extra_is_named_where_its_library_is_missing(run, tmp_path, monkeypatch):
    (tmp_path / "log.bag").write_bytes(b"#ROSBAG V2.0\n")
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(ImuloopError, match=r"needs the package rosbags, .*pip install '\.\[ros\]'"):
        run(tmp_path / "log.bag")


def test_a_full_disk_leaves_the_old_results_and_one_line(path, tmp_path):
    noise = np.random.default_rng(0).normal(size=(20_000, 7))
    (brief(20_000) + noise * [0, *[1] * 6]).to_csv(tmp_path / "big.csv", index=False)
    code = """if True:
        import resource, signal
        from pathlib import Path
        from imuloop.ingest.ingest import ingest

        def run(path):
            ingest(device="imu", session="poses", kind="static", paths=[path],
                   samples_path="out/samples.parquet", quality_path="out/quality.json")

        run("log.csv")
        old = {p.name: p.read_bytes() for p in Path("out").iterdir()}
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 18, 1 << 18))
        try:
            run("big.csv")
        except Exception as error:
            print(type(error).__name__, error)
        assert {p.name: p.read_bytes() for p in Path("out").iterdir()} == old
    """
    environment = {**os.environ, "PYTHONPATH": str(Path(stage.__file__).parents[2])}
    how = {"env": environment, "capture_output": True, "text": True, "timeout": 60}
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, **how)
    why = "out/samples.parquet cannot be written: File too large"
    assert done.stdout == f"MachineFault imu/poses: big.csv: {why}\n", done.stderr
