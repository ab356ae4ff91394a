"""Files that are not logs of any format: the true cause, in one line, and what to do."""

import json
import sqlite3
import zipfile

import h5py
import netCDF4
import numpy as np
import pytest
from rosbags import rosbag1

from imuloop.__main__ import main
from imuloop.core.errors import ImuloopError
from imuloop.core.samples import CHANNELS
from ingest.logs import brief

POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a2146\nsize 12345\n"


def sqlite(path):
    database = sqlite3.connect(path)
    brief().to_sql("samples", database)
    database.close()


def archive(*members):
    def write(path):
        with zipfile.ZipFile(path, "w") as file:
            for name in members:
                file.writestr(name, "<xml/>")

    return write


def columns(path):
    path.write_text(json.dumps(brief().to_dict("list")))


def announced(path):
    """An array of 8 TB, of which nothing is in the file."""
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({1 << 40}, 7), }}".ljust(117)
    content = b"\x93NUMPY\1\0v\0" + header.encode() + b"\n"
    if path.suffix == ".npz":
        with zipfile.ZipFile(path, "w") as file:
            file.writestr("t.npy", content)
    else:
        path.write_bytes(content)


def never_written(path):
    """An array of 24 TB, none of which is in the file."""
    with h5py.File(path, "w") as file:
        file.create_dataset("acc", (3, 1 << 40), "f8", chunks=(3, 1 << 10))


def nested(path):
    """Groups in each other, over which libraries are slow."""
    with h5py.File(path, "w") as file:
        group = file
        for _ in range(3000):
            group = group.create_group("g")


def rows_announced(path):
    with netCDF4.Dataset(path, "w") as data:
        data.createDimension("time", 1 << 40)
        for name in CHANNELS:
            data.createVariable(name, "f8", ("time",), chunksizes=(1000,))


def cut_off(path):
    rows_announced(path) if path.suffix == ".nc" else brief(20_000).to_parquet(path)
    path.write_bytes(path.read_bytes()[:5000])


def spoilt(path):
    brief(20_000).to_parquet(path, index=False, compression="gzip")
    content = path.read_bytes()
    half = len(content) // 2
    path.write_bytes(content[:half] + bytes(400) + content[half + 400 :])


BROKEN, TOO_MUCH = "is damaged, or not of the format", "more than 200 times"
DOCUMENT, LFS = "the file is one JSON document", "is a pointer of Git LFS"
SHEET, TABLES = "the file is a spreadsheet", "export an SQLite database of another kind as CSV"
CASES = {
    "log.json": (lambda path: brief().to_json(path, orient="records", indent=1), DOCUMENT),
    "line.json": (lambda path: brief().to_json(path, orient="records"), DOCUMENT),
    "log.txt": (lambda path: brief().to_json(path, orient="records", indent=1), DOCUMENT),
    "line.csv": (lambda path: brief(2000).to_json(path, orient="records"), DOCUMENT),
    "log.jsonl": (columns, DOCUMENT),
    "log.sqlite": (sqlite, TABLES),
    "log.db3": (sqlite, TABLES),
    "log.xlsx": (archive("[Content_Types].xml", "xl/workbook.xml"), SHEET),
    "log.ods": (archive("mimetype", "content.xml"), SHEET),
    "log.xls": (lambda path: path.write_bytes(b"\xd0\xcf\x11\xe0\xa1\xb1" + bytes(600)), SHEET),
    **{f"lfs.{end}": (lambda path: path.write_text(POINTER), LFS)
       for end in ("csv", "parquet", "mat", "bag", "npy", "zip", "dat")},
    "log.npy": (lambda path: np.save(path, {"a": 1}), "object, which is not loaded: save numbers"),
    "many.npz": (lambda path: np.savez_compressed(path, t=np.zeros(10**7)), TOO_MUCH),
    "long.npy": (announced, BROKEN),
    "long.npz": (announced, "does not fit the memory"),
    "log.feather": (lambda path: path.write_bytes(b"ARROW1\0\0" + bytes(99)), BROKEN),
    "never.mat": (never_written, TOO_MUCH),
    "announced.nc": (rows_announced, TOO_MUCH),
    "cut.nc": (cut_off, BROKEN),
    "nested.nc": (nested, "groups lie in each other"),
    "cut.parquet": (cut_off, BROKEN),
    "spoilt.parquet": (spoilt, BROKEN),
    "log.zip": (lambda path: path.write_bytes(b"PK\3\4" + bytes(99)), BROKEN),
    "log.ulg": (lambda path: path.write_bytes(b"ULog\x01\x12\x35" + bytes(30)), "no rows of"),
    "flight.log": (lambda path: path.write_bytes(b"FMT, 128, 89, FMT"), "give the binary log"),
    "old.feather": (lambda path: path.write_bytes(b"FEA1" + bytes(99)), "is Feather of version 1"),
}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "declared"), [*((name, None) for name in CASES), ("lfs.csv", "netcdf")]
)
def test_the_true_cause_is_one_line(run, tmp_path, name, declared):
    """A declared format hides no pointer."""
    write, line = CASES[name]
    write(tmp_path / name)
    [reason] = run(tmp_path / name, format=declared).quality["reasons"]
    assert line in reason and reason.isprintable() and len(reason) < 400


@pytest.mark.parametrize("command", ["info", "noise"])
@pytest.mark.parametrize("name", ["lfs.parquet", "log.json"])
def test_the_commands_name_the_cause_too(tmp_path, capsys, command, name):
    write, line = CASES[name]
    write(tmp_path / name)
    more = ["-o", str(tmp_path / "out")] * (command == "noise")
    assert main([command, str(tmp_path / name), *more]) == 1
    said = capsys.readouterr()
    assert line in said.out + said.err and "Traceback" not in said.err


def test_the_extra_is_named_where_its_library_is_missing(run, tmp_path, monkeypatch):
    with rosbag1.Writer(tmp_path / "log.bag"):
        pass
    monkeypatch.setitem(__import__("sys").modules, "rosbags", None)
    line = r"needs the package rosbags, .*pip install '\.\[ros\]'"
    with pytest.raises(ImuloopError, match=line):
        run(tmp_path / "log.bag")
