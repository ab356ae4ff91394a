"""One call: files written in one step or not at all, errors of one line."""

import errno
import hashlib
import os
import signal
import sys

import pyarrow.parquet as pq
import pytest

from imuloop.core.errors import ImuloopError, MachineFault
from imuloop.core.samples import schema
from imuloop.ingest import ingest as stage


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


def test_the_extra_is_named_where_its_library_is_missing(run, tmp_path, monkeypatch):
    (tmp_path / "log.bag").write_bytes(b"#ROSBAG V2.0\n")
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(ImuloopError, match=r"needs the package rosbags, .*pip install '\.\[ros\]'"):
        run(tmp_path / "log.bag")


def test_a_full_disk_leaves_the_old_results_and_one_line(path, run, monkeypatch):
    folder = run(path).path.parent
    old = {p.name: p.read_bytes() for p in folder.iterdir()}

    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(stage.pq.ParquetWriter, "write_table", full)
    with pytest.raises(MachineFault, match=r"imu/poses: .*samples.parquet cannot be written"):
        run(path)
    assert {p.name: p.read_bytes() for p in folder.iterdir()} == old
