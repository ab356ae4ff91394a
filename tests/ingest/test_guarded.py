"""Readers in processes of their own: limits, deaths, and files made to break a library."""

import re
import struct
import time
from pathlib import Path

import h5py
import netCDF4
import numpy as np
import pyarrow as pa
import pytest
from pyulog import ULog
from scipy.io import savemat

from imuloop.core.errors import ImuloopError, Lacking, MachineFault, RejectedLog
from imuloop.core.samples import CHANNELS
from imuloop.ingest import guarded
from imuloop.ingest.formats import find_format
from ingest import broken_readers
from ingest.sound_logs import sound_logs

ENDINGS = ["ulg", "mat", "zip", "bag", "db3", "mcap", "bin", "nc"]


@pytest.fixture(scope="module")
def seeds(tmp_path_factory):
    every = sound_logs(tmp_path_factory.mktemp("seeds"))
    return {end: next(x for name, x in every if name == f"log.{end}") for end in ENDINGS}


@pytest.fixture
def read(tmp_path):
    """Run the reader that does what the name says."""

    def call(name):
        path = tmp_path / f"{name}.log"
        path.write_bytes(bytes(1000))
        return broken_readers.read({"log": path})

    return call


@pytest.mark.parametrize(
    ("act", "line"),
    [
        ("raise_later", r"is no whole file of the format broken_readers \(KeyError: .*\): copy it"),
        ("allocate", "takes more than 512 MB of memory to read"),
        ("wait", "leads its reader to wait for more than 1 s"),
        ("fault", "ends the process that reads it by signal 11"),
        ("unpack", "File too large"),
    ],
)
def test_what_goes_wrong_is_one_line_about_the_file(read, monkeypatch, act, line):
    if act == "wait":
        # others take as long as the machine needs
        monkeypatch.setattr(guarded, "SECONDS", 0.5)
        monkeypatch.setattr(guarded, "WAITING", 1)
        monkeypatch.setattr(guarded, "SHARING", 1)
    with pytest.raises(RejectedLog, match=rf"^{act}\.log .*{line}") as raised:
        list(read(act).batches)
    assert str(raised.value).isprintable()


@pytest.mark.parametrize("when", ["kill", "kill_later"])
def test_a_reader_that_is_killed_from_outside_says_nothing_of_the_file(read, when):
    """Protects a sound log from a machine without memory: it was damaged, and left out."""
    with pytest.raises(MachineFault, match=r"^the reader of kill\w*\.log was killed from outside"):
        list(read(when).batches)


def test_batches_counts_and_what_a_reader_foresees_come_back(read, capfd):
    with pytest.raises(Lacking, match=r"^no stream 'a'$"):
        read("lack")
    log = read("print_later")
    assert log.bad_lines == 0
    rows = pa.Table.from_batches(log.batches)
    assert rows.column_names == [*CHANNELS] and rows["az"].to_pylist() == [0, 1]
    assert log.bad_lines == 7
    assert capfd.readouterr() == ("", "")


def children():
    """Return the processes that this one has, those that wait for their end too."""
    return {c for p in Path("/proc/self/task").glob("*/children") for c in p.read_text().split()}


@pytest.mark.parametrize("how", ["read", "begun", "failed"])
def test_nothing_is_left_behind(read, tmp_path, monkeypatch, how):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    before = children()
    if how == "failed":
        with pytest.raises(RejectedLog):
            read("abort")
    else:
        batches = read("print").batches
        next(batches)
        if how == "read":
            list(batches)
        del batches
    assert not list(tmp_path.glob("imuloop-*"))
    assert children() == before


def test_every_reader_of_binary_files_has_a_process_of_its_own():
    assert all(
        hasattr(find_format(None, {"log": f"log.{e}"})[1].read, "__wrapped__") for e in ENDINGS
    )


@pytest.mark.parametrize("ending", ["mat", "bag"])
def test_the_same_through_a_process(seeds, tmp_path, ending):
    path = tmp_path / f"log.{ending}"
    path.write_bytes(seeds[ending])
    _, form = find_format(None, {"log": path})
    here, there = (f({"log": path}, None, 7) for f in (form.read.__wrapped__, form.read))
    assert [b.serialize() for b in here.batches] == [b.serialize() for b in there.batches]
    assert {**vars(here), "batches": 0} == {**vars(there), "batches": 0}


def test_the_extra_is_named_where_its_library_is_missing(seeds, run, tmp_path, monkeypatch):
    path = tmp_path / "log.ulg"
    path.write_bytes(seeds["ulg"])
    (tmp_path / "pyulog.py").write_text("raise ModuleNotFoundError(name='pyulog')")
    monkeypatch.syspath_prepend(tmp_path)
    line = r"needs the package pyulog, .*pip install '\.\[ulog\]'"
    with pytest.raises(ImuloopError, match=line):
        run(path)


# files made to break their readers, each beside what is said of it


def cells_in_cells(path, log):
    """MATLAB cells in cells, 3000 deep."""
    cell = b""
    for _ in range(3000):
        parts = struct.pack("<IIIIIIiiII", 6, 8, 1, 0, 5, 8, 1, 1, 1, 0) + cell
        cell = struct.pack("<II", 14, len(parts)) + parts
    savemat(path, {"t": log.t.to_numpy()})
    path.write_bytes(path.read_bytes() + cell)


def never_written(path, log):
    """An array of 24 TB, none of which is in the file."""
    with h5py.File(path, "w") as file:
        file.create_dataset("acc", (3, 1 << 40), "f8", chunks=(3, 1 << 10))


def rows_announced(path, log):
    with netCDF4.Dataset(path, "w") as data:
        data.createDimension("time", 1 << 40)
        for name in CHANNELS:
            data.createVariable(name, "f8", ("time",), chunksizes=(1000,))


def heap_without_end(path, log):
    with netCDF4.Dataset(path, "w") as data:
        data.createDimension("time", 9)
        data.createVariable("ax", "f8", ("time",)).units = "m/s^2"
        data.createVariable("text", str, ("time",))[:] = np.array(["a"] * 9, object)
    content = path.read_bytes()
    at = content.index(b"GCOL\1\0\0\0") + 16
    path.write_bytes(content[:at] + bytes(16) + content[at + 16 :])


def back_and_back(path, log):
    """A ULog whose last message is longer than the rest: the library steps back by its length."""
    described = struct.pack("<HB", 22, ord("F")) + b"a0:uint64_t timestamp;"
    data = ULog.HEADER_BYTES + bytes(9) + described * 300
    path.write_bytes(data + struct.pack("<HB", 10_001, 1) + bytes(5))


WHOLE = "is no whole file of the format"


@pytest.mark.parametrize(
    ("name", "make", "line"),
    [
        ("log.mat", cells_in_cells, f"signal 11|{WHOLE}"),
        ("log.mat", never_written, "of memory"),
        ("log.nc", rows_announced, "more than 200 times its"),
        pytest.param(
            *("log.nc", heap_without_end, "takes more than 1 s of processor time to read"),
            marks=pytest.mark.study,
        ),
        ("log.ulg", back_and_back, "takes more than 1 s of processor time to read"),
    ],
)
def test_a_file_made_to_break_its_reader_is_rejected_within_seconds(
    log, seeds, run, tmp_path, monkeypatch, name, make, line
):
    monkeypatch.setattr(guarded, "MEMORY", 64 << 20)
    monkeypatch.setattr(guarded, "SECONDS", 0.5)
    (tmp_path / name).write_bytes(seeds[name[4:]])
    make(tmp_path / name, log)
    begin = time.process_time()
    [reason] = run(tmp_path / name).quality["reasons"]
    assert reason.isprintable() and len(reason) < 400 and re.search(line, reason)
    assert time.process_time() - begin < 5
